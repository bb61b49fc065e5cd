# SPDX-License-Identifier: GPL-3.0-or-later
"""Devices for output tests, built from plain data."""

from hfx_blender.engine.rendering.device_config import (
    Actuator,
    ActuatorControl,
    ActuatorType,
    DeviceConfig,
    RoomPlace,
    Scheme,
)


def vibration(maximum=10.0, highest=None, fixed=False, **limits):
    """Return a motor with amplitude and frequency."""
    top = 175.0 if fixed else 250.0
    low = 175.0 if fixed else 50.0
    return ActuatorType(
        "motor",
        "vibration",
        (
            ActuatorControl("amplitude_m_s2", 0.0, maximum, 0.0, highest or maximum, 0.0),
            ActuatorControl("frequency_hz", low, top, low, top, 175.0 if fixed else 100.0),
        ),
        latency_ms=0.0,
        update_interval_ms=10.0,
        **limits,
    )


def heat():
    """Return a thermal element with the neutral value in the middle of the range."""
    control = ActuatorControl("temperature_c", 14.0, 44.0, 15.0, 40.0, 29.0)
    return ActuatorType("element", "temperature", (control,), 0.0, 100.0)


def device(*types, outputs=(), **facts):
    """Return a device with one actuator of each type, named a0, a1, ..."""
    actuators = tuple(Actuator(f"a{i}", kind, RoomPlace(())) for i, kind in enumerate(types))
    return DeviceConfig(
        id=facts.pop("id", "bench"),
        name="Bench",
        description="",
        actuator_types={kind.name: kind for kind in types},
        actuators=actuators,
        scheme=Scheme(),
        substitutions={},
        gain=1.0,
        outputs=outputs,
        **facts,
    )
