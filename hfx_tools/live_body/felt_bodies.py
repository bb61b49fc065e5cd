# SPDX-License-Identifier: GPL-3.0-or-later
"""Values of devices on tracked bodies: a clip's spatial part at the newest poses."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np

from hfx_blender.devices.live.client import LiveClient
from hfx_blender.engine.arrays import F64
from hfx_blender.engine.modality import MODALITIES
from hfx_blender.engine.rendering.device_config import DeviceConfig
from hfx_blender.errors import InputError, UsageError
from hfx_blender.files.strict_json import read_data
from hfx_blender.formats.clip.container import Sections
from hfx_blender.tracking.receiver import OscReceiver
from hfx_blender.tracking.vmc_body import FADE_S, LOST_S, VmcBody

from ..commands.played_clip import check_columns, device_record
from ..formats import clip_rules
from ..formats.clip_reader import texts_at
from .avatar_pose import AvatarPose
from .controlled_playback import weakened
from .live_values import LiveValues
from .player_core import CoreBody
from .track_recording import TrackRecording
from .triggered_parts import TriggeredParts, strongest

_LONGEST_M: Final = 5.0  # of a bone; greater lengths are in centimetres or millimetres


@dataclass(eq=False)
class FeltBody:
    """Body of the clip that follows a tracked person."""

    name: str
    core: CoreBody
    pose: AvatarPose
    receiver: OscReceiver
    person: VmcBody = field(default_factory=VmcBody)
    state: str = "waiting"  # waiting, tracked, lost
    values: Any = None  # (columns of the clip,) of the last evaluation
    matrices: Any = None  # (bones, 3, 4) of the last evaluation
    _noted: set[str] = field(default_factory=set)

    def factor(self, now_s: float) -> float:
        """Factor of the values: 1 while poses arrive, 0 before the first and after the fade."""
        if self.state == "waiting":
            return 0.0
        return min(max(1.0 - (self.person.age_s(now_s) - LOST_S) / FADE_S, 0.0), 1.0)

    def follow(self, now_s: float, seconds: float) -> list[str]:
        """Evaluate at the newest pose; returns sentences for a person found or lost, and for a
        sender with other units or besides another."""
        self.person.update(self.receiver.take())
        is_here = self.person.is_ready and self.person.age_s(now_s) <= LOST_S
        before, self.state = self.state, "tracked" if is_here else self.state
        if before == "tracked" and not is_here:
            self.state = "lost"
        if self.state != "waiting":
            self.matrices = self.pose.matrices(self.person)
            self.values = self.core.evaluate(self.matrices, seconds)
        sentences = list(self._warnings())
        if before != self.state:
            stands = "has no tracking" if not self.person.is_ready else "lost its sender"
            words = {"tracked": "is tracked", "lost": f"{stands} and fades to silence"}
            sentences.append(f"body '{self.name}' {words[self.state]}")
        return sentences

    def _warnings(self) -> Iterator[str]:
        """Sentences, once each, about a sender that cannot be felt as meant."""
        longest_m, second = self.person.longest_m, self.receiver.second
        if longest_m > _LONGEST_M and "units" not in self._noted:
            self._noted.add("units")
            yield (
                f"body '{self.name}' has a bone of {longest_m:.3g} m: VMC has metres, set the "
                "sender's scale"
            )
        if second is not None and "second" not in self._noted:
            self._noted.add("second")
            yield (
                f"port {self.receiver.port} gets a second program's poses, from {second[0]} port "
                f"{second[1]}: these are ignored"
            )


@dataclass(frozen=True, eq=False)
class _Worn:
    """Device on a tracked body, and the columns in the clip."""

    body: FeltBody
    columns: slice
    device: DeviceConfig


class FeltBodies:
    """Value source of devices on tracked bodies, without an end unless ``end_s`` is set.

    ``path``: a clip with a spatial part; ``devices``: by their names in the client.
    ``ports``: receiver of each tracked body by name; the name "" is the body of the first device.
    ``values``: effects' factors and parameters of other programs.
    ``place_m``: place of the tracked room's origin on the floor of the recorded scene, x and y.
    ``say``: takes sentences about persons found and lost.

    Raises InputError: the clip has no such body or device; UsageError: a device has no port.
    """

    is_rendered = False
    start_s = 0.0
    end_s = np.inf
    sample_s = 0.01

    def __init__(
        self,
        path: Path,
        devices: Mapping[str, DeviceConfig],
        ports: Mapping[str, OscReceiver],
        values: LiveValues,
        say: Callable[[str], None],
        place_m: tuple[float, float] = (0.0, 0.0),
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        content = read_data(path)
        sections = clip_rules.read(content, str(path))
        if not len(sections["BODY"]) or not len(sections["EFCT"]):
            raise InputError(f"{path}: it has no spatial part; expected a body and an effect.")
        self._place_m = np.array([*place_m, 0.0])
        self._names = texts_at(sections, sections["BODY"]["name"])
        self._values, self._say, self._clock = values, say, clock
        self._before_s: float | None = None
        self._effects = _Effects(sections)
        self.heard: Callable[[float], None] = lambda now_s: None  # called after each evaluation
        self.bodies: dict[str, FeltBody] = {}
        self._worn: dict[str, _Worn] = {}
        self.recorded: dict[str, list[tuple[float, F64]]] = {name: [] for name in devices}
        self.recording: TrackRecording | None = None
        self._sections, self._path = sections, str(path)
        self._ports, single = ports, ports.get("")
        for name, device in devices.items():
            record = device_record(sections, device, self._chosen(sections, device), str(path))
            check_columns(sections, record, device, str(path))
            wearer = texts_at(sections, np.atleast_1d(record["body"]))[0]
            receiver = ports.get(wearer, single)
            if receiver is None:
                raise UsageError(
                    f"device '{name}' is worn by '{wearer}': give --body {wearer}=PORT"
                )
            if wearer not in self.bodies:
                if receiver is single and self.bodies:
                    raise UsageError(f"'{wearer}' has no port: give --body {wearer}=PORT")
                self.bodies[wearer] = self._body(content, sections, wearer, receiver, str(path))
            first, count = int(record["first_column"]), int(record["columns"])
            columns = slice(first, first + count)
            self._worn[name] = _Worn(self.bodies[wearer], columns, device)
        wearers: dict[str, tuple[DeviceConfig, str | None]] = {
            name: (worn.device, worn.body.name) for name, worn in self._worn.items()
        }
        self._parts = TriggeredParts(path, wearers) if values.receiver is not None else None
        unknown = [name for name in ports if name and name not in self._names]
        if unknown:
            known = ", ".join(f"'{name}'" for name in self._names[:5])
            raise InputError(f"{path}: it has no body '{unknown[0][:100]}'; there are: {known}.")

    def record(self) -> TrackRecording:
        """Record the touch of all bodies from now on. Raises InputError as
        :class:`.TrackRecording`."""
        self.recording = TrackRecording(self._sections, self.bodies, self._path)
        return self.recording

    def begin(self, client: LiveClient) -> None:
        """Do nothing: values need no scene."""

    def show(self, client: LiveClient, time_s: float) -> None:
        """Send the values of all devices at the newest poses."""
        now_s = self._clock()
        # A step of the contact response; a halted command does not skip seconds of a response.
        seconds = min(now_s - self._before_s, 0.25) if self._before_s is not None else 0.0
        self._before_s = now_s
        self._values.take()
        if self._parts is not None:
            for part in self._parts.update(self._values.triggered, now_s):
                self._say(f"the clip has no part '{part[:100]}'")
        for body in self.bodies.values():
            self._effects.apply(self._values, body.core)
            for sentence in body.follow(now_s, seconds):
                self._say(sentence)
            if self.recording is not None and body.state != "waiting":
                factor = body.factor(now_s) * self._values.gain
                parameters = self._effects.parameters(self._values)
                self.recording.add(time_s, body.name, body.core, factor, parameters)
        self.heard(now_s)
        for name in self._worn:
            values = self.values(name, now_s)
            if self._parts is not None:
                device, gain = self._worn[name].device, self._values.gain
                rows = [weakened(row, gain, device) for row in self._parts.values(name, now_s)]
                values = strongest([values, *rows], device)
            client.send(name, values)
            self.recorded[name].append((time_s, values))

    def values(self, name: str, now_s: float) -> F64:
        """Values (columns,) of a device after :meth:`show`'s evaluation, with gain and fade."""
        worn = self._worn[name]
        factor = worn.body.factor(now_s) * self._values.gain
        if worn.body.values is None:
            return worn.device.neutral
        return weakened(worn.body.values[worn.columns].astype(np.float64), factor, worn.device)

    @property
    def volumes(self) -> list[int]:
        """Indices of the clip's volumes, which are sources of sound."""
        return self._effects.volumes

    def sources(self, now_s: float, tone: float, touch: float) -> tuple[F64, F64]:
        """Places (S, 3) of all volumes around the first body's head, metres, front, left and up,
        and amplitudes (S,): ``tone`` times the level, plus ``touch`` times the level on the skin,
        with gain and fade. Silent before the first pose."""
        body = next(iter(self.bodies.values()))
        if body.matrices is None:
            return np.zeros((len(self.volumes), 3)), np.zeros(len(self.volumes))
        head = body.pose.listener(body.matrices)
        places = self._effects.places(self._values) @ head[:, :3].T + head[:, 3]
        levels = tone * self._effects.levels(self._values)
        levels += touch * np.array([body.core.touch(k) for k in self.volumes])
        return places, levels * body.factor(now_s) * self._values.gain

    def _chosen(self, sections: Sections, device: DeviceConfig) -> str | None:
        """Body for the next device: the only tracked one, else the first tracked one that the clip
        has values for, preferably without a device so far; None without a choice."""
        if len(self._ports) == 1:
            return next(iter(self._ports)) or None
        records = sections["DEVC"]
        ids, bodies = (texts_at(sections, records[key]) for key in ("id", "body"))
        # A clip has the values of each device on each body.
        able = [b for i, b in zip(ids, bodies, strict=True) if i == device.id and b in self._ports]
        return next((body for body in able if body not in self.bodies), next(iter(able), None))

    def _body(
        self, content: bytes, sections: Sections, name: str, receiver: OscReceiver, path: str
    ) -> FeltBody:
        index = self._names.index(name)
        record = sections["BODY"][index]
        first, count = int(record["first_bone"]), int(record["bones"])
        bones = sections["BONE"][first : first + count]
        parents = [int(p) if int(p) < count else -1 for p in bones["parent"]]
        rest = bones["rest"].astype(np.float64).reshape(count, 3, 4)
        human = texts_at(sections, bones["human"])
        pose = AvatarPose(human, parents, rest, self._place_m)
        return FeltBody(name, CoreBody(content, index, path), pose, receiver)


class _Effects:
    """Effects of a clip by name; several effects may have one name."""

    def __init__(self, sections: Sections) -> None:
        records = sections["EFCT"]
        self._names = texts_at(sections, records["name"])
        modalities = list(MODALITIES.values())
        self._parameters = [modalities[int(m)].parameter_names for m in records["modality"]]
        self._matrices = records["matrix"].astype(np.float64).reshape(-1, 3, 4)
        # As the core begins: volumes on, painted areas off.
        self._factors = [0.0 if kind else 1.0 for kind in records["kind"]]

        self._values = records["parameters"].astype(np.float64)
        self._levels = records["level"].astype(np.float64)
        self.volumes = [k for k, kind in enumerate(records["kind"]) if not kind]

    def levels(self, values: LiveValues) -> F64:
        """Levels (S,) of the volumes, 0 to 1, without the touch."""
        factors = [
            0.0
            if values.muted.get(self._names[k])
            else values.intensities.get(self._names[k], self._factors[k])
            for k in self.volumes
        ]
        return np.asarray(self._levels[self.volumes] * factors)

    def parameters(self, values: LiveValues) -> list[F64]:
        """Parameters (P,) of each effect in the order of its modality."""
        return [
            np.array(
                [
                    values.parameters.get((effect, name), value)
                    for name, value in zip(names, row, strict=False)
                ]
            )
            for effect, names, row in zip(self._names, self._parameters, self._values, strict=True)
        ]

    def places(self, values: LiveValues) -> F64:
        """Places (S, 3) of the volumes in the world, metres."""
        return np.array(
            [
                values.vectors.get((self._names[k], "location"), self._matrices[k][:, 3])
                for k in self.volumes
            ]
        ).reshape(-1, 3)

    def apply(self, values: LiveValues, core: CoreBody) -> None:
        """Set factors and parameters of a body's effects."""
        for k, name in enumerate(self._names):
            if name in values.intensities or name in values.muted:
                factor = values.intensities.get(name, self._factors[k])
                core.set_factor(k, 0.0 if values.muted.get(name) else factor)
        for (name, parameter), value in values.parameters.items():
            for k, names in enumerate(self._parameters):
                if self._names[k] == name and parameter in names[:4]:
                    core.set_parameter(k, names.index(parameter), value)
        moved = {name for name, parameter in values.vectors if parameter in TRANSFORM}
        for k, name in enumerate(self._names):
            if name in moved:
                vectors = {
                    t: values.vectors[name, t] for t in TRANSFORM if (name, t) in values.vectors
                }
                core.set_volume(k, placed(self._matrices[k], **vectors))


TRANSFORM: Final = ("location", "rotation_euler", "scale")


def placed(
    matrix: F64,
    location: tuple[float, ...] | None = None,
    rotation_euler: tuple[float, ...] | None = None,
    scale: tuple[float, ...] = (1.0, 1.0, 1.0),
) -> F64:
    """Matrix (3, 4) of a volume with another place in metres and another rotation, radians about X,
    then Y, then Z; None keeps each. ``scale``: factors of the size along the local axes."""
    sizes = np.linalg.norm(matrix[:, :3], axis=0)
    if rotation_euler is None:
        turned = matrix[:, :3]
    else:
        (cx, cy, cz), (sx, sy, sz) = np.cos(rotation_euler), np.sin(rotation_euler)
        about_x = np.array([[1.0, 0.0, 0.0], [0.0, cx, -sx], [0.0, sx, cx]])
        about_y = np.array([[cy, 0.0, sy], [0.0, 1.0, 0.0], [-sy, 0.0, cy]])
        about_z = np.array([[cz, -sz, 0.0], [sz, cz, 0.0], [0.0, 0.0, 1.0]])
        turned = about_z @ about_y @ about_x * sizes
    place = matrix[:, 3] if location is None else np.array(location)
    return np.column_stack([turned * np.array(scale), place])
