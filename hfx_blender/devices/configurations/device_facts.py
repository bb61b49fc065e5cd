# SPDX-License-Identifier: GPL-3.0-or-later
"""Texts about a device for lists and panels: name, maker, modalities, places, picture."""

from collections import Counter
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Final

import numpy as np

from ...engine.body.model import load_model
from ...engine.body.parts import PARTS, REGIONS
from ...engine.body.regions import region_at
from ...engine.rendering.device_config import Actuator, BodyPlace, DeviceConfig, VertexPlace
from ...errors import InputError
from ..configuration import find_file, load_device, named_in_blend

_MODEL: Final = "hfx-pressure-1"  # perceptual model with the regions of places
_MOST_PLACES: Final = 3  # in a summary
ROOM: Final = "In the Room"
_BOARDS: Final = ("arduino_uno_pwm", "sound_card_8", "vrc_haptics_board")  # worn anywhere


@dataclass(frozen=True, eq=False)
class DeviceFacts:
    """Texts about a device; only id, title and fault for an unreadable configuration."""

    id: str  # name in a scene
    title: str
    device: DeviceConfig | None
    fault: str = ""  # message of the reading
    places: tuple[str, ...] = ()  # region labels, by descending number of actuators
    picture: Path | None = None

    @property
    def maker(self) -> str:
        """Maker and model; "" without a brand, or if the title contains both."""
        brand = None if self.device is None else self.device.brand
        if brand is None or (brand.vendor in self.title and brand.model in self.title):
            return ""
        return f"{brand.vendor} {brand.model}"

    @property
    def label(self) -> str:
        """Title and modalities, as "Vest, vibration, heat"; only the title without modalities."""
        plays = () if self.device is None else self.device.modalities
        return f"{self.title}, {', '.join(plays)}" if plays else self.title

    @property
    def group(self) -> str:
        """Region group of most actuators, or :data:`ROOM`; "" without places and for boards."""
        first = self.places[0] if self.places and not self.id.startswith(_BOARDS) else ""
        groups = {region.label: region.group for region in REGIONS} | {ROOM: ROOM}
        return groups.get(first, "")

    @property
    def summary(self) -> str:
        """Number of actuators, modalities, and at most three places; "" for an unreadable
        configuration. As "6 actuators for vibration: left hand and 2 more"."""
        if self.device is None:
            return ""
        count = len(self.device.actuators)
        named = self.places[:_MOST_PLACES]
        more = len(self.places) - len(named)
        where = ", ".join(named).lower() + (f" and {more} more" if more else "")
        plays = " and ".join(self.device.modalities)
        return f"{count} actuator{'' if count == 1 else 's'} for {plays}: {where}"


def facts_of(name: str) -> DeviceFacts:
    """Texts about a device by its name in a scene; cached until the file's time changes.
    For an unknown device, a file name or an unreadable file: ``name`` as title, and ``fault``."""
    try:
        path = find_file(named_in_blend(name))
        stamp = 0 if path is None else path.stat().st_mtime_ns
    except (InputError, OSError) as error:
        return DeviceFacts(name, name, None, str(error))
    # The time in the key of the cache: an edited file is read again.
    return _read(name, path, stamp)


@lru_cache(maxsize=256)
def _read(name: str, path: Path | None, _stamp: int) -> DeviceFacts:
    try:
        device = load_device(name)
        places = Counter(_place(actuator) for actuator in device.actuators)
    except InputError as error:
        return DeviceFacts(name, name, None, str(error))
    picture = None if path is None else path.parent / "pictures" / f"{path.stem}.png"
    return DeviceFacts(
        name,
        device.name,
        device,
        places=tuple(label for label, _ in places.most_common()),
        picture=picture if picture is not None and picture.is_file() else None,
    )


def _place(actuator: Actuator) -> str:
    """Label of the body region at an actuator: of the vertex nearest to its centre on its parts, on
    either side, or of the first vertex of its first vertex set; :data:`ROOM` for a place in the
    room."""
    position = actuator.place
    if isinstance(position, BodyPlace):
        model = load_model(_MODEL)
        on_part = np.isin(model.part, [PARTS.index(part) for part in position.parts])
        distance = np.linalg.norm(model.vertices - np.array(position.centre_m), axis=1)
        return region_at(model, int(np.argmin(np.where(on_part, distance, np.inf)))).label
    if isinstance(position, VertexPlace):
        first = position.sets[0]
        return region_at(load_model(first.model_id), first.vertices[0]).label
    return ROOM
