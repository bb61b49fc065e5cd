# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures of other generators: prompts, and the watched folder."""

from __future__ import annotations

import json
import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hfx_blender.errors import InputError
from hfx_blender.formats.pictures import png
from hfx_blender.generation import picture_folder
from hfx_blender.generation.picture_folder import prompt_of
from hfx_tools.commands.watched_folder import WatchedFolder

PARAMETERS = """rough oak planks, <lora:grain:0.7>
second line
Negative prompt: blurry, no cracks
Steps: 20, Sampler: Euler, CFG scale: 7, Seed: 3141592653, Model: "v1-5, pruned", Tiling: True"""


def chunk(name: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))


def picture(path: Path, *texts: bytes, level: int = 128) -> Path:
    """Return a grey PNG of 4 x 4 pixels, written by hand, with extra chunks."""
    rows = b"".join(b"\0" + bytes([level, 255 - level] * 2) for _ in range(4))
    header = chunk(b"IHDR", struct.pack(">IIBBBBB", 4, 4, 8, 0, 0, 0, 0))
    data = chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + header + b"".join(texts) + data)
    return path


def node(kind: str, **inputs: Any) -> dict[str, Any]:
    return {"class_type": kind, "inputs": inputs}


GRAPH = {
    "3": node("KSampler", seed=["20", 0], positive=["11", 0], negative=["11", 1], model=["4", 0]),
    "4": node("CheckpointLoaderSimple", ckpt_name="sd15.safetensors"),
    "6": node("CLIPTextEncode", text=["21", 0], clip=["4", 1]),
    "7": node("CLIPTextEncode", text="shiny", clip=["4", 1]),
    "11": node("ControlNetApplyAdvanced", positive=["6", 0], negative=["7", 0], strength=1.0),
    "20": node("PrimitiveInt", value=42),
    "21": node("PrimitiveString", value="wet gravel"),
}
WORKFLOW = {
    "nodes": [
        {"id": 1, "type": "KSampler", "widgets_values": [77, "fixed", 20, 7.0, "euler"],
         "inputs": [{"name": "model", "link": 1}, {"name": "positive", "link": 2},
                    {"name": "negative", "link": 3}]},
        {"id": 2, "type": "CLIPTextEncode", "inputs": [], "widgets_values": ["denim"]},
        {"id": 3, "type": "CLIPTextEncode", "inputs": [], "widgets_values": ["torn"]},
        {"id": 4, "type": "CheckpointLoaderSimple", "widgets_values": ["a.safetensors"]},
    ],
    "links": [[1, 4, 0, 1, 0, "MODEL"], [2, 2, 0, 1, 1, "CONDITIONING"],
              [3, 3, 0, 1, 2, "CONDITIONING"]],
}  # fmt: skip


def test_prompts_of_automatic1111_are_read_from_any_text_chunk(tmp_path: Path) -> None:
    body = PARAMETERS.encode()
    forms = (
        chunk(b"tEXt", b"parameters\0" + body),
        chunk(b"zTXt", b"parameters\0\0" + zlib.compress(body)),
        chunk(b"iTXt", b"parameters\0\0\0\0\0" + body),
        chunk(b"iTXt", b"parameters\0\1\0en\0x\0" + zlib.compress(body)),
    )
    for form in forms:
        prompt = prompt_of(png.texts(picture(tmp_path / "a.png", form)))
        assert prompt.words == "rough oak planks, <lora:grain:0.7>\nsecond line"
        assert prompt.negative == "blurry, no cracks"
        assert (prompt.seed, prompt.model, prompt.is_tiling) == (3141592653, "v1-5, pruned", True)


def test_prompts_of_comfyui_are_those_that_reach_the_sampler(tmp_path: Path) -> None:
    graph = chunk(b"tEXt", b"prompt\0" + json.dumps(GRAPH).encode())
    prompt = prompt_of(png.texts(picture(tmp_path / "a.png", graph)))
    assert (prompt.words, prompt.negative, prompt.seed) == ("wet gravel", "shiny", 42)
    assert (prompt.generator, prompt.model) == ("ComfyUI", "sd15.safetensors")
    drawn = prompt_of({"workflow": json.dumps(WORKFLOW)})
    assert (drawn.words, drawn.negative, drawn.seed) == ("denim", "torn", 77)


@pytest.mark.parametrize(
    ("guider", "negative"),
    [
        (node("BasicGuider", conditioning=["11", 0]), ""),
        (node("CFGGuider", positive=["11", 0], negative=["7", 0]), "shiny"),
        (node("DualCFGGuider", cond1=["11", 0], cond2=["7", 0], negative=["7", 0]), "shiny"),
    ],
)
def test_a_guider_of_comfyui_has_negative_words_only_if_it_asks_for_them(
    guider: dict[str, Any], negative: str
) -> None:
    graph = {
        "1": node("SamplerCustomAdvanced", noise=["2", 0], guider=["3", 0]),
        "2": node("RandomNoise", noise_seed=42),
        "3": guider,
        "6": node("CLIPTextEncode", text="red brick"),
        "7": node("CLIPTextEncode", text="shiny"),
        "11": node("FluxGuidance", guidance=3.5, conditioning=["6", 0]),
    }
    prompt = prompt_of({"prompt": json.dumps(graph)})
    assert (prompt.words, prompt.negative, prompt.seed) == ("red brick", negative, 42)


@pytest.mark.parametrize(
    "texts",
    [
        {"prompt": "[" * 100_000},
        {"prompt": '{"1": {"inputs": {"positive": ["1", 0], "seed": 1}}}'},  # a circle
        {"prompt": '{"1": 5, "2": {"inputs": []}}', "workflow": '{"nodes": 3, "links": [[1]]}'},
        {"workflow": '{"nodes": [{"id": 1, "inputs": 5}], "links": 7}'},
        {"parameters": "Negative prompt:"},
    ],
)
def test_strange_texts_give_no_words(texts: dict[str, str]) -> None:
    assert prompt_of(texts).words == ""


def test_a_picture_is_given_out_once_when_its_writer_has_ended(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such folder"):
        WatchedFolder(tmp_path / "none")
    watched = WatchedFolder(tmp_path)
    path = picture(tmp_path / "a.png")
    (tmp_path / "notes.txt").write_text("no picture")
    (tmp_path / "empty.png").touch()
    assert watched.settled() == [] and watched.is_waiting
    path.write_bytes(path.read_bytes() + b"more")  # still being written
    assert watched.settled() == [] and watched.is_waiting
    assert watched.settled() == [path] and not watched.is_waiting
    assert watched.settled() == [] and watched.passed_over == [tmp_path / "empty.png"]


def test_a_picture_becomes_a_surface_with_its_words(tmp_path: Path) -> None:
    path = picture(tmp_path / "a.png", chunk(b"tEXt", b"parameters\0" + PARAMETERS.encode()))

    def pixels(_path: Path) -> Any:
        return np.tile(np.array([0.0, 1.0])[None, :, None], (4, 2, 3))

    texture = picture_folder.generate(path, pixels, size_m=(0.04, 0.04), depth_m=1e-3, way="sobel")
    np.testing.assert_allclose(texture.height.heights_m[0], [0.0, 1e-3, 0.0, 1e-3])
    assert texture.height.tiles  # "Tiling: True"
    assert texture.record["seed"] == 3141592653 and texture.record["words"].startswith("rough oak")
    assert texture.record["source"]["generator"] == "AUTOMATIC1111"
