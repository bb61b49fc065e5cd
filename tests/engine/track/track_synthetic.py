# SPDX-License-Identifier: GPL-3.0-or-later
"""Headers and samples for the tests of tracks, without a scene."""

from fractions import Fraction

import numpy as np

from hfx_blender.engine.modality import MODALITIES
from hfx_blender.engine.samples import SampleRun, Stream
from hfx_blender.engine.scene import Clip, TimeBase
from hfx_blender.engine.track import TrackBody, TrackEffect, TrackHeader, TrackModel

BODIES = (TrackBody("b1", "Anna"), TrackBody("b2", "Bär\udc80"))  # names may be broken UTF-8


def header(
    sample_count=1000, vertex_count=2000, modalities=("vibration", "temperature"), bodies=BODIES
):
    """Return a header with a volume effect per modality on every body; 60 samples a second."""
    effects = tuple(
        TrackEffect(
            id=f"e{k}",
            name=f"effect {k}",
            modality=name,
            kind="volume",
            model_id="m",
            is_contact=name == "temperature",
            clips=(Clip("a", 1.5, 20.0),),
        )
        for k, name in enumerate(modalities)
    )
    return TrackHeader(
        time=TimeBase(Fraction(60000, 1001), Fraction(60000, 1001), 1, 11, 10 + sample_count),
        models=(TrackModel("m", "pressure", "0" * 64, vertex_count),),
        bodies=bodies,
        effects=effects,
        streams=tuple(Stream(e.id, b.id, e.modality, "m") for e in effects for b in bodies),
        source={"name": "garage.blend", "sha256": "ab" * 32},
        settings={"tolerance": "standard", "deep": {"list": [1, 2.5, None, True]}},
        tools={"hfx": "0.1.0"},
        warnings=("something is hidden",),
    )


def run(track_header, stream, indices, sets, weights, levels=None, parameters=None, **channels):
    """Return a run from lists; ``sets`` and ``weights`` hold one array for each sample."""
    indices = np.asarray(indices, np.int64)
    count = len(indices)
    columns = len(MODALITIES[track_header.streams[stream].modality].parameters)
    return SampleRun(
        stream=track_header.streams[stream],
        indices=indices,
        times_s=track_header.time.times_s(indices),
        levels=np.ones(count) if levels is None else np.asarray(levels, np.float64),
        parameters=np.ones((count, columns)) if parameters is None else parameters,
        offsets=np.concatenate(([0], np.cumsum([len(indices) for indices in sets]))).astype(
            np.int64
        ),
        vertices=np.concatenate([[], *sets]).astype(np.int32),
        weights=np.concatenate([[], *weights]).astype(np.float32),
        **channels,
    )


def cut(whole, first, last):
    """Return the samples ``first`` to ``last - 1`` of a run."""
    low, high = whole.offsets[first], whole.offsets[last]
    channels = ("positions", "velocities", "depth_m")
    return SampleRun(
        stream=whole.stream,
        indices=whole.indices[first:last],
        times_s=whole.times_s[first:last],
        levels=whole.levels[first:last],
        parameters=whole.parameters[first:last],
        offsets=whole.offsets[first : last + 1] - low,
        vertices=whole.vertices[low:high],
        weights=whole.weights[low:high],
        **{
            name: None if getattr(whole, name) is None else getattr(whole, name)[low:high]
            for name in channels
        },
    )


def quantised(weights):
    """Return weights rounded to 8 bits, independent of the code under test."""
    return np.array([np.float32(max(1, round(float(w) * 255)) / 255) for w in weights], np.float32)


def rows(runs):
    """Return comparable values of every sample of some runs, keyed by stream and index."""
    rows_by_key = {}
    for item in runs:
        for k, sample in enumerate(item):
            key = (item.stream.effect_id, item.stream.body_id, int(item.indices[k]))
            assert key not in rows_by_key
            rows_by_key[key] = tuple(
                None if value is None else np.asarray(value).tobytes()
                for value in (
                    sample.time_s,
                    sample.level,
                    sample.parameters,
                    sample.vertices,
                    sample.weights,
                    sample.positions,
                    sample.velocities,
                    sample.depth_m,
                )
            )
    return rows_by_key


def body_points(spacing_m=0.012):
    """Return points on a body of capsules, (V, 3) metres, in a spatially coherent order."""
    points = []
    for low, high, radius in (
        ((0.0, 0.0, 0.9), (0.0, 0.0, 1.45), 0.17),
        ((0.0, 0.0, 1.6), (0.0, 0.0, 1.7), 0.10),
        ((0.25, 0.0, 1.4), (0.3, 0.0, 0.75), 0.045),
        ((-0.25, 0.0, 1.4), (-0.3, 0.0, 0.75), 0.045),
        ((0.1, 0.0, 0.05), (0.1, 0.0, 0.85), 0.075),
        ((-0.1, 0.0, 0.05), (-0.1, 0.0, 0.85), 0.075),
    ):
        axis = np.subtract(high, low)
        length = np.linalg.norm(axis)
        count = int(2 * np.pi * radius * length / spacing_m**2)
        along = (np.arange(count) + 0.5) / count
        angle = np.arange(count) * np.pi * (3 - np.sqrt(5))  # golden angle: even spacing
        side = np.cross(axis / length, (1.0, 0.3, 0.0))
        side /= np.linalg.norm(side)
        second = np.cross(axis / length, side)
        ring = np.outer(np.cos(angle), side) + np.outer(np.sin(angle), second)
        points.append(low + np.outer(along, axis) + radius * ring)
    body = np.vstack(points)
    cells = ((body - body.min(axis=0)) * 512).astype(np.int64)  # Morton order of 2 mm cells
    bits = np.arange(10)[:, None, None]
    code = (((cells >> bits) & 1) << (3 * bits + np.arange(3))).sum(axis=(0, 2))
    return body[np.argsort(code, kind="stable")]


def walking_contact(points, index, with_falloff, spacing_m=0.012):
    """Return vertices and weights at a sample (60 a second) of a body walking in a sphere.

    The body walks to and fro at up to 1 m/s with swinging arms and legs. The weight is the covered
    fraction of the cell, times a linear falloff to the sphere's centre if requested.
    """
    time_s = index / 60.0
    x, y, z = points.T
    hinge = np.where(z < 0.85, 0.85 - z, np.where(np.abs(x) > 0.2, -0.7 * (1.4 - z), 0.0))
    y = y + 0.4 * np.sin(2 * np.pi * time_s) * np.sign(x) * hinge + 0.4 * np.sin(2.5 * time_s)
    z = z + 0.02 * np.cos(4 * np.pi * time_s)
    depth = 0.38 - np.sqrt((x - 0.1) ** 2 + y**2 + (z - 1.1) ** 2)
    weights = np.clip(depth / spacing_m + 0.5, 0.0, 1.0)
    if with_falloff:
        weights = weights * np.clip(depth / 0.38, 0.0, 1.0)
    samples = np.flatnonzero(weights.astype(np.float32) > 0)
    return samples.astype(np.int32), weights[samples].astype(np.float32)
