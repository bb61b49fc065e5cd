# SPDX-License-Identifier: GPL-3.0-or-later
"""Back end ``folder``: surfaces from pictures of any generator, and prompts in these pictures.

A picture is converted to a relief by a network, or by brightness. AUTOMATIC1111's web UI and its
forks write one text, ``parameters``. ComfyUI writes the graph of its nodes as JSON: ``prompt`` as
executed, ``workflow`` as drawn in the editor.
"""

import json
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
import numpy.typing as npt

from ..engine.arrays import F64
from ..engine.texture.haptic_map import NoticeableSteps
from ..engine.texture.height_field import SurfaceRelief, from_image
from ..engine.texture.mcha import MapSettings, make_map
from ..engine.texture.relief.linear_light import height_from_colour
from ..engine.texture.relief.relief_estimate import estimate
from ..files.hashes import sha256_of
from ..formats.pictures import png
from .generated import Generated, name_of

NAME: Final = "folder"
SUFFIXES: Final = (".png", ".jpg", ".jpeg", ".webp", ".tif", ".tiff", ".exr")

Way = Literal["relief", "sobel"]

WAYS: Final[tuple[Way, ...]] = ("relief", "sobel")  # ways of conversion, the best one first
_NOTES: Final = {
    "relief": "the relief was estimated from the picture by a network",
    "sobel": "the picture's brightness was taken as heights (the map paper's way): prints and "
    "shadows are felt as ridges",
}

_NEGATIVE: Final = "Negative prompt:"
_SETTINGS: Final = re.compile(r'\s*([A-Z][\w /-]*):\s*("(?:\\.|[^"\\])*"|[^,]*)(?:,|$)')
_TEXTS: Final = (
    *("text", "text_g", "text_l", "t5xxl", "clip_l", "clip_g"),
    *("string", "value", "prompt"),
)
"""Inputs of ComfyUI's nodes with words, by precedence."""

_OPPOSITE: Final = {"positive": "negative", "negative": "positive"}
_SEEDS: Final = ("seed", "noise_seed")
_GUIDED: Final = ("positive", "negative", "conditioning")
_POSITIVE: Final = ("positive", "conditioning", "cond1")  # a basic guider has no negative words
_DEEPEST: Final = 64  # most links from a sampler to its seed


def surface_of(
    srgb: npt.ArrayLike,
    size_m: tuple[float, float],
    *,
    depth_m: float,
    tiles: bool,
    way: Way = WAYS[0],
) -> SurfaceRelief:
    """Convert a picture (H, W, 3), sRGB 0..1, bottom row first, to a surface of ``size_m``.
    ``depth_m`` is the height of white over black, for the way ``sobel`` only; ``tiles``: opposite
    edges match. Raises InputError if the array is no picture, or a size is not allowed."""
    if way == "relief":
        relief = estimate(srgb, size_m, tiles=tiles)
        roughness = np.asarray(relief.roughness, np.float64)
        return SurfaceRelief(relief.field, roughness, (_NOTES[way],), relief.slope)
    field = from_image(height_from_colour(srgb), depth_m, size_m, tiles=tiles)
    # Brightness says nothing about roughness.
    roughness = np.full(field.heights_m.shape, MapSettings().default_roughness)
    return SurfaceRelief(field, roughness, (_NOTES[way],))


def generate(
    picture: Path,
    pixels: Callable[[Path], F64],
    *,
    size_m: tuple[float, float] | None,
    depth_m: float,
    tiles: bool = False,
    way: Way = WAYS[0],
    steps: NoticeableSteps | None = None,
) -> Generated:
    """Generate the surface of a picture; the record has the picture's prompt, if there is one.

    ``pixels`` reads a picture as for :func:`surface_of`. ``size_m`` None: 0.1 m along the longer
    edge. A prompt with tiling has the same effect as ``tiles``. Raises InputError if the picture
    cannot be read, or a size is not allowed.
    """
    srgb = pixels(picture)
    prompt = prompt_of(png.texts(picture))
    rows, columns = srgb.shape[:2]
    longest = max(rows, columns)
    size = size_m or (0.1 * columns / longest, 0.1 * rows / longest)
    surface = surface_of(srgb, size, depth_m=depth_m, tiles=tiles or prompt.is_tiling, way=way)
    # Part of the name: a changed picture of the same name gives a new surface.
    digest = sha256_of(picture)
    notes = surface.notes
    if not prompt.words:
        notes += ("the picture tells no words that it was made of",)
    record = {
        "words": prompt.words,
        "negative_words": prompt.negative,
        "seed": prompt.seed,
        "back_end": NAME,
        "conversion": way,
        "source": {
            "file": picture.name,
            "sha256": digest,
            "generator": prompt.generator,
            "model": prompt.model,
            "settings": dict(prompt.settings),
        },
        "versions": {},
    }
    return Generated(
        name_of(picture.stem, digest[:8]),
        np.rint(255.0 * np.clip(srgb, 0.0, 1.0)).astype(np.uint8),
        surface.height,
        np.asarray(surface.roughness),
        make_map(surface.height, surface.roughness, MapSettings(steps=steps), surface.slope),
        record,
        slope=surface.slope,
        notes=notes,
    )


@dataclass(frozen=True)
class PicturePrompt:
    """Words and settings of a generated picture; empty or None where the picture has none."""

    words: str = ""
    negative: str = ""
    seed: int | None = None
    generator: str = ""
    model: str = ""
    is_tiling: bool = False
    settings: Mapping[str, str] = field(default_factory=dict)


def prompt_of(texts: Mapping[str, str]) -> PicturePrompt:
    """Prompt in the text chunks of a PNG, by their keys; empty for missing or unreadable texts."""
    if "parameters" in texts:
        return of_parameters(texts["parameters"])
    # The executed graph is exact; the drawn one has unnamed values and is only a substitute.
    for key, read in (("prompt", _of_graph), ("workflow", _of_workflow)):
        try:
            document = json.loads(texts.get(key, ""))
        except (ValueError, RecursionError):
            continue
        prompt = read(document) if isinstance(document, dict) else None
        if prompt is not None:
            return prompt
    return PicturePrompt()


def of_parameters(text: str) -> PicturePrompt:
    """Prompt of AUTOMATIC1111's text: words; from "Negative prompt:" on negative words; a last line
    of 3 or more "Key: value" pairs is settings, with Seed, Model and Tiling."""
    lines = text.strip().splitlines()
    settings: dict[str, str] = {}
    # Fewer than three settings are words that contain a colon.
    if lines and len(pairs := _SETTINGS.findall(lines[-1])) >= 3:
        settings = {key.strip(): value.strip().strip('"') for key, value in pairs}
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
    """Prompt of an executed ComfyUI graph: the words that lead to the first sampler with words.
    None without words."""
    nodes = {
        key: node
        for key, node in graph.items()
        if isinstance(node, dict) and isinstance(node.get("inputs"), dict)
    }
    for node in nodes.values():
        inputs = node["inputs"]
        if not any(name in inputs for name in ("positive", "guider")):
            continue
        if not any(name in inputs for name in (*_SEEDS, "noise")):
            continue  # a ControlNet has inputs of these names, but no seed
        guider = _followed(nodes, inputs.get("guider"))
        ends = guider["inputs"] if guider else inputs
        positive = next((ends[name] for name in _POSITIVE if name in ends), None)
        words = _words(nodes, positive, "positive")
        if words:
            negative = _words(nodes, ends.get("negative"), "negative")
            named = (n["inputs"].get(k) for n in nodes.values() for k in ("ckpt_name", "unet_name"))
            model = next((name for name in named if isinstance(name, str)), "")
            return PicturePrompt(words, negative, _number(nodes, inputs), "ComfyUI", model)
    return None


def _followed(nodes: Mapping[str, Any], link: Any) -> Mapping[str, Any] | None:
    """Node at the end of a link [node key, output number]; None if missing or no link."""
    if isinstance(link, list) and len(link) == 2:
        node: Mapping[str, Any] | None = nodes.get(str(link[0]))
        return node
    return None


def _words(nodes: Mapping[str, Any], link: Any, role: str, seen: set[int] | None = None) -> str:
    """Words at the end of a chain of links for a role, positive or negative; "" without any. Inputs
    of the opposite role are not followed. ``seen`` holds the ids of visited nodes."""
    seen = set() if seen is None else seen
    node = _followed(nodes, link)
    if node is None:
        return link.strip() if isinstance(link, str) else ""
    if id(node) in seen or node.get("class_type") == "ConditioningZeroOut":
        return ""
    seen.add(id(node))  # a graph of an unknown file may contain cycles
    inputs = node["inputs"]
    # A text node ends the chain; other nodes, as those that combine words, pass it on.
    for name in _TEXTS:
        if name in inputs and (text := _words(nodes, inputs[name], role, seen)):
            return text
    parts = []
    for name, value in inputs.items():
        # Conditioning passes through nodes by inputs of the role's name.
        is_guided = name.startswith(_GUIDED) and not name.startswith(_OPPOSITE[role])
        if is_guided and isinstance(value, list):
            parts.append(_words(nodes, value, role, seen))
    return ", ".join(dict.fromkeys(part for part in parts if part))


def _number(nodes: Mapping[str, Any], inputs: Mapping[str, Any], depth: int = 0) -> int | None:
    """Whole number in an input seed, noise_seed, noise or value, or behind its links; or None."""
    for name in (*_SEEDS, "noise", "value"):
        value = inputs.get(name)
        # True is an int for Python.
        if isinstance(value, int) and not isinstance(value, bool):
            return value
        node = _followed(nodes, value)
        if node is not None and depth < _DEEPEST:
            return _number(nodes, node["inputs"], depth + 1)
    return None


def _of_workflow(document: Mapping[str, Any]) -> PicturePrompt | None:
    """Prompt of ComfyUI's drawn graph, where links have numbers and widget values have no names;
    muted and bypassed nodes are left out. None without words."""
    # A link is [number, source node, source slot, target node, target slot, type].
    links = {
        link[0]: link[1]
        for link in _items(document.get("links"))
        if isinstance(link, list) and len(link) > 4 and isinstance(link[0], int)
    }
    # Mode 0: a node that is neither muted nor bypassed.
    graph = {
        str(node["id"]): _as_executed(node, links)
        for node in _items(document.get("nodes"))
        if isinstance(node, dict) and "id" in node and node.get("mode", 0) == 0
    }
    return _of_graph(graph)


def _items(value: Any) -> list[Any]:
    """Return ``value`` if a list, else an empty list."""
    return value if isinstance(value, list) else []


def _as_executed(node: Mapping[str, Any], links: Mapping[Any, Any]) -> dict[str, Any]:
    """Convert a node of a drawn graph to the form of executed graphs; ``links``: number to node.
    Widget values are guessed by the node's type: the first text, or the first whole number."""
    inputs: dict[str, Any] = {}
    values = _items(node.get("widgets_values"))
    kind = str(node.get("type", ""))
    texts = [value for value in values if isinstance(value, str)]
    # In Python booleans are whole numbers as well.
    numbers = [value for value in values if isinstance(value, int) and not isinstance(value, bool)]
    if "Checkpoint" in kind and texts:
        inputs["ckpt_name"] = texts[0]
    elif "Sampler" in kind or "Noise" in kind:
        inputs.update({"seed": numbers[0]} if numbers else {})
    elif texts:
        inputs["text"] = texts[0]
    for slot in _items(node.get("inputs")):
        link = slot.get("link") if isinstance(slot, dict) else None
        if isinstance(link, int) and link in links:
            inputs[str(slot.get("name"))] = [str(links[link]), 0]
    return {"class_type": kind, "inputs": inputs}
