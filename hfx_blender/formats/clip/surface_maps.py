# SPDX-License-Identifier: GPL-3.0-or-later
"""Haptic surfaces of a clip: sections SURF, HMAP and TEXL."""

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from ...engine.scene import EffectDescription, HapticSurface
from ...engine.texture.haptic_map import HapticMap
from .container import Records, Texts, records
from .spatial_recorder import EffectState

_FULL_INTENSITY: Final = 2**24 - 1
_FULL_SHARPNESS: Final = 255


def sections_of(
    surfaces: Sequence[tuple[EffectDescription, EffectState]], texts: Texts
) -> dict[str, Records]:
    """Sections of micro-collision surfaces with their states; equal maps are stored once. Empty
    sections without surfaces. ``texts`` receives the names."""
    rows: list[tuple[Any, ...]] = []
    maps: dict[bytes, tuple[int, tuple[Any, ...], Records]] = {}
    texel_count = 0
    for effect, state in surfaces:
        assert isinstance(effect.area, HapticSurface) and effect.area.texture.map is not None
        haptic_map, device = effect.area.texture.map, effect.area.texture.device
        strongest = float(haptic_map.intensity.max())
        texels = texels_of(haptic_map)
        height, width = texels.shape
        size_mm = [1e3 * length for length in haptic_map.size_m]
        shape = (width, height, size_mm, int(haptic_map.tiles))
        key = repr(shape).encode() + texels.tobytes()
        if key not in maps:
            maps[key] = len(maps), (*shape, texel_count, texels.size, 0), texels.ravel()
            texel_count += texels.size
        # Amplitude is linear in intensity above 0, so a map scaled to 1 has a smaller range.
        low, high = (g / device.amplitude_g[1] for g in device.amplitude_g)
        full_m_s2 = float(state["level"]) * float(state["parameters"][0])
        range_m_s2 = full_m_s2 * low, full_m_s2 * (low + strongest * (high - low))
        uv_mm = [1e3 * length for length in effect.area.uv_m]
        rows.append((texts.add(effect.name), maps[key][0], range_m_s2, device.frequency_hz, uv_mm))
    return {
        "SURF": records("SURF", rows),
        "HMAP": records("HMAP", [record for _, record, _ in maps.values()]),
        "TEXL": np.concatenate([np.zeros(0, np.uint32), *(part for *_, part in maps.values())]),
    }


def texels_of(haptic_map: HapticMap) -> Records:
    """Texels (H, W) of a map as uint32, bottom row first: high 24 bits intensity relative to the
    strongest, low 8 bits sharpness. An intensity above 0 stays above 0."""
    intensity = haptic_map.intensity.astype(np.float64)
    strongest = float(intensity.max()) or 1.0
    # 24 bits, the precision of float32, keep the order of texels: the strongest of a path decides
    # on the frequency.
    share = np.maximum(np.rint(intensity * (_FULL_INTENSITY / strongest)), intensity > 0.0)
    sharpness = np.rint(haptic_map.sharpness.astype(np.float64) * _FULL_SHARPNESS)
    return share.astype(np.uint32) << np.uint32(8) | sharpness.astype(np.uint32)
