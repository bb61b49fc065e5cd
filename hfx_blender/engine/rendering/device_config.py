# SPDX-License-Identifier: GPL-3.0-or-later
"""Configuration of a haptic device, for rendering and output: facts as plain data.

After HFX Studio's device configuration (Danieau et al., VRST 2018, section 3.3) and Mango's
hardware configuration file (Schneider et al., UIST 2015). :mod:`hfx_blender.devices.configuration`
reads it from a file, :mod:`hfx_blender.devices.host.opening` opens its output. Serial ports and log
files are chosen when a device is connected, never here.
"""

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
from .conditioning.waveform import DriveCurve, Waveform

Statistic = Literal["strongest", "mean"]
_Panning = Literal["nearest", "barycentric", "surface", "ring", "line", "vbap", "splat"]
SchemeName = Literal["coverage", _Panning, "brush", "saltation"]
Law = Literal["linear", "log", "power"]
LAWS: Final[tuple[Law, ...]] = ("linear", "log", "power")
NumberFormat = Literal["u8", "u16le", "u16be"]
Checksum = Literal["none", "xor", "sum"]

DEAD_MAN_MS: Final = 250
"""Time without valid values after which a board stays silent until its next configuration, ms."""


@dataclass(frozen=True)
class ActuatorControl:
    """Control parameter of an actuator, in the unit of the modality's parameter or its own."""

    name: str  # name of the modality's parameter, or of a custom control
    minimum: float  # range of the hardware
    maximum: float
    lowest: float  # allowed range: that of the hardware within configured limits
    highest: float
    neutral: float  # value in silence
    values: tuple[float, ...] = ()  # allowed values within limits, ascending; (): all
    unit: str = ""  # of a custom control
    choices: tuple[str, ...] = ()  # of a custom control: the value is an index

    @property
    def reach(self) -> float:
        """Largest allowed deviation from neutral, in either direction."""
        return max(self.highest - self.neutral, self.neutral - self.lowest)


@dataclass(frozen=True)
class ActuatorType:
    """Kind of actuator; the first control is the modality's strength. Custom controls, which only
    a script sets, follow those of the modality."""

    name: str
    modality: str  # key of modality.MODALITIES
    controls: tuple[ActuatorControl, ...]
    latency_ms: float
    update_interval_ms: float
    slew_per_s: float = math.inf  # largest rate of the strength, live only
    maximum_on_s: float = math.inf  # longest time on without a rest, live only
    rest_s: float = 1.0
    takes_waveform: bool = False  # driven as sound by the sum of all vibrations
    waveform: Waveform = "sine"  # of each vibration
    is_tone_pair: bool = False  # the waveform has 40 Hz and 320 Hz instead of each frequency
    resonance_hz: float | None = None  # for effects without a frequency
    drive: tuple[DriveCurve, ...] = ()  # by ascending frequency; empty: proportional
    thresholds: tuple[tuple[float, float], ...] = ()  # detection thresholds (Hz, m/s^2)
    # A person's "first felt" and "strong enough", and the strength that is played as the latter.
    marks: tuple[float, float, float] | None = None

    @property
    def strength(self) -> ActuatorControl:
        """First control: the modality's strength."""
        return self.controls[0]

    @property
    def modality_controls(self) -> tuple[ActuatorControl, ...]:
        """Controls without the custom ones, which alone have a unit of their own."""
        return tuple(control for control in self.controls if not control.unit)

    @property
    def is_stepped(self) -> bool:
        """True if a parameter has a list of allowed values."""
        return any(control.values for control in self.controls)

    def unit(self, control: ActuatorControl) -> str:
        """Unit of a control's parameter, such as "m/s^2"."""
        parameters = MODALITIES[self.modality].parameters
        return next((x.unit for x in parameters if x.name == control.name), control.unit)


@dataclass(frozen=True)
class Scheme:
    """Rendering scheme, from intensity on the skin to gains of actuators, with options."""

    name: SchemeName = "coverage"
    statistic: Statistic = "strongest"  # coverage
    law: Law = "log"  # barycentric, surface
    sigma_m: float = 0.02  # splat
    duration_ms: float = 160.0  # brush: of each burst, which sets the interval of onsets
    interval_ms: float = 50.0  # saltation: from tap to tap
    tap_ms: float = 20.0  # saltation: of each tap


@dataclass(frozen=True)
class Mount:
    """Placement of a layout in millimetres on the body, rest space: flat or bent to a cylinder."""

    origin_m: tuple[float, float, float]
    x_axis: tuple[float, float, float]  # unit, orthogonal
    y_axis: tuple[float, float, float]
    bend_radius_m: float | None = None  # cylinder along y; negative: hollow; None: flat


@dataclass(frozen=True)
class VertexSet:
    """Vertices of one perceptual model."""

    model_id: str
    content_hash: str  # hash of the model with these ids
    vertices: tuple[int, ...]


@dataclass(frozen=True)
class VertexPlace:
    """Listed vertices that an actuator reaches, for one or several models."""

    sets: tuple[VertexSet, ...]


@dataclass(frozen=True)
class BodyPlace:
    """Patch of skin: a ball, restricted to parts and a side of the body. ``stroked_by`` names parts
    that stroke over the device, as fingers over a phone, and feel the effect too."""

    parts: tuple[str, ...]
    centre_m: tuple[float, float, float]  # rest space
    radius_m: float
    side: str | None = None  # None: any
    stroked_by: tuple[str, ...] = ()  # whole parts, on both sides


@dataclass(frozen=True)
class RoomPlace:
    """Place in the room for whole parts of the body. With ``at_m`` only skin within range and cone
    is reached, without it all of the parts."""

    parts: tuple[str, ...]
    at_m: tuple[float, float, float] | None = None  # in the play space
    aim: tuple[float, float, float] | None = None  # unit; None: all directions
    range_m: float = math.inf
    cone_deg: float = 360.0  # full angle about the aim


Place = VertexPlace | BodyPlace | RoomPlace


@dataclass(frozen=True)
class Actuator:
    """Actuator with type and place."""

    id: str
    type: ActuatorType
    place: Place


@dataclass(frozen=True)
class Substitution:
    """Replacement of a modality by another. ``strength of target = scale * strength of source``.
    The strength of temperature is its deviation from neutral, as a magnitude unless the target is
    temperature, too."""

    source: str
    target: str
    scale: float  # unit of the target per unit of the source
    frequency_hz: float | None = None  # for vibration as target


@dataclass(frozen=True)
class Brand:
    """Maker and model of a device, and identification on a bus."""

    vendor: str
    model: str
    usb: tuple[tuple[int, int], ...] = ()  # vendor id, product id
    serial: str = ""  # pattern of serial numbers with * and ?; empty: any


@dataclass(frozen=True)
class ScriptFiles:
    """Files of a device's script; permission to run is decided elsewhere."""

    script: Path
    configuration: Path
    device: Path  # configuration with the side on which the device is worn


@dataclass(frozen=True)
class SerialTransport:
    """Serial port, chosen when the device is connected."""

    baud: int


@dataclass(frozen=True)
class UdpTransport:
    """Datagrams to a host: this computer or the local network."""

    host: str
    port: int


@dataclass(frozen=True)
class WebsocketTransport:
    """Websocket server on this computer or the local network."""

    host: str
    port: int


Transport = SerialTransport | UdpTransport | WebsocketTransport


@dataclass(frozen=True)
class WireEncoder:
    """Protocol of the project's firmware (``docs/wire-protocol.md``)."""


@dataclass(frozen=True)
class BytesEncoder:
    """Binary frames: header, a number for each channel, checksum of the numbers, footer."""

    header: bytes
    number: NumberFormat
    full_scale: int  # encoded maximum of a control's range; the minimum is 0
    checksum: Checksum
    footer: bytes
    stop: bytes | None  # None: a frame of neutral values


@dataclass(frozen=True)
class TextEncoder:
    """Lines of decimal numbers for simple sketches."""

    start: str
    separator: str
    full_scale: int
    stop: str | None


@dataclass(frozen=True)
class OscEncoder:
    """OSC 1.0 messages, a float for each channel."""

    addresses: tuple[str, ...]  # one template for all channels, or an address for each
    is_fraction: bool  # 0..1 of the control's range, else in the control's unit
    is_bundle: bool  # all messages in one datagram


@dataclass(frozen=True)
class ButtplugEncoder:
    """Commands for a device of a Buttplug v4 server such as Intiface."""

    device_name: str  # prefix of the server's name; empty: first fitting device
    outputs: tuple[tuple[int, str], ...]  # for each actuator: feature, output type


_OTHER_SIDE: Final = {
    f"{part}{side}": f"{part}{other}"
    for part in ("Forearm", "Hand", "Glove", "Foot")
    for side, other in ("LR", "RL")
}


@dataclass(frozen=True)
class BhapticsEncoder:
    """Frames for the bHaptics Player."""

    dots: tuple[tuple[str, int], ...]  # for each actuator: position, index
    sdk: int = 1  # messages of the first or second SDK

    def worn_dots(self, *, is_mirrored: bool) -> tuple[tuple[str, int], ...]:
        """Dots as configured or, if mirrored, of the opposite position (L for R)."""
        # The Player knows gloves, sleeves and shoes by side, not one device on either side.
        if not is_mirrored:
            return self.dots
        return tuple((_OTHER_SIDE.get(position, position), index) for position, index in self.dots)


@dataclass(frozen=True)
class VrcHapticsEncoder:
    """Values of all motors of a board with the firmware of VRC Haptics, in the board's order."""


Encoder = (
    WireEncoder
    | BytesEncoder
    | TextEncoder
    | OscEncoder
    | ButtplugEncoder
    | BhapticsEncoder
    | VrcHapticsEncoder
)


@dataclass(frozen=True)
class OutputConfig:
    """Encoder and transport of a device, or of some of its actuators."""

    encoder: Encoder
    transport: Transport
    actuators: tuple[int, ...] = ()  # indices, in the order of the channels; (): all


@dataclass(frozen=True, eq=False)
class DeviceConfig:
    """Configuration of a haptic device."""

    id: str
    name: str
    description: str
    actuator_types: Mapping[str, ActuatorType]
    actuators: tuple[Actuator, ...]
    scheme: Scheme
    substitutions: Mapping[str, Substitution]  # by source modality
    gain: float  # factor of every strength, before limits
    mount: Mount | None = None  # plane of a flat scheme; None: fitted to the actuators
    brand: Brand | None = None
    width_m: float | None = None
    height_m: float | None = None
    side: str | None = None  # side of the body; None: fixed
    is_mirrored: bool = False  # places are written for the opposite side
    outputs: tuple[OutputConfig, ...] = ()  # live outputs, each actuator in one; (): none
    surface_drive_per_m: float | None = None  # c_v of this device; None: the common c_v
    script: ScriptFiles | None = None  # None: no script

    @property
    def output(self) -> OutputConfig | None:
        """Output of a device with exactly one output; else None."""
        return self.outputs[0] if len(self.outputs) == 1 else None

    @cached_property
    def parts(self) -> "tuple[DeviceConfig, ...]":
        """Device for each output, with the actuators of this output only; the device itself if it
        has one output, empty if it has none."""
        if len(self.outputs) < 2:
            return (self,) * len(self.outputs)
        return tuple(
            replace(
                self,
                actuators=tuple(self.actuators[k] for k in output.actuators),
                outputs=(replace(output, actuators=()),),
            )
            for output in self.outputs
        )

    def rendered_by(self, scheme: str) -> "DeviceConfig":
        """Device with another scheme of default options; unchanged for "" or the present scheme."""
        if not scheme or scheme == self.scheme.name:
            return self
        return replace(self, scheme=Scheme(cast(SchemeName, scheme)))

    @cached_property
    def controls(self) -> tuple[ActuatorControl, ...]:
        """Controls of all actuators, actuator by actuator: a control for each raster column."""
        return tuple(c for actuator in self.actuators for c in actuator.type.controls)

    @cached_property
    def actuator_columns(self) -> tuple[slice, ...]:
        """Slice of the raster columns of each actuator, strength first."""
        # Actuators have different numbers of controls, so columns are counted up.
        stops = accumulate(len(actuator.type.controls) for actuator in self.actuators)
        return tuple(slice(first, stop) for first, stop in pairwise((0, *stops)))

    @property
    def strength_columns(self) -> I64:
        """Column of each actuator's strength, (A,)."""
        return np.array([part.start for part in self.actuator_columns], np.int64)

    @property
    def neutral(self) -> F64:
        """Neutral value of each column, (columns,), in its unit; a new array."""
        return np.array([control.neutral for control in self.controls], np.float64)

    @property
    def modalities(self) -> tuple[str, ...]:
        """Distinct modalities of the actuators, by first actuator, without substitutions."""
        return tuple(dict.fromkeys(actuator.type.modality for actuator in self.actuators))
