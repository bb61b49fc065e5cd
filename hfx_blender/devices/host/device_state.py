# SPDX-License-Identifier: GPL-3.0-or-later
"""Events of the output process, and the state of a connected device that they describe."""

from __future__ import annotations

import json
from dataclasses import dataclass


@dataclass(frozen=True)
class Event:
    """Event of the output process; "gone" is created by :class:`.host_pipe.HostPipe`."""

    # ready prepared connected armed stopped frozen silent fault lost closed levels log gone
    event: str
    device: int  # number, or EVERY_DEVICE
    text: str = ""  # reason of a stop; for "connected" the label of the device at a server
    levels: tuple[float, ...] = ()  # 0..1 by actuator


@dataclass(eq=False)
class DeviceState:
    """State of a connected device, as its events describe it."""

    number: int
    name: str
    state: str = "connecting"  # connected armed stopped frozen fault lost closed
    configuration: str = ""  # name or file
    folder: str | None = None  # of the user's configurations
    has_script: bool = False
    scheme: str = ""  # rendering scheme that replaces the configured one; "": as configured
    text: str = ""  # reason of the state, or the last line of the device's script
    unit: str = ""  # label of the device at a server; "" without
    levels: tuple[float, ...] = ()  # 0..1 by actuator

    @property
    def is_armed(self) -> bool:
        return self.state == "armed"

    def update(self, event: Event) -> None:
        """Apply an event; events of other devices change nothing, "gone" affects all devices."""
        if event.event == "gone":  # the output process, and all devices with it
            self.state, self.text, self.levels = "lost", event.text, ()
        elif event.device != self.number:
            return
        elif event.event == "levels":
            self.levels = event.levels
        elif event.event == "log":
            self.text = event.text
        elif event.event in ("connected", "armed"):
            self.state, self.text = event.event, ""
            if event.event == "connected":
                self.unit = event.text
        elif event.event == "closed":
            if self.state != "lost":
                self.state, self.levels = "closed", ()
        else:
            self.state, self.text, self.levels = event.event, event.text, ()


def event_of(body: bytes) -> Event | None:
    """Parse the JSON body of a message as an event; None if it is no event."""
    try:
        content = json.loads(body)
        return Event(
            str(content["event"]),
            int(content["device"]),
            str(content.get("text", "")),
            tuple(float(level) for level in content.get("levels", ())),
        )
    except (ValueError, TypeError, KeyError):
        return None
