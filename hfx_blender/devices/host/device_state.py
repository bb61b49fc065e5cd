# SPDX-License-Identifier: GPL-3.0-or-later
"""State of a connected device, and events of the output process."""

from __future__ import annotations

import json
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Event:
    """Event from the output process."""

    event: str  # ready prepared connected armed stopped frozen silent fault lost closed levels
    # log gone
    device: int
    text: str = ""
    levels: tuple[float, ...] = ()


@dataclass(eq=False)
class DeviceState:
    """State of a connected device."""

    number: int
    name: str
    state: str = "connecting"  # connected armed stopped frozen fault lost closed
    configuration: str = ""
    folder: str | None = None
    has_script: bool = False
    scheme: str = ""  # rendering scheme of the next description, in place of its own
    text: str = ""
    unit: str = ""  # which of several devices of a server it is
    levels: tuple[float, ...] = field(default_factory=tuple)

    @property
    def is_armed(self) -> bool:
        return self.state == "armed"

    def update(self, event: Event) -> None:
        """Bring it up to date."""
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
    """Parse the event of a message's body; None if it is none."""
    try:
        found = json.loads(body)
        return Event(
            str(found["event"]),
            int(found["device"]),
            str(found.get("text", "")),
            tuple(float(each) for each in found.get("levels", ())),
        )
    except (ValueError, TypeError, KeyError):
        return None
