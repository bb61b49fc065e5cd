# SPDX-License-Identifier: GPL-3.0-or-later
"""Strength of an effect above the detection threshold, for panels and ``hfx info``."""

import bpy
import numpy as np

from ...blender.stored_values import limited
from ...engine.body.detection import REFERENCE_HZ, equal_feel_factors, level_db, threshold
from ...engine.body.model import load_model
from ...engine.modality import MODALITIES, neutral_temperature_c
from . import effects


def level_text(effect: bpy.types.Object, *, is_equal: bool = False) -> str:
    """Strength at full activation, such as "7 to 34 dB SL": on the least and the most sensitive
    part of a painted area, otherwise of the whole body; with the factors of Equal Feel if
    ``is_equal``. "" in silence, and for a modality without thresholds. Raises InputError for an
    invalid painted area or an unknown model."""
    hfx = effect.hfx
    modality = MODALITIES[hfx.modality]
    strength = limited(hfx, modality.strength_parameter.prop)
    if modality.name == "temperature":
        strength = abs(strength - neutral_temperature_c(hfx.temperature_reference == "CONTACT"))
    hz = limited(hfx, "frequency") if len(modality.controls) > 1 else REFERENCE_HZ
    thresholds = threshold(modality.name, hz)
    if is_equal and hfx.kind != "ACTUATORS":  # values of single actuators stay
        strength = strength * equal_feel_factors(modality.name, thresholds)
    levels = level_db(strength * limited(hfx, "intensity"), thresholds)
    vertices = effects.area(effect)[0] if hfx.kind == "PAINTED" else []
    if vertices:
        levels = levels[np.unique(load_model(hfx.model_id).part[vertices])]
    if not np.isfinite(levels).all():
        return ""
    least, most = (f"{level:.0f}".replace("-0", "0") for level in (levels.min(), levels.max()))
    return f"{most} dB SL" if least == most else f"{least} to {most} dB SL"
