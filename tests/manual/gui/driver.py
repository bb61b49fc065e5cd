# SPDX-License-Identifier: GPL-3.0-or-later
"""Driver of GUI journeys: mouse, keyboard, places in the window, pictures, checks.

A journey is a file with ``def steps(h):``, a generator. ``yield 0.5`` gives Blender half a second
to handle events; actions are called with ``yield from``.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pictures
from inputs import RealInput, SimulatedInput

Point = tuple[float, float]  # window pixels, from the top left corner


class Driver:
    """Handed to a journey as ``h``."""

    def __init__(
        self,
        out: Path,
        arguments: Sequence[str],
        zips: Sequence[Path],
        use: RealInput | SimulatedInput,
        screen: Path | None,
        documented: Path | None = None,
    ) -> None:
        self.out = out
        self.args = list(arguments)
        self.zips = list(zips)  # the extensions under test
        self.input = use
        self.actions = 0  # clicks, strokes, keys and typed texts so far
        self.mouse: Point = (0.0, 0.0)  # where the last move ended
        self._screen = screen
        self._documented = documented

    # Checks

    def check(self, holds: Any, text: str) -> None:
        """Print a passed check, or fail the journey."""
        sys.stdout.write(f"{'ok  ' if holds else 'FAIL'} {text}\n")
        sys.stdout.flush()
        if not holds:
            raise AssertionError(text)

    def until(self, holds: Callable[[], Any], text: str, seconds: float = 60) -> Iterator[float]:
        """Wait until a condition is true; fail the journey after a time limit."""
        end = time.monotonic() + seconds
        while not holds() and time.monotonic() < end:
            yield 0.1
        self.check(holds(), text)

    # Places

    @property
    def window(self) -> bpy.types.Window:
        return bpy.context.window_manager.windows[0]

    def area(self, kind: str = "VIEW_3D") -> bpy.types.Area:
        """The largest area of a kind."""
        areas = [area for area in self.window.screen.areas if area.type == kind]
        return max(areas, key=lambda area: area.width * area.height)

    def region(self, kind: str = "WINDOW", area: str = "VIEW_3D") -> bpy.types.Region:
        return next(region for region in self.area(area).regions if region.type == kind)

    def context(self, area: str = "VIEW_3D") -> Any:
        """Context for operators called from here."""
        return bpy.context.temp_override(
            window=self.window, area=self.area(area), region=self.region("WINDOW", area)
        )

    def xy(self, region: bpy.types.Region, right: float = 0.5, up: float = 0.5) -> Point:
        """A point of a region, by shares of the region's width and height."""
        x = region.x + right * region.width
        return x, self.window.height - (region.y + up * region.height)

    def xy_of(self, place: Sequence[float]) -> Point:
        """Position of a point of the scene in the 3D viewport."""
        from bpy_extras.view3d_utils import location_3d_to_region_2d

        region = self.region()
        seen = location_3d_to_region_2d(region, self.area().spaces.active.region_3d, place)
        if seen is None:
            raise AssertionError(f"{tuple(place)} cannot be seen")
        return region.x + seen.x, self.window.height - (region.y + seen.y)

    def sidebar(self, tab: str) -> Iterator[float]:
        """Open a tab of the 3D viewport's sidebar."""
        self.area().spaces.active.show_region_ui = True
        yield 0.3
        region = self.region("UI")
        region.active_panel_category = tab
        region.tag_redraw()
        yield 0.5

    # Mouse and keyboard

    def move(self, x: float, y: float) -> Iterator[float]:
        yield from self.input.move(x - 3, y - 3)  # Blender needs a mouse movement before the click
        yield from self.input.move(x, y)
        self.mouse = x, y

    def click(self, x: float, y: float, button: int = 1) -> Iterator[float]:
        self.actions += 1
        yield from self.move(x, y)
        yield from self.input.press(button)
        yield 0.05
        yield from self.input.release(button)
        yield 0.2

    def drag(self, points: Sequence[Point], button: int = 1, step: float = 0.02) -> Iterator[float]:
        self.actions += 1
        yield from self.move(*points[0])
        yield from self.input.press(button)
        for point in points[1:]:
            yield step
            yield from self.input.move(*point)
        yield 0.05
        yield from self.input.release(button)
        yield 0.2

    def key(self, *keys: str) -> Iterator[float]:
        self.actions += len(keys)
        for item in keys:
            yield from self.input.key(item)
        yield 0.2

    def text(self, text: str) -> Iterator[float]:
        self.actions += 1
        yield from self.input.text(text)
        yield 0.2

    # Finding clickable items

    def op_buttons(self, region: bpy.types.Region | None) -> Iterator[float]:
        """Centres of the operator buttons of a region, or of the whole window, from top to bottom,
        then left to right.

        Blender does not report the positions of buttons, so the buttons are painted in a unique
        colour for one picture.
        """
        actual = yield from self._painted("wcol_tool", region)
        return actual

    def button(self, region: bpy.types.Region, operator: type, which: int = 0) -> Iterator[float]:
        """Centre of an operator's button: the button greyed out by a failing poll.

        Parameters
        ----------
        operator : type
            Class of the operator, a subclass of the add-on's ``HfxOperator``.
        which : int
            For several buttons of the operator: number of the button, from the top.
        """
        requires = operator.requires
        with_it = yield from self.op_buttons(region)
        operator.requires = ((lambda context: False, "Greyed out for a picture"), *requires)
        try:
            without = yield from self.op_buttons(region)
        finally:
            operator.requires = requires
        region.tag_redraw()
        pictures.redraw(self.window)
        actual = [position for position in with_it if position not in without]
        self.check(len(actual) > which, f"{operator.bl_label} is in sight")
        return actual[which]

    def press_button(self, operator: str, region: str = "UI", which: int = 0) -> Iterator[float]:
        """Click an operator's button, named as in ``bpy.types``."""
        kind = getattr(bpy.types, operator)
        position = yield from self.button(self.region(region), kind, which)
        yield from self.click(*position)
        yield 0.3

    def fields(self, region: bpy.types.Region) -> Iterator[float]:
        """Centres of a region's number fields, like :meth:`op_buttons`."""
        actual = yield from self._painted("wcol_num", region)
        return actual

    def choices(self, region: bpy.types.Region) -> Iterator[float]:
        """Centres of a region's drop-down menus, like :meth:`op_buttons`."""
        actual = yield from self._painted("wcol_menu", region)
        return actual

    def text_fields(self) -> Iterator[float]:
        """Centres of the text fields in the whole window, like :meth:`op_buttons`."""
        actual = yield from self._painted("wcol_text", None)
        return actual

    def radios(self) -> Iterator[float]:
        """Centres of the expanded menus' choices in the whole window, like :meth:`op_buttons`."""
        actual = yield from self._painted("wcol_radio", None)
        return actual

    def toggles(self, region: bpy.types.Region) -> Iterator[float]:
        """Centres of a region's switches, like :meth:`op_buttons`."""
        actual = yield from self._painted("wcol_toggle", region)
        if not actual:  # since Blender 5.2
            actual = yield from self._painted("wcol_regular", region)
        return actual

    def enter(self, field: Point, value: str) -> Iterator[float]:
        """Type a value into a number field, as with Enter over the field."""
        yield from self.move(*field)
        yield 0.2
        yield from self.key("Return")
        yield from self.key("ctrl+a")
        yield from self.text(value)
        yield from self.key("Return")
        yield 0.3

    def panels(self, region: bpy.types.Region) -> Iterator[float]:
        """Centres of the headers of a region's panels, from top to bottom."""
        theme = bpy.context.preferences.themes[0]
        owner, name = theme.user_interface, "panel_header"  # since Blender 5.0
        if not hasattr(owner, name):
            owner, name = theme.view_3d.space.panelcolors, "header"
        before = tuple(getattr(owner, name))
        setattr(owner, name, (1.0, 0.0, 1.0, 1.0))
        try:
            actual = self._magenta(region)
        finally:
            setattr(owner, name, before)
        pictures.redraw(self.window)
        yield 0.1
        return actual

    def menu_rows(self) -> Iterator[float]:
        """Centres of the rows of all open menus, from top to bottom, then left to right."""
        actual = yield from self._painted("wcol_menu_item", None)
        return actual

    def menu(self) -> Iterator[float]:
        """Centres of the rows of the first opened menu, which a busy computer draws late."""
        rows: list[Point] = []
        for _ in range(20):
            rows = yield from self.menu_rows()
            if rows:
                break
            yield 0.5
        self.check(rows, "a menu is open")
        left = min(x for x, _ in rows)
        return [row for row in rows if row[0] - left < 20]

    def submenu(self, row: Point) -> Iterator[float]:
        """Point at a row of an open menu; the rows of the submenu, opened to the right."""
        yield from self.move(*row)
        for attempt in range(15):  # a busy computer draws late, and may miss a movement
            if attempt % 5 == 4:
                yield from self.move(row[0] + attempt - 10, row[1])
            yield 0.6
            rows = yield from self.menu_rows()
            right = [position for position in rows if position[0] - row[0] > 40]
            if right:
                break
        self.check(right, "a menu opens to the right")
        left = min(x for x, _ in right)
        return [position for position in right if position[0] - left < 20]

    def save_as(self, path: Path) -> Iterator[float]:
        """Answer the open file browser; call ``show_files_inside`` before opening."""
        yield from self.until(lambda: self._browser() is not None, "a file browser is open", 10)
        area = self._browser()
        area.spaces.active.params.directory = str(path.parent).encode()
        area.spaces.active.params.filename = path.name
        area.tag_redraw()
        yield 0.5
        region = next(region for region in area.regions if region.type == "WINDOW")
        yield from self.move(*self.xy(region, 0.5, 0.1))
        yield from self.key("Return")
        yield 0.5

    def show_files_inside(self) -> None:
        """Open file browsers in this window, without a separate window."""
        bpy.context.preferences.view.filebrowser_display_type = "SCREEN"

    def _browser(self) -> bpy.types.Area | None:
        areas = [area for area in self.window.screen.areas if area.type == "FILE_BROWSER"]
        ready = [area for area in areas if area.spaces.active.params is not None]
        return ready[0] if ready else None

    def _painted(self, widget: str, region: bpy.types.Region | None) -> Iterator[float]:
        colours = getattr(bpy.context.preferences.themes[0].user_interface, widget)
        before = tuple(colours.inner), tuple(colours.inner_sel)
        colours.inner = colours.inner_sel = (1.0, 0.0, 1.0, 1.0)
        try:
            actual = self._magenta(region)
        finally:
            colours.inner, colours.inner_sel = before
        pictures.redraw(self.window)
        yield 0.1
        return actual

    def _magenta(self, region: bpy.types.Region | None) -> list[Point]:
        """Centres of magenta areas in a region, or in the whole window."""
        pixels = self._picture("buttons.png")
        (self.out / "buttons.png").unlink()
        left = top = 0
        if region is not None:
            left, top = region.x, self.window.height - region.y - region.height
            pixels = pixels[top : top + region.height, left : left + region.width]
        magenta = (pixels[..., 0] > 230) & (pixels[..., 1] < 40) & (pixels[..., 2] > 230)
        return [(left + x, top + y) for x, y in _boxes(magenta)]

    # Pictures

    def shot(self, name: str) -> np.ndarray:
        """Save a picture of the window among the results; return the pixels (height, width, 3)."""
        return self._picture(name)

    def document(
        self, name: str, left: float = 0.3, right: float = 1.0, bottom: float = 0.05
    ) -> None:
        """Save a picture for the documentation, with ``--pictures``: a part of the 3D viewport.

        Parameters
        ----------
        left, right, bottom : float
            Borders of the part, as shares of the viewport's area; the part reaches to the top.
        """
        if self._documented is None:
            return
        area, pixels = self.area(), self._picture(name)
        (self.out / name).unlink()
        top = self.window.height - area.y - area.height
        rows = slice(top, top + round(area.height * (1 - bottom)))
        columns = slice(area.x + round(area.width * left), area.x + round(area.width * right))
        pictures.write(self._documented / name, pixels[rows, columns])

    def document_area(self, name: str, area: bpy.types.Area, height: float = 1.0) -> None:
        """Save a picture for the documentation, with ``--pictures``: the upper part of an area."""
        if self._documented is None:
            return
        pixels = self._picture(name)
        (self.out / name).unlink()
        top = self.window.height - area.y - area.height
        bottom = top + round(area.height * height)
        part = pixels[top:bottom, area.x : area.x + area.width]
        pictures.write(self._documented / name, part)

    def _picture(self, name: str) -> np.ndarray:
        return pictures.save(self.window, self.out / name, self._screen)

    # Setting up

    def undo_push(self, message: str = "Set up") -> None:
        """Call after a setup from Python: a later Ctrl+Z must not undo the setup."""
        with self.context():
            bpy.ops.ed.undo_push(message=message)

    def fast(self) -> None:
        """Set quick drawing for a computer without a graphics card."""
        bpy.context.preferences.system.viewport_aa = "OFF"
        overlay = self.area().spaces.active.overlay
        overlay.show_floor = overlay.show_axis_x = overlay.show_axis_y = False


def _boxes(hit: np.ndarray) -> list[Point]:
    """Centres of the painted boxes, from top to bottom.

    Cut along clean columns and rows in turn, since adjacent menus have rows at different heights.
    A caption never takes a box's whole height, so a caption is never a cut.
    """
    actual = []
    parts = [(slice(0, hit.shape[0]), slice(0, hit.shape[1]))]
    while parts:
        rows, columns = parts.pop()
        inside = hit[rows, columns]
        across = _runs(inside.any(axis=0))
        down = _runs(inside.sum(axis=1) >= 15)
        pieces = [(row, column) for row in down for column in across]
        if pieces == [(slice(0, inside.shape[0]), slice(0, inside.shape[1]))]:
            if inside.shape[1] >= 15 and inside.shape[0] >= 8:
                actual.append(
                    ((columns.start + columns.stop) / 2, (rows.start + rows.stop) / 2),
                )
            continue
        parts += [
            (
                slice(rows.start + row.start, rows.start + row.stop),
                slice(columns.start + column.start, columns.start + column.stop),
            )
            for row, column in pieces
        ]
    return sorted(actual, key=lambda place: (place[1], place[0]))


def _runs(line: np.ndarray) -> list[slice]:
    """Stretches of True."""
    places = np.flatnonzero(line)
    if not len(places):
        return []
    parts = np.split(places, np.flatnonzero(np.diff(places) > 1) + 1)
    return [slice(int(part[0]), int(part[-1]) + 1) for part in parts]
