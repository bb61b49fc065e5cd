# SPDX-License-Identifier: GPL-3.0-or-later
"""Egocentric areas: samples of effects on the body itself."""

from dataclasses import replace

import numpy as np

from ..active_rows import ActiveEffect, posed_rows, with_pose
from ..response.touches import packed
from ..samples import Drive, SampleRun
from ..scene import ActuatorArea, PaintedArea, SpotArea
from . import spot
from .sample_run_builder import SampleRunBuilder


class EgocentricAreas:
    """Sample runs of painted areas, spots on the skin, and single actuators."""

    def __init__(self, builder: SampleRunBuilder) -> None:
        self._builder = builder
        self._spots: dict[str, spot.SpotSkin] = {}

    def painted(self, active: ActiveEffect, area: PaintedArea) -> SampleRun | None:
        """Run of a painted area at the active rows, all with the same vertices; None without a row
        of known pose. Poses count only if motion is recorded. Raises ValueError: motion is
        recorded, but the reader did not read poses."""
        rows = active.rows
        if self._builder.wants_motion:
            k = self._builder.body_index[area.body_id]
            body, pose = self._builder.scene.bodies[k], active.block.poses[k]
            if not pose.valid[rows].all():
                raise ValueError("positions of painted vertices need a reader with_positions")
            rows = with_pose(rows, posed_rows(pose), body, self._builder.counters, needs_pose=True)
            if not len(rows):
                return None
        # Recorded positions differ per row, so each row has a set; otherwise one set serves all.
        sets = np.arange(len(rows)) if self._builder.record else np.zeros(len(rows), np.int64)
        count = int(sets[-1]) + 1
        offsets = np.arange(count + 1, dtype=np.int64) * len(area.vertices)
        vertices = np.tile(area.vertices, count)
        return self._builder.run(
            replace(active, rows=rows),
            area.body_id,
            sets=sets,
            offsets=offsets,
            vertices=vertices,
            weights=np.tile(area.weights, count),
        )

    def spot(self, active: ActiveEffect, area: SpotArea) -> SampleRun | None:
        """Run of a spot moving on the skin, at active rows with finite position and radius; None
        without any, or, if motion is recorded, without a known pose."""
        effect, animated = active.effect, active.animated
        rows, focus = spot.focus_of(
            effect.name, area, animated, active.rows, self._builder.counters
        )
        if self._builder.wants_motion:
            k = self._builder.body_index[area.body_id]
            body, pose = self._builder.scene.bodies[k], active.block.poses[k]
            posed = with_pose(rows, posed_rows(pose), body, self._builder.counters, needs_pose=True)
            rows, focus = posed, focus[np.isin(rows, posed)]
        if not len(rows):
            return None
        if effect.model_id not in self._spots:
            self._spots[effect.model_id] = spot.SpotSkin(self._builder.skins.model(effect.model_id))
        assert animated.place is not None
        radii_m = np.maximum(animated.place[rows, 1], 0.0)
        weighted = self._spots[effect.model_id].sets(focus, radii_m, area.falloff)
        own_sets = bool(self._builder.record)
        sets, offsets, vertices, weights = packed(weighted, own_sets=own_sets)
        return self._builder.run(
            replace(active, rows=rows),
            area.body_id,
            sets=sets,
            offsets=offsets,
            vertices=vertices,
            weights=weights,
            focus=focus,
        )

    def actuators(self, active: ActiveEffect, area: ActuatorArea) -> SampleRun | None:
        """Run of actuator values, clipped to 0..1, without vertices, at rows with a value above 0;
        None without any. Rows with NaN are silent, with a warning. Vector sensations of Schneider
        et al., UIST 2015: a curve per actuator, without rendering scheme. Other effects add on the
        device; limits of the device apply."""
        assert active.animated.drive is not None
        values = active.animated.drive[active.rows]
        is_known = np.isfinite(values).all(axis=1)
        if not is_known.all():
            self._builder.counters.warn(
                f"effect '{active.effect.name}': an actuator's value is not a finite number; "
                "it is silent there",
                int(np.count_nonzero(~is_known)),
            )
        values = np.clip(np.where(is_known[:, None], values, 0.0), 0.0, 1.0).astype(np.float32)
        is_on = (values > 0.0).any(axis=1)
        rows = active.rows[is_on]
        if not len(rows):
            return None
        # Runs without vertices still need a set, or one per row if fields are recorded.
        count = len(rows) if self._builder.record else 1
        return self._builder.run(
            replace(active, rows=rows),
            area.body_id,
            sets=np.minimum(np.arange(len(rows)), count - 1),
            offsets=np.zeros(count + 1, np.int64),
            vertices=np.zeros(0, np.int32),
            weights=np.zeros(0, np.float32),
            drive=Drive(area.device_id, area.actuators, values[is_on]),
        )
