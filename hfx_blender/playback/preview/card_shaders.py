# SPDX-License-Identifier: GPL-3.0-or-later
"""GLSL shaders of the preview: lit skin, and discs with a glow.

Only the subset of GLSL that Blender translates for OpenGL, Vulkan and Metal.
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from ...engine.arrays import F32, I32
from .actuator_glow import MOST_DISCS

if TYPE_CHECKING:
    import gpu

# Brightness of skin at grazing view, as a share: keeps the body's shape readable.
_DARKEST = 0.55

_HALO = 2.6  # times a disc's radius, at full strength
_OFF = (0.06, 0.06, 0.07)
_RIM = 0.35  # share of white in the rim, visible on any skin

# A viewport's colours are stored as sRGB by the card, which then wants light; Blender sets
# ``srgbTarget`` for that, as for its own shaders.
_TO_TARGET = """
vec3 to_target(vec3 colour)
{
  vec3 low = colour / 12.92;
  vec3 high = pow((max(colour, vec3(0.0)) + 0.055) / 1.055, vec3(2.4));
  vec3 light = mix(low, high, step(vec3(0.04045), colour));
  return srgbTarget ? light : colour;
}
"""

# Premultiplied, so that a colour fades out at its edge without turning dark.
_SKIN_VERTEX = f"""
void main()
{{
  gl_Position = ModelViewProjectionMatrix * vec4(pos + normal * above, 1.0);
  float facing = clamp(dot(normal, to_viewer), 0.0, 1.0);
  float alpha = colour.a * opacity;
  shade = vec4(colour.rgb * mix({_DARKEST}, 1.0, facing) * alpha, alpha);
}}
"""

_SKIN_FRAGMENT = (
    _TO_TARGET
    + """
void main()
{
  vec3 colour = shade.rgb / max(shade.a, 1e-6);
  seen = vec4(to_target(colour) * shade.a, shade.a);
}
"""
)

# A disc with a rim, and around it a halo that fades out: rings 1 to 4.
_DISC_VERTEX = f"""
void main()
{{
  int row = int(corner.w) * 2;
  vec3 place = rows[row].xyz;
  vec3 normal = normalize(rows[row + 1].xyz);
  float share = rows[row].w;
  vec3 colour = share < 0.0 ? cold : full.rgb;
  share = abs(share);
  float glow = sqrt(share);
  int ring = int(corner.z);

  vec3 inner = mix(vec3({_OFF[0]}, {_OFF[1]}, {_OFF[2]}), colour, glow);
  inner += (vec3(1.0) - colour) * 0.45 * glow;
  shade = vec4(ring < 2 ? inner : colour, 1.0);
  if (ring == 2) {{
    shade.rgb = clamp(mix(inner, vec3(1.0), {_RIM}), 0.0, 1.0);
  }}
  if (ring > 2) {{
    shade.a = ring == 3 ? 0.75 * glow : 0.0;
  }}

  float radius = full.w * (ring == 0 ? 0.0 : (ring == 1 ? 0.8 : 1.0));
  if (ring == 4) {{
    radius *= 1.0 + {_HALO - 1.0} * share;
  }}
  vec3 across = abs(normal.z) < 0.9 ? vec3(normal.y, -normal.x, 0.0) :
                                      vec3(0.0, normal.z, -normal.y);
  across = normalize(across);
  vec3 offset = corner.x * across + corner.y * cross(normal, across);
  vec3 at = place + normal * above + radius / scale * offset;
  gl_Position = ModelViewProjectionMatrix * vec4(at, 1.0);
}}
"""

_DISC_FRAGMENT = (
    _TO_TARGET
    + """
void main()
{
  seen = vec4(to_target(shade.rgb), shade.a);
}
"""
)


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
    return _made(info, "hfx_skin", _SKIN_VERTEX, _SKIN_FRAGMENT)


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
    return _made(info, "hfx_discs", _DISC_VERTEX, _DISC_FRAGMENT)


def _made(
    info: gpu.types.GPUShaderCreateInfo, name: str, vertex: str, fragment: str
) -> gpu.types.GPUShader:
    import gpu

    passed = gpu.types.GPUStageInterfaceInfo(name)
    passed.smooth("VEC4", "shade")
    info.vertex_out(passed)
    info.fragment_out(0, "VEC4", "seen")
    info.vertex_source(vertex)
    info.fragment_source(fragment)
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
