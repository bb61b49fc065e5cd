# SPDX-License-Identifier: GPL-3.0-or-later
"""Render worker: renders moments for all devices in a process started by the output process.

Receives one scene or moment at a time and sends READY after all answers. The failure of a device
is sent as FAULT and does not affect the rest.
"""

import logging
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from ...engine.modality import MODALITIES
from ...engine.rendering.conditioning.frequency import TONE_PAIR_HZ
from ...engine.rendering.device_config import DeviceConfig
from ...engine.rendering.moment import MomentRenderer
from ...processes.messages import EVERY_DEVICE, MessageError, MessageKind, message
from ...processes.worker import Owner
from ..configuration import load_device
from ..configurations.person_profile import personal
from ..host.tones import Tones, frame_of, of_partials
from .haptics import encode_haptics
from .live_frame import LiveFrame, RenderedDevice, SceneMessage, decode_live_frame, decode_scene
from .message_bodies import encode_values

_log = logging.getLogger(__name__)

_LONGEST_TEXT: Final = 500


@dataclass(eq=False)
class _Rendered:
    """Device with a renderer."""

    rendered: RenderedDevice
    device: DeviceConfig
    renderer: MomentRenderer
    numbers: dict[str, int]  # tone numbers by effect id, or by substituted modality
    width: int  # number of actuators that take a waveform
    labels: dict[str, str]  # names of effects by id

    def answer(self, moment: LiveFrame) -> bytes:
        """Render a moment: HAPTICS for a device with a script, unless muted; else ANSWER with
        values and tones. Strengths are scaled by the device's gain."""
        if moment.play_space is not None:
            self.renderer.move_play_space(moment.play_space)
        values, partials = self.renderer.ahead(moment.runs, moment.later, moment.time_s)
        gain = moment.gains.get(self.rendered.number, 1.0)
        if gain != 1.0:
            # The gain scales distances from silence, which is not 0 for temperatures.
            values = values.copy()
            columns, neutral = self.device.strength_columns, self.device.neutral
            silent = neutral[columns]
            values[columns] = silent + gain * (values[columns] - silent)
        if self.rendered.has_script and gain:  # the script of a muted device is not called
            effects = self.renderer.felt(moment.runs)
            return message(
                MessageKind.HAPTICS,
                self.rendered.number,
                encode_haptics(moment.time_s, effects, values, self.labels),
            )
        tones = of_partials(partials, self.numbers, self.width)
        # The guard compares tones with values, so both have the same gain.
        louder = Tones(tones.numbers, gain * tones.amplitudes, tones.frequencies_hz)
        frame = encode_values(frame_of(values, louder))
        return message(MessageKind.ANSWER, self.rendered.number, frame)


class Renderers:
    """Renderers of all devices for a scene; ``faults`` are FAULT messages about devices without a
    renderer."""

    def __init__(self, scene: SceneMessage) -> None:
        self._streams = scene.header.streams
        self.rendered: dict[int, _Rendered] = {}
        self.faults: list[bytes] = []
        labels = {effect.id: effect.name for effect in scene.header.effects}
        names = [*(effect.id for effect in scene.header.effects), *MODALITIES, *TONE_PAIR_HZ]
        numbers = {name: k for k, name in enumerate(names)}
        for rendered in scene.devices:
            try:
                folder = None if rendered.folder is None else Path(rendered.folder)
                device = load_device(rendered.configuration, folder).rendered_by(rendered.scheme)
                device = personal(device, rendered.profile)
                wearer = rendered.body_id or scene.body_id
                renderer = MomentRenderer(scene.header, device, body_id=wearer)
                # Models and distances are loaded now, so that the first moment is on time.
                renderer.prepare()
            except Exception as error:  # a fault must not affect the rest
                self.faults.append(_fault(rendered.number, error))
                continue
            width = sum(actuator.type.takes_waveform for actuator in device.actuators)
            self.rendered[rendered.number] = _Rendered(
                rendered, device, renderer, numbers, width, labels
            )

    def answers(self, body: bytes) -> list[bytes]:
        """Render a moment: a message for each device, a FAULT for a device whose rendering fails.
        MessageError for an invalid body."""
        moment = decode_live_frame(body, self._streams)
        answers = []
        for number, rendered in self.rendered.items():
            try:
                answers.append(rendered.answer(moment))
            except Exception as error:
                answers.append(_fault(number, error))
        return answers


def _fault(number: int, error: Exception) -> bytes:
    """FAULT message of a device: text of ``error``, 500 characters at most; logs the traceback."""
    _log.info("device %d", number, exc_info=error)
    return message(MessageKind.FAULT, number, str(error)[:_LONGEST_TEXT].encode(errors="replace"))


def main() -> None:
    """Answer requests of the owner until the owner ends.

    A scene is answered with the faults of its devices, a moment with the values of each device;
    READY follows each answer.
    """
    owner = Owner()
    renderers: Renderers | None = None
    while True:
        request = owner.receive()
        answers: list[bytes] = []
        try:
            if request.kind is MessageKind.SCENE:
                renderers = Renderers(decode_scene(request.body))
                answers = renderers.faults
            elif renderers is not None and request.kind is MessageKind.MOMENT:
                answers = renderers.answers(request.body)
        except MessageError as error:
            answers = [_fault(EVERY_DEVICE, error)]
        owner.send(b"".join((*answers, message(MessageKind.READY))))


if __name__ == "__main__":
    main()
