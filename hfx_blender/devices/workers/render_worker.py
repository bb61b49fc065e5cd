# SPDX-License-Identifier: GPL-3.0-or-later
"""Renders moments for all devices, in a process of its own: no frame of Blender's waits for it.

Started by the output process. It is told
one scene or one moment at a time and says READY after each. What device a fault belongs to, it
tells; the others go on.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from ...engine.arrays import F64
from ...engine.modality import MODALITIES
from ...engine.rendering.device_config import DeviceConfig
from ...engine.rendering.moment import MomentRenderer
from ...processes.messages import EVERY_DEVICE, Message, MessageError, MessageKind, message
from ...processes.worker import Owner
from ..configuration import load_device
from ..host.tones import Tones, frame_of, of_partials
from .haptics import encode_haptics
from .live_frame import LiveFrame, RenderedDevice, SceneMessage, decode_live_frame, decode_scene
from .message_bodies import encode_values

_log = logging.getLogger(__name__)

_LONGEST_TEXT: Final = 500


@dataclass(eq=False)
class _Rendered:
    """Device with its renderer."""

    rendered: RenderedDevice
    device: DeviceConfig
    renderer: MomentRenderer
    numbers: dict[str, int]  # of tones, by effect or by the modality that is substituted
    width: int  # actuators that take a waveform

    def answer(self, moment: LiveFrame) -> bytes:
        """Message for the device's thread, or for its script."""
        if moment.play_space is not None:
            self.renderer.move_play_space(moment.play_space)
        values, partials = self.renderer.ahead(moment.runs, moment.later)
        gain = moment.gains.get(self.rendered.number, 1.0)
        values = with_gain(values, self.device, gain)
        if self.rendered.has_script and gain:  # a muted script is not called
            felt = self.renderer.felt(moment.runs)
            return message(
                MessageKind.HAPTICS,
                self.rendered.number,
                encode_haptics(moment.time_s, felt, values),
            )
        tones = of_partials(partials, self.numbers, self.width)
        louder = Tones(tones.numbers, gain * tones.amplitudes, tones.frequencies_hz)
        frame = encode_values(frame_of(values, louder))
        return message(MessageKind.ANSWER, self.rendered.number, frame)


def with_gain(values: F64, device: DeviceConfig, gain: float) -> F64:
    """Scale the strengths in values (columns,) by ``gain``, relative to silence."""
    if gain == 1.0:
        return values
    values = values.copy()
    strengths, silent = device.strength_columns, device.neutral
    values[strengths] = silent[strengths] + gain * (values[strengths] - silent[strengths])
    return values


class Renderers:
    """Renderers of all devices that follow one scene."""

    def __init__(self, scene: SceneMessage) -> None:
        self._streams = scene.header.streams
        self.rendered: dict[int, _Rendered] = {}
        self.faults: list[bytes] = []
        names = [*(effect.id for effect in scene.header.effects), *MODALITIES]
        numbers = {name: k for k, name in enumerate(names)}
        for rendered in scene.devices:
            try:
                folder = None if rendered.folder is None else Path(rendered.folder)
                device = load_device(rendered.configuration, folder).rendered_by(rendered.scheme)
                renderer = MomentRenderer(scene.header, device, body_id=scene.body_id)
                renderer.prepare()
            except Exception as error:  # one device's fault is not another's
                self.faults.append(_fault(rendered.number, error))
                continue
            width = sum(actuator.type.takes_waveform for actuator in device.actuators)
            self.rendered[rendered.number] = _Rendered(rendered, device, renderer, numbers, width)

    def answers(self, body: bytes) -> list[bytes]:
        """Messages for all devices.

        Raises
        ------
        MessageError
            The body is no moment.
        """
        moment = decode_live_frame(body, self._streams)
        found = []
        for number, each in self.rendered.items():
            try:
                found.append(each.answer(moment))
            except Exception as error:
                found.append(_fault(number, error))
        return found


def _fault(number: int, error: Exception) -> bytes:
    _log.info("device %d", number, exc_info=error)
    return message(MessageKind.FAULT, number, str(error)[:_LONGEST_TEXT].encode(errors="replace"))


def taken(asked: Message, renderers: Renderers | None) -> tuple[Renderers | None, list[bytes]]:
    """Execute a message; returns the current renderers, and the answers.

    Raises
    ------
    MessageError
        It is not what it should be.
    """
    if asked.kind is MessageKind.SCENE:
        renderers = Renderers(decode_scene(asked.body))
        return renderers, renderers.faults
    if renderers is None:
        return None, []
    if asked.kind is MessageKind.MOMENT:
        return renderers, renderers.answers(asked.body)
    return renderers, []


def main() -> None:
    """Answer until standard input ends."""
    owner = Owner()
    renderers: Renderers | None = None
    while True:
        asked = owner.receive()
        answers: list[bytes] = []
        try:
            renderers, answers = taken(asked, renderers)
        except MessageError as error:
            answers = [_fault(EVERY_DEVICE, error)]
        owner.send(b"".join((*answers, message(MessageKind.READY))))


if __name__ == "__main__":
    main()
