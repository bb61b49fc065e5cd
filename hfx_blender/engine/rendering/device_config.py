# SPDX-License-Identifier: GPL-3.0-or-later
"""Description of a haptic device for rendering: facts only, as plain data.

The content follows HFX Studio's device configuration (Danieau et al., VRST 2018, section 3.3)
and Mango's hardware configuration file (Schneider et al., UIST 2015).
:mod:`hfx_blender.devices.configuration` reads it from a file.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import accumulate, pairwise
from pathlib import Path
from typing import Final, Literal, cast

import numpy as np

from ..arrays import F64, I64
from ..modality import MODALITIES
from .conditioning.drive import DriveCurve
from .conditioning.waveform import Waveform

Statistic = Literal["strongest", "mean"]
SchemeName = Literal[
    "coverage", "nearest", "barycentric", "surface", "ring", "line", "vbap", "splat"
]
Law = Literal["linear", "log", "power"]
LAWS: Final[tuple[Law, ...]] = ("linear", "log", "power")
NumberFormat = Literal["u8", "u16le", "u16be"]
Checksum = Literal["none", "xor", "sum"]

DEAD_MAN_MS: Final = 250
"""Time without valid values after which a board is silent until it is configured anew, ms."""


@dataclass(frozen=True)
class ActuatorControl:
    """Control parameter of an actuator, in the modality's own unit."""

    name: str  # of a parameter of the modality
    minimum: float  # range of the hardware
    maximum: float
    lowest: float  # allowed range: the range cut by the configured limits
    highest: float
    neutral: float  # value while nothing is rendered

    @property
    def reach(self) -> float:
        """Largest allowed deviation from neutral."""
        return max(self.highest - self.neutral, self.neutral - self.lowest)


@dataclass(frozen=True)
class ActuatorType:
    """A kind of actuator; its first control is the modality's strength."""

    name: str
    modality: str  # key of modality.MODALITIES
    controls: tuple[ActuatorControl, ...]
    latency_ms: float
    update_interval_ms: float
    slew_per_s: float = math.inf  # fastest rise of the strength, live
    maximum_on_s: float = math.inf  # longest that it is on without a rest, live
    rest_s: float = 1.0
    takes_waveform: bool = False  # driven as sound: plays the sum of all vibrations
    waveform: Waveform = "sine"  # of each of these
    resonance_hz: float | None = None  # plays what has no frequency of its own
    drive: tuple[DriveCurve, ...] = ()  # measured, by ascending frequency; none: proportional
    thresholds: tuple[tuple[float, float], ...] = ()  # (Hz, m/s^2) below which it is not felt

    @property
    def strength(self) -> ActuatorControl:
        """Control that makes the actuator feel stronger or weaker."""
        return self.controls[0]

    def unit(self, control: ActuatorControl) -> str:
        """Unit of one of the controls."""
        parameters = MODALITIES[self.modality].parameters
        return next(each.unit for each in parameters if each.name == control.name)


@dataclass(frozen=True)
class Scheme:
    """Rendering scheme, from felt intensity on the skin to gains of actuators: a name and its
    options.
    """

    name: SchemeName = "coverage"
    statistic: Statistic = "strongest"  # coverage
    law: Law = "log"  # barycentric, surface
    sigma_m: float = 0.02  # splat


@dataclass(frozen=True)
class Mount:
    """Mount of a layout of millimetres on the body, in rest space: flat, or bent."""

    origin_m: tuple[float, float, float]
    x_axis: tuple[float, float, float]  # unit, orthogonal
    y_axis: tuple[float, float, float]
    bend_radius_m: float | None = None  # of the cylinder along y; below 0: hollow; None: flat


@dataclass(frozen=True)
class VertexSet:
    """Vertices of one perceptual model."""

    model_id: str
    content_hash: str  # of the model that the ids were chosen on
    vertices: tuple[int, ...]


@dataclass(frozen=True)
class VertexPlace:
    """Vertices that an actuator reaches, named one by one for each model."""

    sets: tuple[VertexSet, ...]


@dataclass(frozen=True)
class BodyPlace:
    """A patch of skin: what lies in a ball, on certain parts and one side of the body.

    A device on which skin strokes, such as a phone, is felt by those parts as well.
    """

    parts: tuple[str, ...]
    centre_m: tuple[float, float, float]  # rest space
    radius_m: float
    side: str | None = None  # None: any
    stroked_by: tuple[str, ...] = ()  # all of these parts, on either side


@dataclass(frozen=True)
class RoomPlace:
    """Place in the room that touches no skin; meant for whole parts of the body.

    With a place it reaches what of them is in range and in its cone; without one, all of them.
    """

    parts: tuple[str, ...]
    at_m: tuple[float, float, float] | None = None  # in the play space
    aim: tuple[float, float, float] | None = None  # unit; None: all round
    range_m: float = math.inf
    cone_deg: float = 360.0  # full angle round the aim


Place = VertexPlace | BodyPlace | RoomPlace


@dataclass(frozen=True)
class Actuator:
    """Actuator with its type and place."""

    id: str
    type: ActuatorType
    place: Place


@dataclass(frozen=True)
class Substitution:
    """Substitution of one modality by another.

    ``strength of target = scale * strength of source``, where the strength of temperature is
    its deviation from neutral (its magnitude, unless temperature is shown as temperature).
    """

    source: str
    target: str
    scale: float  # unit of the target per unit of the source
    frequency_hz: float | None = None  # for vibration as target


@dataclass(frozen=True)
class Brand:
    """Brand of the device, and its identification on a bus."""

    vendor: str
    model: str
    usb: tuple[tuple[int, int], ...] = ()  # vendor id, product id
    serial: str = ""  # pattern of its serial number, with * and ?; empty: any


@dataclass(frozen=True)
class ScriptFiles:
    """Files of a device's script; others decide whether it may run."""

    script: Path
    configuration: Path
    device: Path  # as the device is loaded anew: with the side that it is worn on


@dataclass(frozen=True)
class SerialTransport:
    """A serial port, chosen when the device is connected."""

    baud: int


@dataclass(frozen=True)
class UdpTransport:
    """Datagrams to a host of this computer or its own network."""

    host: str
    port: int


@dataclass(frozen=True)
class WebsocketTransport:
    """A program on this computer or its own network that answers over a websocket."""

    host: str
    port: int


Transport = SerialTransport | UdpTransport | WebsocketTransport


@dataclass(frozen=True)
class WireEncoder:
    """The protocol of our own firmware (``docs/wire-protocol.md``)."""


@dataclass(frozen=True)
class BytesEncoder:
    """Binary frames: header, one number for each channel, checksum of the numbers, footer."""

    header: bytes
    number: NumberFormat
    full_scale: int  # encoded value of the end of a control's range; its beginning becomes 0
    checksum: Checksum
    footer: bytes
    stop: bytes | None  # None: the frame of all neutral values


@dataclass(frozen=True)
class TextEncoder:
    """Lines of decimal numbers, as simple sketches read them."""

    start: str
    separator: str
    full_scale: int
    stop: str | None


@dataclass(frozen=True)
class OscEncoder:
    """OSC 1.0 messages, one float for each channel."""

    addresses: tuple[str, ...]  # one template for all channels, or one for each
    is_fraction: bool  # 0..1 of the control's range; else the control's own unit
    is_bundle: bool  # all in one datagram


@dataclass(frozen=True)
class ButtplugEncoder:
    """Commands for one device of a Buttplug v4 server such as Intiface."""

    device_name: str  # how the server's name of the device begins; empty: the first that fits
    outputs: tuple[tuple[int, str], ...]  # for each actuator: feature, output type


_OTHER_SIDE: Final = {
    f"{part}{side}": f"{part}{other}"
    for part in ("Forearm", "Hand", "Glove", "Foot")
    for side, other in ("LR", "RL")
}


@dataclass(frozen=True)
class BhapticsEncoder:
    """Frames for the bHaptics Player (SDK1 messages)."""

    dots: tuple[tuple[str, int], ...]  # for each actuator: position, index

    def worn_dots(self, *, is_mirrored: bool) -> tuple[tuple[str, int], ...]:
        """Dots of a device on the side that it is worn on."""
        if not is_mirrored:
            return self.dots
        return tuple((_OTHER_SIDE.get(position, position), index) for position, index in self.dots)


Encoder = WireEncoder | BytesEncoder | TextEncoder | OscEncoder | ButtplugEncoder | BhapticsEncoder


@dataclass(frozen=True)
class OutputConfig:
    """Encoder and transport of a device."""

    encoder: Encoder
    transport: Transport


@dataclass(frozen=True, eq=False)
class DeviceConfig:
    """Configuration of one haptic device."""

    id: str
    name: str
    description: str
    actuator_types: Mapping[str, ActuatorType]
    actuators: tuple[Actuator, ...]
    scheme: Scheme
    substitutions: Mapping[str, Substitution]  # by source modality
    gain: float  # times every strength, before the limits
    mount: Mount | None = None  # of the plane in which a flat scheme pans
    brand: Brand | None = None
    width_m: float | None = None
    height_m: float | None = None
    side: str | None = None  # of the body that it is worn on, if it can change sides
    is_mirrored: bool = False  # places are written for the other side
    output: OutputConfig | None = None  # how it is driven live; None: not at all
    surface_drive_per_m: float | None = None  # c_v that the user set for it; None: the common one
    script: ScriptFiles | None = None  # beside its configuration; None: it has none

    def rendered_by(self, scheme: str) -> DeviceConfig:
        """Same device with another rendering scheme, of default options; empty: its own."""
        if not scheme or scheme == self.scheme.name:
            return self
        return replace(self, scheme=Scheme(cast(SchemeName, scheme)))

    @cached_property
    def controls(self) -> tuple[ActuatorControl, ...]:
        """Controls of all actuators, one after the other: one for each of its columns."""
        return tuple(c for actuator in self.actuators for c in actuator.type.controls)

    @cached_property
    def actuator_columns(self) -> tuple[slice, ...]:
        """Columns of each actuator; its strength comes first."""
        stops = accumulate(len(actuator.type.controls) for actuator in self.actuators)
        return tuple(slice(first, stop) for first, stop in pairwise((0, *stops)))

    @property
    def strength_columns(self) -> I64:
        """Column of each actuator's strength, (A,)."""
        return np.array([part.start for part in self.actuator_columns], np.int64)

    @property
    def neutral(self) -> F64:
        """Silence, (columns,), each in its control's unit; a copy that may be changed."""
        return np.array([control.neutral for control in self.controls], np.float64)

    @property
    def modalities(self) -> tuple[str, ...]:
        """Modalities of the actuators, without substitutions."""
        return tuple(dict.fromkeys(each.type.modality for each in self.actuators))
