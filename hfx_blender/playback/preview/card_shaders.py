# SPDX-License-Identifier: GPL-3.0-or-later
"""GLSL shaders of the preview: lit skin, and discs with a glow.

Only the subset of GLSL that Blender translates for OpenGL, Vulkan and Metal.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...engine.arrays import F32, I32
from .actuator_glow import MOST_DISCS

if TYPE_CHECKING:
    import gpu

_CONSTANTS = {
    "DARKEST": "0.55",  # brightness of skin at grazing view: keeps the body's shape readable
    "HALO": "2.6",  # times a disc's radius, at full strength
    "OFF": "vec3(0.06, 0.06, 0.07)",
    "RIM": "0.35",  # share of white in the rim, visible on any skin
}


@cache
def skin() -> gpu.types.GPUShader:
    """Shader for triangles with ``pos``, ``normal`` and ``colour`` in mesh space.

    Uniforms: ``to_viewer``, a unit vector, and ``above``, the offset along the normal, both in mesh
    space; ``opacity``, 0..1.
    """
    import gpu

    # At most 128 bytes of constants: the limit of every graphics card. Largest first.
    info = gpu.types.GPUShaderCreateInfo()
    info.push_constant("MAT4", "ModelViewProjectionMatrix")
    info.push_constant("VEC3", "to_viewer")
    info.push_constant("FLOAT", "above")
    info.push_constant("FLOAT", "opacity")
    info.push_constant("BOOL", "srgbTarget")
    info.vertex_in(0, "VEC3", "pos")
    info.vertex_in(1, "VEC3", "normal")
    info.vertex_in(2, "VEC4", "colour")
    return _made(info, "skin")


@cache
def discs() -> gpu.types.GPUShader:
    """Shader for triangles with ``corner``: cosine, sine, ring, index of the disc's ``rows``.

    Uniforms: ``full``, colour at full strength and world radius; ``cold``, colour below neutral;
    ``above``, offset along the normal; ``scale``, world length of one unit of disc space. Rows as
    in ``actuator_glow.Discs``.
    """
    import gpu

    info = gpu.types.GPUShaderCreateInfo()
    info.push_constant("MAT4", "ModelViewProjectionMatrix")
    info.push_constant("FLOAT", "above")
    info.push_constant("FLOAT", "scale")
    info.push_constant("BOOL", "srgbTarget")
    info.uniform_buf(0, "vec4", f"rows[{2 * MOST_DISCS}]")
    info.vertex_in(0, "VEC4", "corner")
    info.vertex_in(1, "VEC4", "full")
    info.vertex_in(2, "VEC3", "cold")
    return _made(info, "disc")


def _made(info: gpu.types.GPUShaderCreateInfo, name: str) -> gpu.types.GPUShader:
    """Shader of the files ``name.vert`` and ``name.frag`` beside this module."""
    import gpu

    for constant, value in _CONSTANTS.items():
        info.define(constant, value)
    passed = gpu.types.GPUStageInterfaceInfo(f"hfx_{name}")
    passed.smooth("VEC4", "shade")
    info.vertex_out(passed)
    info.fragment_out(0, "VEC4", "seen")
    info.vertex_source(Path(__file__).with_name(f"{name}.vert").read_text(encoding="utf-8"))
    info.fragment_source(Path(__file__).with_name(f"{name}.frag").read_text(encoding="utf-8"))
    return gpu.shader.create_from_info(info)


CORNERS = 12
RINGS = 4
"""Number of rings: edge of the disc, edge of its rim, and both edges of its glow."""


def disc_geometry(count: int) -> tuple[F32, I32]:
    """Corners (P, 4) and triangles (F, 3) of ``count`` discs.

    A corner has cosine and sine of its angle, its ring (0 in the middle, else 1..:data:`RINGS`),
    and the number of its disc.
    """
    angles = np.linspace(0.0, 2.0 * np.pi, CORNERS, endpoint=False)
    one = np.zeros((1 + RINGS * CORNERS, 4), np.float32)
    one[1:, 0] = np.tile(np.cos(angles), RINGS)
    one[1:, 1] = np.tile(np.sin(angles), RINGS)
    one[1:, 2] = np.repeat(np.arange(1, RINGS + 1), CORNERS)
    corners = np.tile(one, (count, 1, 1))
    corners[:, :, 3] = np.arange(count)[:, None]
    # Triangles of one disc: a fan around the middle, and two for each piece of rim and of glow.
    triangles = []
    for k in range(CORNERS):
        here, after = 1 + k, 1 + (k + 1) % CORNERS
        triangles.append((0, here, after))
        for ring in range(0, RINGS, 2):
            a, b = here + ring * CORNERS, after + ring * CORNERS
            c, d = a + CORNERS, b + CORNERS
            triangles += [(a, c, b), (b, c, d)]
    firsts = np.arange(count, dtype=np.int32) * len(one)
    all_triangles = np.array(triangles, np.int32) + firsts[:, None, None]
    return corners.reshape(-1, 4), all_triangles.reshape(-1, 3)
