# SPDX-License-Identifier: GPL-3.0-or-later
"""Bakes the contact response of a volume into keyframes of a property."""

import bpy

from ..blender import compat
from ..errors import InputError

TARGETS = (
    (
        "ENVELOPE",
        "Envelope",
        "The property 'envelope' of the volume, for drivers of sound, light or anything else",
    ),
    (
        "INTENSITY",
        "Intensity",
        "The volume's own intensity; its filters are muted, so that it is felt as before while "
        "it touches",
    ),
    ("SPEAKER", "Speaker Volume", "Volume (loudness) of the speakers that are parented to it"),
)


def bake(scene: bpy.types.Scene, effect: bpy.types.Object, target: str = "ENVELOPE") -> int:
    """Write the strongest response of each frame as keyframes of a target; return their number.

    ``target`` is an id of :data:`TARGETS`. The strongest level of all bodies counts. Keyframes
    equal to both neighbours are left out. "INTENSITY" mutes the filters. Raises InputError for a
    scene without bodies, a muted or hidden effect, a volume without contact, and a volume without
    speakers.
    """
    import numpy as np

    from ..engine.evaluate import Engine
    from ..reading.curves.animation_time import animation_frames
    from ..reading.scene_reader import SceneReader

    reader = SceneReader(scene)
    ids = [e.id for e in reader.description.effects if e.name == effect.name]
    if not ids:
        raise InputError(f"'{effect.name}' is muted, hidden or no effect of this scene.")
    engine = Engine(reader.description, tolerance=reader.tolerance)
    levels = np.zeros(reader.time.sample_count)
    # Levels without contact, to divide activation out of the baked intensity.
    base = np.ones(reader.time.sample_count)
    for block in reader.blocks():
        for described, animated in zip(reader.description.effects, block.effects, strict=True):
            if described.id == ids[0]:
                base[block.own_indices] = animated.levels[block.own]
        for run in engine.evaluate(block):
            if run.stream.effect_id == ids[0]:
                levels[run.indices] = np.maximum(levels[run.indices], run.levels)
    if not levels.any():
        raise InputError(f"'{effect.name}' touches no body between these frames.")
    first, last = reader.time.frame_first, reader.time.frame_last
    every = np.arange(first, last + 1)
    # Take the maximum within each frame, which includes impacts between two frames.
    at = np.minimum(
        [int((f - first) * reader.time.rate_hz / reader.time.fps) for f in [*every, last + 1]],
        len(levels),
    )
    pairs = list(zip(at[:-1].tolist(), at[1:].tolist(), strict=True))
    if target == "INTENSITY":
        # Activation multiplies the baked intensity, so clips are divided out.
        shares = np.divide(levels, base, out=np.zeros_like(levels), where=base > 0.0)
        # A constant intensity stays the value at full contact; keyframes replace an animated one.
        is_animated = compat.fcurve_of(effect, "hfx.intensity") is not None
        intensity = 1.0 if is_animated else effect.hfx.intensity
        values = [float(shares[a : max(b, a + 1)].max()) * intensity for a, b in pairs]
    else:
        values = [float(levels[a : max(b, a + 1)].max()) for a, b in pairs]
    keyed = animation_frames(scene, every.astype(np.float64)).tolist()
    last_row = len(values) - 1
    # Inside a constant stretch keyframes are redundant.
    keys = [
        (frame, value)
        for k, (frame, value) in enumerate(zip(keyed, values, strict=True))
        if k in (0, last_row) or not values[k - 1] == value == values[k + 1]
    ]
    owners: list[tuple[bpy.types.ID, str]] = [(effect, f"hfx.{target.lower()}")]
    if target == "SPEAKER":
        owners = [(child.data, "volume") for child in effect.children if child.type == "SPEAKER"]
        if not owners:
            raise InputError(f"'{effect.name}' has no speaker. Parent one to it first.")
    for owner, path in owners:
        compat.set_keys(compat.own_fcurve(owner, path, "Response"), keys)
    if target == "INTENSITY":
        # The keyframes contain the response, so it must not apply again.
        for response_filter in effect.hfx.response:
            response_filter.is_muted = True
    effect.update_tag()
    return len(keys)
