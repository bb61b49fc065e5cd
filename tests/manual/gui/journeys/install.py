# SPDX-License-Identifier: GPL-3.0-or-later
"""Dropped on the window, used, switched off and on, upgraded, uninstalled: nothing is left."""

from __future__ import annotations

import gc
import re
import sys
import weakref
import zipfile
from collections.abc import Iterator
from pathlib import Path
from types import FunctionType
from typing import Any

import addon_utils
import bpy

INSTALLS_BY_ITSELF = True
MODULE = "bl_ext.user_default.hfx_blender"
EXTENSIONS = Path(bpy.utils.user_resource("EXTENSIONS"))


def traces() -> dict[str, list[str]]:
    """All possible traces of an add-on in Blender and on the disk."""
    menus = [getattr(bpy.types, name) for name in dir(bpy.types)]
    drawn = {id(value): value for menu in menus for value in _drawn(menu)}
    handlers = [
        value
        for name in dir(bpy.app.handlers)
        if isinstance(actual := getattr(bpy.app.handlers, name), list)
        for value in actual
    ]
    keys = [
        f"{keymap.name}: {item.idname}"
        for config in bpy.context.window_manager.keyconfigs
        for keymap in config.keymaps
        for item in keymap.keymap_items
    ]
    owners = [getattr(bpy.types, name) for name in dir(bpy.types)]
    properties = {
        f"{owner.__name__}.{name}"
        for owner in owners
        if isinstance(owner, type) and hasattr(owner, "bl_rna")
        for name in owner.bl_rna.properties.keys()
        if "hfx" in name
    }
    files = [path.relative_to(EXTENSIONS).as_posix() for path in EXTENSIONS.rglob("*")]
    return {
        "types": [name for name in dir(bpy.types) if "hfx" in name.lower()],
        "operators": list(dir(bpy.ops.hfx)),
        "properties": sorted(properties),
        "handlers": [str(handler) for handler in handlers if "hfx" in str(handler.__module__)],
        "drawn in menus": [str(e) for e in drawn.values() if "hfx" in str(e.__module__)],
        "keymaps": [key for key in keys if "hfx" in key],
        "modules": [name for name in sys.modules if "hfx" in name],
        "tabs": sorted(
            {
                panel.bl_category
                for panel in bpy.types.Panel.__subclasses__()
                if getattr(panel, "bl_category", "") == "HFX" and panel.is_registered
            }
        ),
        "files": [name for name in files if "hfx" in name or "scipy" in name],
        "preferences": [name for name in bpy.context.preferences.addons.keys() if "hfx" in name],
    }


def alive() -> list[str]:
    """Functions of the add-on still referenced by a drawing, a timer or a subscription.

    Blender has no list of drawings, timers and subscriptions, but each references a function.
    """
    gc.collect()
    return sorted(
        {
            f"{value.__module__}.{value.__qualname__}"
            for value in gc.get_objects()
            if isinstance(value, FunctionType) and str(value.__module__).startswith(MODULE)
        }
    )


def keeps_classes() -> bool:
    """Test that Blender keeps any unregistered class of properties, as 4.3.2 with Python 3.13."""
    group = type("HfxKept", (bpy.types.PropertyGroup,), {})
    bpy.utils.register_class(group)
    bpy.utils.unregister_class(group)
    kept = weakref.ref(group)
    del group
    gc.collect()
    return kept() is not None


def _drawn(menu: Any) -> list[Any]:
    return list(getattr(getattr(menu, "draw", None), "_draw_funcs", ()))


def enabled() -> bool:
    return MODULE in bpy.context.preferences.addons and addon_utils.check(MODULE)[1]


def older(extension: Path, folder: Path) -> Path:
    """Make the extension with a lower version and a file missing in the new version."""
    path = folder / "older.zip"
    with zipfile.ZipFile(extension) as read, zipfile.ZipFile(path, "w") as write:
        for entry in read.infolist():
            data = read.read(entry)
            if entry.filename == "blender_manifest.toml":
                data = re.sub(rb'\nversion = "[^"]*"', b'\nversion = "0.0.1"', data, count=1)
            write.writestr(entry, data)
        write.writestr("gone_since.py", "")
    return path


def drop(h: Any, path: Path, shot: str) -> Iterator[float]:
    """Drop the file on the window: a question, answered with OK."""
    with h.context():
        bpy.ops.extensions.package_install_files("INVOKE_DEFAULT", url=str(path))
    yield 1.0
    h.shot(shot)
    yield from h.key("Return")


def version() -> str:
    manifest = EXTENSIONS / "user_default" / "hfx_blender" / "blender_manifest.toml"
    if not manifest.exists():
        return ""
    text = manifest.read_text(encoding="utf-8")
    return re.search(r'\nversion = "([^"]*)"', text)[1]  # type: ignore[index]


def steps(h: Any) -> Iterator[float]:
    (extension,) = h.zips
    start = traces()
    h.check(not any(start.values()), f"at first there is nothing of it: {start}")

    old = older(extension, Path(bpy.app.tempdir))
    yield from h.move(*h.xy(h.region()))
    yield from drop(h, old, "1_dropped.png")
    yield from h.until(enabled, "dropped and confirmed, it is installed and on", 90)
    h.check(version() == "0.0.1", "in the older version")
    yield from h.sidebar("HFX")
    h.shot("2_installed.png")
    with h.context():
        bpy.ops.hfx.add_avatar()
    on = traces()
    h.check(on["operators"] and on["tabs"] == ["HFX"], "it is there")

    bpy.ops.preferences.addon_disable(module=MODULE)
    stored = {"modules", "files"}  # Blender keeps both while an add-on is off

    def left() -> dict[str, list[str]]:
        return {key: value for key, value in traces().items() if value and key not in stored}

    # Blender updates the user's keymaps with the next event.
    for _ in range(40):
        if left():
            yield 0.5
    h.check(not left(), f"switched off, it leaves nothing: {left()}")
    h.shot("3_off.png")
    bpy.ops.preferences.addon_enable(module=MODULE)
    yield 0.5
    again = traces()
    different = {key for key in on if key not in stored and sorted(on[key]) != sorted(again[key])}
    h.check(not different, f"switched on again, all is as before: {different}")
    lost = set(on["modules"]) - set(again["modules"])  # more may come: some are imported late
    h.check(not lost, f"with its modules: {lost}")

    yield from drop(h, extension, "4_upgrade.png")
    yield from h.until(lambda: version() not in ("", "0.0.1"), "upgraded", 90)
    yield from h.until(enabled, "and on", 30)
    yield 1.0
    folder = EXTENSIONS / "user_default" / "hfx_blender"
    h.check(not (folder / "gone_since.py").exists(), "what is gone since is gone from the disk")
    h.check(bpy.context.object.hfx.role == "BODY", "the scene is as it was")
    with h.context():
        bpy.ops.hfx.add_volume(modality="vibration", shape="SPHERE")
    h.shot("5_upgraded.png")

    repositories = bpy.context.preferences.extensions.repos
    index = repositories.find("User Default")
    with h.context():
        bpy.ops.extensions.package_uninstall(repo_index=index, pkg_id="hfx_blender")
    yield from h.until(lambda: not folder.exists(), "uninstalled", 60)
    yield 1.0
    remaining = {key: value for key, value in traces().items() if value}
    h.check(not remaining, f"nothing is left: {remaining}")
    if not keeps_classes():
        h.check(not alive(), f"and nothing of it can be called any more: {alive()[:9]}")
    h.shot("6_uninstalled.png")
