# SPDX-License-Identifier: GPL-3.0-or-later
"""Output of a device, its connection and encoding: facts only, as plain data.

:mod:`hfx_blender.devices.configurations.output_reader` reads them;
:mod:`hfx_blender.devices.host.opening` acts on them. A configuration never names a serial port or a
file: who connects a device does.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

NumberFormat = Literal["u8", "u16le", "u16be"]
Checksum = Literal["none", "xor", "sum"]

DEAD_MAN_MS: Final = 250
"""Time without valid values after which a board is silent until it is configured anew, ms."""


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
