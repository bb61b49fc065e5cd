# SPDX-License-Identifier: GPL-3.0-or-later
"""Opening of a device's output: encoder as configured, port or log as the target says."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from ...engine.rendering import device_config
from ..configurations.configuration_reader import is_local
from ..transports.log_outputs import CsvLog, Simulator
from ..transports.serial_port import SerialFrames, SerialPort
from .encoders import FrameEncoder
from .joined_outputs import JoinedOutputs
from .output import Output, OutputLostError

KINDS: Final = ("serial", "udp", "websocket", "csv", "audio", "page")


def open_output(device: device_config.DeviceConfig, target: Mapping[str, Any]) -> Output:
    """Open a device's output; may take seconds, as a board has to start.

    ``target``: ``kind`` and its entries:

    - ``simulator``: optional ``path`` of a log. For all devices.
    - ``csv``: ``path`` of a new log. For all devices.
    - ``audio``: optional ``interface`` and ``first_channel``. For devices that vibrate.
    - ``page``: ``host``, the own address of the page; optional ``port``, ``code`` and ``waits``.
      For devices that vibrate.
    - ``serial``: ``port``.
    - ``several``: ``outputs``, a target for each output of the device.
    - ``udp``, ``websocket``: optional ``host`` and ``port``, by default as configured;
      ``unit`` chooses among several devices of a server.

    Raises OutputLostError: the target is invalid, does not fit the device, or cannot be opened.
    """
    kind, path = target.get("kind"), target.get("path")
    if kind == "simulator":
        return Simulator(None if path is None else Path(str(path)))
    if kind == "csv":
        if not isinstance(path, str | Path) or not str(path):
            raise OutputLostError("A CSV log needs the path of a new file.")
        return CsvLog(device, Path(path))
    if kind == "audio":
        from ..transports.sound_card import SoundCard

        interface, first = target.get("interface", ""), target.get("first_channel", 1)
        if not isinstance(interface, str):
            raise OutputLostError("The name of a sound card must be text.")
        if isinstance(first, bool) or not isinstance(first, int) or not 1 <= first <= 1000:
            raise OutputLostError(f"'{str(first)[:20]}' is no channel; allowed is 1 to 1000.")
        return SoundCard(device, interface, first)
    if kind == "page":
        from ..transports.page_output import PageOutput

        port = target.get("port")
        if port is not None and (type(port) is not int or not 0 <= port <= 65535):
            raise OutputLostError(f"'{str(port)[:20]}' is no port; allowed is 0 to 65535.")
        host, code = str(target.get("host", "127.0.0.1")), str(target.get("code", ""))
        return PageOutput(device, host, port, code, waits=bool(target.get("waits")))
    targets = targets_of(target)
    if len(targets) != max(len(device.parts), 1):
        text = f"Device '{device.name}' has {len(device.parts)} outputs; {len(targets)} are given."
        raise OutputLostError(text)
    if kind == "several":
        return JoinedOutputs(device, lambda k: _open_part(device.parts[k], targets[k]))
    return _open_part(device, target)


def targets_of(target: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """Target of each output: those of the kind ``several``, else the target itself."""
    if target.get("kind") != "several":
        return [target]
    outputs = target.get("outputs")
    return [x for x in outputs if isinstance(x, dict)] if isinstance(outputs, list) else []


def _open_part(device: device_config.DeviceConfig, target: Mapping[str, Any]) -> Output:
    """Open the only output of a device by its target; errors as of :func:`open_output`."""
    kind = target.get("kind")
    if kind not in KINDS:
        raise OutputLostError(f"'{kind}' is not a kind of output; there are: {', '.join(KINDS)}.")
    if kind != kind_of(device):
        named = kind_of(device) or "none"
        raise OutputLostError(f"Device '{device.name}' is connected by: {named}; not by {kind}.")
    return _serial(device, target) if kind == "serial" else _network(device, target)


def kind_of(device: device_config.DeviceConfig) -> str | None:
    """Kind of target of a device's configured output: serial, udp or websocket; None without."""
    if device.output is None:
        return None
    if isinstance(device.output.transport, device_config.SerialTransport):
        return "serial"
    return "udp" if isinstance(device.output.transport, device_config.UdpTransport) else "websocket"


def _serial(device: device_config.DeviceConfig, target: Mapping[str, Any]) -> Output:
    """Open the serial port ``port`` of a target for a device with a serial transport, and choose
    the output by its encoder. OutputLostError as of :class:`SerialPort` or the board."""
    assert device.output is not None
    how, transport = device.output.encoder, device.output.transport
    assert isinstance(transport, device_config.SerialTransport)
    port = SerialPort(str(target.get("port")), transport.baud)
    if isinstance(how, device_config.WireEncoder):
        from ..transports.wire_board import WireBoard

        return WireBoard(device, port)
    assert isinstance(how, device_config.BytesEncoder | device_config.TextEncoder)
    return SerialFrames(port, FrameEncoder(device, how))


def _network(device: device_config.DeviceConfig, target: Mapping[str, Any]) -> Output:
    """Connect by OSC, VRC Haptics, Buttplug or bHaptics, as the encoder says, to host and port of a
    target, by default those of the device's transport. OutputLostError: the host is not local, the
    port is not 1 to 65535, or no connection."""
    assert device.output is not None
    how, transport = device.output.encoder, device.output.transport
    assert not isinstance(transport, device_config.SerialTransport)
    # Hosts on the internet are refused, also from a settings file edited by hand.
    host = target.get("host", transport.host)
    port = target.get("port", transport.port)
    is_announced = host == "" and isinstance(how, device_config.VrcHapticsEncoder)
    if not isinstance(host, str) or not (is_announced or is_local(host)):
        raise OutputLostError(
            f"'{str(host)[:60]}' is neither localhost nor an address of a private network."
        )
    if isinstance(port, bool) or not isinstance(port, int) or not 1 <= port <= 65535:
        raise OutputLostError(f"'{str(port)[:20]}' is no port; allowed is 1 to 65535.")
    if isinstance(how, device_config.OscEncoder):
        from ..transports.osc import OscOutput

        return OscOutput(device, how, host, port)
    if isinstance(how, device_config.VrcHapticsEncoder):
        from ..transports.vrc_haptics import VrcHapticsOutput

        return VrcHapticsOutput(device, host, port, str(target.get("unit", "")))
    if isinstance(how, device_config.ButtplugEncoder):
        from ..transports.buttplug import ButtplugOutput

        return ButtplugOutput(device, how, host, port, str(target.get("unit", "")))
    assert isinstance(how, device_config.BhapticsEncoder)
    from ..transports.bhaptics import BhapticsOutput

    return BhapticsOutput(device, how, host, port)
