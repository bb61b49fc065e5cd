# SPDX-License-Identifier: GPL-3.0-or-later
"""Prompts that image generators write into their PNG pictures.

AUTOMATIC1111's web UI (and its kin) writes one text, ``parameters``; ComfyUI the graph of its nodes
as JSON, ``prompt`` as it was run and ``workflow`` as it was drawn.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

_NEGATIVE: Final = "Negative prompt:"
_SETTINGS: Final = re.compile(r'\s*([A-Z][\w /-]*):\s*("(?:\\.|[^"\\])*"|[^,]*)(?:,|$)')
_TEXTS: Final = (
    "text",
    "text_g",
    "text_l",
    "t5xxl",
    "clip_l",
    "clip_g",
    "string",
    "value",
    "prompt",
)
"""Inputs of ComfyUI's nodes that hold words, the most telling first."""

_OTHER: Final = {"positive": "negative", "negative": "positive"}
_SEEDS: Final = ("seed", "noise_seed")
_GUIDED: Final = ("positive", "negative", "conditioning")
_WANTED: Final = ("positive", "conditioning", "cond1")  # a basic guider has no negative words
_DEEPEST: Final = 64  # nodes from a sampler to its words


@dataclass(frozen=True)
class PicturePrompt:
    """Words and settings that a picture tells about its making; empty where it tells none."""

    words: str = ""
    negative: str = ""
    seed: int | None = None
    generator: str = ""
    model: str = ""
    is_tiling: bool = False
    settings: Mapping[str, str] = field(default_factory=dict)


def prompt_of(texts: Mapping[str, str]) -> PicturePrompt:
    """Prompt in the texts of a PNG; what cannot be read is left empty."""
    if "parameters" in texts:
        return of_parameters(texts["parameters"])
    for key, read in (("prompt", _of_graph), ("workflow", _of_workflow)):
        try:
            document = json.loads(texts.get(key, ""))
        except (ValueError, RecursionError):
            continue
        found = read(document) if isinstance(document, dict) else None
        if found is not None:
            return found
    return PicturePrompt()


def of_parameters(text: str) -> PicturePrompt:
    """Prompt of AUTOMATIC1111's text: words, negative words, and a last line of settings."""
    lines = text.strip().splitlines()
    settings: dict[str, str] = {}
    if lines and len(found := _SETTINGS.findall(lines[-1])) >= 3:
        settings = {key.strip(): value.strip().strip('"') for key, value in found}
        lines = lines[:-1]
    words: list[str] = []
    negative: list[str] = []
    is_negative = False
    for line in lines:
        if line.startswith(_NEGATIVE):
            is_negative, line = True, line[len(_NEGATIVE) :]
        (negative if is_negative else words).append(line.strip())
    seed = settings.get("Seed", "")
    return PicturePrompt(
        "\n".join(words).strip(),
        "\n".join(negative).strip(),
        int(seed) if seed.lstrip("-").isdigit() else None,
        "AUTOMATIC1111",
        settings.get("Model", ""),
        settings.get("Tiling", "") == "True",
        settings,
    )


def _of_graph(graph: Mapping[str, Any]) -> PicturePrompt | None:
    """Prompt of a ComfyUI graph: the words that reach a sampler's positive and negative input."""
    nodes = {key: each for key, each in graph.items() if _is_node(each)}
    for node in nodes.values():
        inputs = node["inputs"]
        if not any(name in inputs for name in ("positive", "guider")):
            continue
        if not any(name in inputs for name in (*_SEEDS, "noise")):
            continue  # a ControlNet has such inputs, too, but is no sampler
        guider = _followed(nodes, inputs.get("guider"))
        ends = guider["inputs"] if guider else inputs
        wanted = next((ends[name] for name in _WANTED if name in ends), None)
        words = _words(nodes, wanted, "positive")
        if words:
            negative = _words(nodes, ends.get("negative"), "negative")
            seed = _number(nodes, inputs)
            return PicturePrompt(words, negative, seed, "ComfyUI", _model(nodes))
    return None


def _is_node(value: Any) -> bool:
    return isinstance(value, dict) and isinstance(value.get("inputs"), dict)


def _followed(nodes: Mapping[str, Any], link: Any) -> Mapping[str, Any] | None:
    """Node at the other end of a link, [its key, number of its output]."""
    if isinstance(link, list) and len(link) == 2:
        found: Mapping[str, Any] | None = nodes.get(str(link[0]))
        return found
    return None


def _words(nodes: Mapping[str, Any], link: Any, role: str, seen: set[int] | None = None) -> str:
    """Words at the end of a chain of links; those of a sampler's other input are not taken."""
    seen = set() if seen is None else seen
    node = _followed(nodes, link)
    if node is None:
        return link.strip() if isinstance(link, str) else ""
    if id(node) in seen or node.get("class_type") == "ConditioningZeroOut":
        return ""
    seen.add(id(node))  # a graph of strangers may go in circles
    inputs = node["inputs"]
    for name in _TEXTS:
        if name in inputs and (found := _words(nodes, inputs[name], role, seen)):
            return found
    parts = []
    for name, value in inputs.items():
        is_guided = name.startswith(_GUIDED) and not name.startswith(_OTHER[role])
        if is_guided and isinstance(value, list):
            parts.append(_words(nodes, value, role, seen))
    return ", ".join(dict.fromkeys(part for part in parts if part))


def _number(nodes: Mapping[str, Any], inputs: Mapping[str, Any], depth: int = 0) -> int | None:
    for name in (*_SEEDS, "noise", "value"):
        value = inputs.get(name)
        if isinstance(value, int) and not isinstance(value, bool):
            return value
        node = _followed(nodes, value)
        if node is not None and depth < _DEEPEST:
            return _number(nodes, node["inputs"], depth + 1)
    return None


def _model(nodes: Mapping[str, Any]) -> str:
    for node in nodes.values():
        for name in ("ckpt_name", "unet_name"):
            if isinstance(node["inputs"].get(name), str):
                return str(node["inputs"][name])
    return ""


def _of_workflow(document: Mapping[str, Any]) -> PicturePrompt | None:
    """Prompt of ComfyUI's drawn graph, whose links have numbers and whose values no names."""
    links = {
        each[0]: each[1]
        for each in _items(document.get("links"))
        if isinstance(each, list) and len(each) > 4 and isinstance(each[0], int)
    }
    graph = {str(node["id"]): _as_run(node, links) for node in _drawn(document)}
    return _of_graph(graph)


def _drawn(document: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    for node in _items(document.get("nodes")):
        if isinstance(node, dict) and "id" in node and node.get("mode", 0) == 0:
            yield node


def _items(value: Any) -> list[Any]:
    return value if isinstance(value, list) else []


def _as_run(node: Mapping[str, Any], links: Mapping[Any, Any]) -> dict[str, Any]:
    """Node of a drawn graph in the form in which graphs are run."""
    inputs: dict[str, Any] = {}
    values = _items(node.get("widgets_values"))
    kind = str(node.get("type", ""))
    texts = [each for each in values if isinstance(each, str)]
    numbers = [each for each in values if isinstance(each, int) and not isinstance(each, bool)]
    if "Checkpoint" in kind and texts:
        inputs["ckpt_name"] = texts[0]
    elif "Sampler" in kind or "Noise" in kind:
        inputs.update({"seed": numbers[0]} if numbers else {})
    elif texts:
        inputs["text"] = texts[0]
    for each in _items(node.get("inputs")):
        link = each.get("link") if isinstance(each, dict) else None
        if isinstance(link, int) and link in links:
            inputs[str(each.get("name"))] = [str(links[link]), 0]
    return {"class_type": kind, "inputs": inputs}
