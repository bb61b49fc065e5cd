# SPDX-License-Identifier: GPL-3.0-or-later
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hfx_blender.engine.volume.shape import Falloff, FalloffKind

RISE = np.array([0.0, 0.125, 0.25, 0.5, 1.0])


@pytest.mark.parametrize(
    ("falloff", "expected"),
    [
        (Falloff(), [1, 1, 1, 1, 1]),
        (Falloff(FalloffKind.NONE, 0.5), [1, 1, 1, 1, 1]),
        (Falloff(FalloffKind.LINEAR, 0.0), [1, 1, 1, 1, 1]),
        (Falloff(FalloffKind.LINEAR), [0, 0.125, 0.25, 0.5, 1]),
        (Falloff(FalloffKind.LINEAR, 0.25), [0, 0.5, 1, 1, 1]),
        # 3 t^2 - 2 t^3 at t = 1/8, 1/4, 1/2
        (Falloff(FalloffKind.SMOOTH), [0, 0.04296875, 0.15625, 0.5, 1]),
        (Falloff(FalloffKind.SMOOTH, 0.5), [0, 0.15625, 0.5, 1, 1]),
    ],
)
def test_values_by_hand(falloff, expected):
    np.testing.assert_allclose(falloff.weight(RISE), expected, rtol=0, atol=1e-15)


@given(
    kind=st.sampled_from(FalloffKind),
    share=st.floats(0.0, 1.0),
    rise=st.lists(st.floats(-1.0, 1.0), min_size=2, max_size=9),
)
def test_never_falls_towards_the_core(kind, share, rise):
    weight = Falloff(kind, share).weight(np.sort(rise))
    assert np.all(np.diff(weight) >= 0.0) and np.all((weight >= 0.0) & (weight <= 1.0))
    assert Falloff(kind, share).weight(np.ones(1))[0] == 1.0
