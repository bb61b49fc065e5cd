# SPDX-License-Identifier: GPL-3.0-or-later
"""Live devices: what is felt now is sent to connected devices, while Blender plays, scrubs or
drags.

The output process does everything slow; here the open scene is evaluated once a change, its
values are handed over, and a timer gives a sign of life. Nothing listens until a device is
connected.
"""

from __future__ import annotations

import logging
import re
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import bpy
from bpy.app.handlers import persistent

from .. import resources
from ..errors import DeviceError, HfxError, InputError
from ..reading import stepping
from . import live_settings

if TYPE_CHECKING:
    from ..devices.live.client import DeviceState, LiveClient
    from ..devices.live.haptics import F64
    from ..engine.rendering.device import DeviceConfig
    from ..engine.rendering.moment import MomentRenderer
    from ..reading.live_scene import LiveScene

BEAT_S = 0.05
HOLD_S = 2.0
"""A scene that stands still is felt for so long; then it is silent until something moves."""

_log = logging.getLogger(__name__)


@dataclass(eq=False)
class _Connected:
    """A device that is connected."""

    device: DeviceConfig
    has_script: bool
    renderer: MomentRenderer | None = None


class Live:
    """The devices of this Blender."""

    def __init__(self) -> None:
        self._client: LiveClient | None = None
        self._devices: dict[str, _Connected] = {}
        self._scene: LiveScene | None = None
        self._key: tuple[object, ...] = ()
        self._changed_s = 0.0
        self._is_held = False
        self.fault = ""
        self.unapproved: set[str] = set()  # devices whose scripts are to be approved first

    @property
    def states(self) -> dict[str, DeviceState]:
        """What is known of each connected device."""
        return {} if self._client is None else self._client.devices

    @property
    def is_armed(self) -> bool:
        """Whether any device plays."""
        return any(each.is_armed for each in self.states.values())

    def state(self, name: str) -> DeviceState | None:
        return self.states.get(name) if name in self._devices else None

    def device(self, name: str) -> DeviceConfig | None:
        """Configuration of a connected device."""
        found = self._devices.get(name)
        return None if found is None else found.device

    def connect(self, name: str, settings: live_settings.LiveSettings) -> None:
        """Open a device and let it play.

        Raises
        ------
        InputError
            There is no such device, or its script has not been approved.
        DeviceError
            It is not there, or the output process cannot be started.
        """
        from ..devices.configuration import load_device
        from ..devices.live import approval
        from ..devices.live.client import LiveClient

        if not re.fullmatch(r"[\w-]+", name):
            raise InputError(f"Device '{name[:100]}' is not a name; a .blend never chooses files.")
        folder = resources.user_devices()
        device = load_device(name, folder)
        script = approval.script_of(name, folder)
        if script is not None and not script.is_approved:
            self.unapproved.add(name)
            raise InputError(
                f"Device '{name}' brings the script {script.path}; read it and approve it first."
            )
        target = target_of(device, settings)
        if self._client is None:
            self._client = LiveClient()
        self._client.connect(
            name,
            name,
            target,
            folder=folder,
            script=None if script is None else script.as_wish(),
            offset_ms=settings.offset_ms,
        )
        self._devices[name] = _Connected(device, script is not None)
        self._key = ()
        _listen()
        request_update()

    def disconnect(self, name: str) -> None:
        self._devices.pop(name, None)
        if self._client is not None:
            self._client.disconnect(name)
            if not self._devices:
                self.close()

    def stop_all(self, reason: str = "stopped by you") -> None:
        """Silence now; only :meth:`arm` plays again."""
        if self._client is not None:
            self._client.stop_all(reason)

    def arm(self) -> None:
        """Play again, from silence."""
        if self._client is not None:
            self._client.arm()
            self.fault = ""
            request_update()

    def pulse(self, name: str, actuator: int) -> None:
        """Let one actuator be felt for a moment, softly."""
        if self._client is not None:
            self._client.pulse(name, actuator)

    def set_offset(self, name: str, offset_ms: float) -> None:
        if self._client is not None:
            self._client.set_offset(name, offset_ms)

    def close(self) -> None:
        """Silence everything and end the output process."""
        client, self._client = self._client, None
        self._devices.clear()
        self.forget()
        _do_not_listen()
        if client is not None:
            client.close()

    def forget(self) -> None:
        """The scene may have become another one: nothing of it is kept."""
        self._scene, self._key = None, ()
        for each in self._devices.values():
            each.renderer = None

    def beat(self) -> bool:
        """A sign of life, and news from the devices; tells whether there are any."""
        if self._client is None:
            return False
        self._client.heartbeat()
        news = self._client.events()
        if not self._is_held and time.monotonic() - self._changed_s > HOLD_S:
            self._is_held = True
            for name, each in self._devices.items():
                if each.has_script:
                    continue  # a script decides by itself what standing still means
                self._client.send(name, _neutral(each.device))
        return bool(news)

    def describe(self, context: bpy.types.Context) -> None:
        """Find out what there is to feel, if that changed; never from within an update."""
        from ..engine.rendering.moment import MomentRenderer
        from ..export import scene_tolerance
        from ..reading.live_scene import LiveScene, signature_of

        scene, layer = context.scene, context.view_layer
        key = (*signature_of(scene), layer.name, scene.hfx.tolerance)
        if key == self._key:
            return
        self.forget()
        self._key, self.fault = key, ""
        if self._client is not None:
            self._client.pause()  # models may have to be loaded
        try:
            found = LiveScene(scene, layer, scene_tolerance(scene))
            body = found.description.bodies[0].id  # devices are worn by the first body
            for each in self._devices.values():
                each.renderer = MomentRenderer(found.description, each.device, body_id=body)
            self._scene = found
        except HfxError as error:
            self.fault = str(error)

    def update(self, scene: bpy.types.Scene) -> None:
        """Send what is felt now to every device.

        Raises
        ------
        InputError
            A device does not fit the body.
        """
        if self._client is None or not self.is_armed or self._scene is None:
            return
        self._changed_s, self._is_held = time.monotonic(), False
        runs = self._scene.runs()
        time_s = scene.frame_current_final / (scene.render.fps / scene.render.fps_base)
        for name, each in self._devices.items():
            if each.renderer is None:
                continue
            item = scene.hfx.devices.get(name)
            values = each.renderer.values(runs)
            if item is not None:
                values = with_gain(values, each.device, 0.0 if item.is_muted else item.gain)
            if not each.has_script:
                self._client.send(name, values)
                continue
            from ..devices.live.haptics import packed

            is_muted = item is not None and item.is_muted
            felt = [] if is_muted else each.renderer.felt(runs)
            self._client.send_haptics(name, packed(time_s, felt, values))


def target_of(device: DeviceConfig, settings: live_settings.LiveSettings) -> dict[str, Any]:
    """What the output process is to open.

    Raises
    ------
    DeviceError
        Nothing drives this device live, or it is not there.
    """
    from ..devices.live import opening
    from ..devices.live.discovery import port_of, serial_ports

    if settings.kind == "SIMULATOR":
        path = bpy.path.abspath(settings.path)
        return {"kind": "simulator", **({"path": path} if path else {})}
    if settings.kind == "CSV":
        if not settings.path:
            raise DeviceError(f"Device '{device.id}': name the log's file.")
        return {"kind": "csv", "path": str(Path(bpy.path.abspath(settings.path)))}
    kind = opening.kind_of(device)
    if kind is None:
        raise DeviceError(
            f"Device '{device.id}': its configuration names no output; nothing drives it live."
        )
    if kind == "serial":
        return {"kind": kind, "port": settings.port or port_of(device, serial_ports())}
    target: dict[str, Any] = {"kind": kind}
    if settings.host:
        target["host"] = settings.host
    if settings.port:
        if not settings.port.isdecimal():
            raise DeviceError(f"Device '{device.id}': '{settings.port}' is no network port.")
        target["port"] = int(settings.port)
    return target


def with_gain(values: F64, device: DeviceConfig, gain: float) -> F64:
    """Values (columns,) with every strength's way from silence times ``gain``."""
    if gain == 1.0:
        return values
    values = values.copy()
    first = 0
    for actuator in device.actuators:
        neutral = actuator.type.strength.neutral
        values[first] = neutral + gain * (values[first] - neutral)
        first += len(actuator.type.controls)
    return values


def _neutral(device: DeviceConfig) -> list[float]:
    return [c.neutral for actuator in device.actuators for c in actuator.type.controls]


live = Live()
_is_describing = False


def request_update() -> None:
    """Describe and send soon; not from within an update of Blender's."""
    if not bpy.app.timers.is_registered(_describe):
        bpy.app.timers.register(_describe, first_interval=0.0)


def _describe() -> None:
    global _is_describing
    _is_describing = True
    try:
        live.describe(bpy.context)
        live.update(bpy.context.scene)
    except (ReferenceError, AttributeError) as error:  # no scene at this moment
        _log.info("live: %s", error)
        live.forget()
    except HfxError as error:
        live.fault = str(error)
        live.stop_all(str(error))
    except Exception as error:
        _log.exception("live")
        live.fault = f"{type(error).__name__}: {error}"
        live.stop_all(live.fault)
    finally:
        _is_describing = False


@persistent
def _on_change(scene: bpy.types.Scene, *_: object) -> None:
    if _is_describing or not live.is_armed or scene != bpy.context.scene:
        return
    if stepping.is_stepping() or bpy.app.is_job_running("RENDER"):
        return
    try:
        live.update(scene)
    except (ReferenceError, HfxError) as error:
        live.forget()
        live.fault = str(error)
        live.stop_all(str(error))
    except Exception as error:
        _log.exception("live")
        live.fault = f"{type(error).__name__}: {error}"
        live.stop_all(live.fault)
    if not bpy.context.screen or not bpy.context.screen.is_animation_playing:
        request_update()  # something may have been added, painted or muted


@persistent
def _on_load(*_: object) -> None:
    live.stop_all("another file was opened")
    live.forget()


@persistent
def _on_undo(*_: object) -> None:
    live.stop_all("stopped by an undo or redo")
    live.forget()


def _beat() -> float:
    try:
        if live.beat():
            _redraw()
    except Exception as error:  # a timer that raises is not called again
        _log.exception("live")
        live.fault = f"{type(error).__name__}: {error}"
        live.stop_all(live.fault)
    return BEAT_S


def _redraw() -> None:
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()


_HANDLERS = {
    "frame_change_post": _on_change,
    "depsgraph_update_post": _on_change,
    "load_pre": _on_load,
    "undo_pre": _on_undo,
    "redo_pre": _on_undo,
}


def _listen() -> None:
    for name, handler in _HANDLERS.items():
        handlers = getattr(bpy.app.handlers, name)
        if handler not in handlers:
            handlers.append(handler)
    if not bpy.app.timers.is_registered(_beat):
        bpy.app.timers.register(_beat, first_interval=BEAT_S, persistent=True)


def _do_not_listen() -> None:
    for name, handler in _HANDLERS.items():
        handlers = getattr(bpy.app.handlers, name)
        if handler in handlers:
            handlers.remove(handler)
    for timer in (_beat, _describe):
        if bpy.app.timers.is_registered(timer):
            bpy.app.timers.unregister(timer)


def register() -> None:
    """Nothing to do before a device is connected."""


def unregister() -> None:
    live.close()
