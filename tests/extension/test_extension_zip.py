# SPDX-License-Identifier: GPL-3.0-or-later
"""Zip of the extension: content, manifest, and reproducible bytes."""

from __future__ import annotations

import base64
import functools
import hashlib
import os
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path
from typing import Any

import pytest
from import_graph import PACKAGE, imports, module_name
from packed_wheels import BLENDERS_OWN, bare_python, pack
from strange_modules import CHILDREN, fill

import build_addon
import hfx_blender
from hfx_blender import cli
from hfx_blender.formats.registry import FORMATS
from hfx_blender.processes import tools_package
from release import (
    addon_wheels,
    native_build,
    native_wheel,
)

ROOT = Path(__file__).resolve().parents[2]

SHIPPED = list(PACKAGE.rglob("*.py"))
IMPORTED = functools.cache(addon_wheels.imported)
"""Reads the whole package: once is enough for all tests that change nothing of it."""

SHIPPED_CHILDREN = [name for name in CHILDREN if not name.startswith("hfx_tools.")]


def manifest_of(path: Path) -> dict[str, Any]:
    with zipfile.ZipFile(path) as archive:
        return tomllib.loads(archive.read("blender_manifest.toml").decode())


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the zip for all platforms with only the library's wheels.

    The wheel for this computer is real; the rest are stand-ins, which saves 15 seconds.
    """
    try:
        zig = native_build.compiler()
    except native_build.BuildError as error:
        pytest.skip(str(error))
    compiled = native_build.build

    def build(target: native_build.Target, folder: Path, zig: Path) -> Path:
        if target == native_build.this_target():
            installed = PACKAGE / "engine" / "native" / target.library
            if native_build.is_current(installed, target):
                return Path(shutil.copy(installed, folder))
            return compiled(target, folder, zig)
        path = folder / target.library
        path.write_text("a library of another computer")
        return path

    folder = tmp_path_factory.mktemp("dist")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(native_build, "build", build)
        patch.setattr(
            addon_wheels,
            "fetch",
            lambda name, _digest, folder: pack(name, folder, zipfile.ZIP_DEFLATED),
        )
        return build_addon.build_small(folder, folder, zig)


@pytest.fixture
def wheels(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Write stand-ins for the pinned wheels, with a matching lock, and yield the folder."""
    folder = tmp_path / "wheels"
    folder.mkdir()
    lines = []
    for name in addon_wheels.read_lock():
        path = folder / name
        with zipfile.ZipFile(path, "w") as archive:
            information = "-".join(name.split("-")[:2]) + ".dist-info"
            archive.writestr(f"{information}/METADATA", name)
            if not name.startswith(("pyserial", "python_osc")):  # as in the real wheels
                archive.writestr(f"{information}/licenses/LICENSE", "MIT")
        lines.append(f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {name}\n")
    lock = tmp_path / "lock"
    lock.write_text("".join(lines), encoding="utf-8")
    real = addon_wheels.read_lock
    monkeypatch.setattr(addon_wheels, "read_lock", lambda: real(lock))

    def no_download(*_: object) -> None:
        raise AssertionError("a test must not fetch anything")

    monkeypatch.setattr(addon_wheels, "download", no_download)
    monkeypatch.setattr(addon_wheels, "imported", IMPORTED)
    monkeypatch.setattr(build_addon, "DATA", ())  # quicker
    yield folder


@pytest.fixture
def zig(monkeypatch: pytest.MonkeyPatch) -> Path:
    """Replace the compiler by a stand-in with unloadable libraries."""

    def build(target: native_build.Target, folder: Path, zig: Path) -> Path:
        path = folder / target.library
        path.write_text(f"{target.zig} by {zig}")
        return path

    monkeypatch.setattr(native_build, "build", build)
    return Path("zig")


# Content


def test_the_zip_holds_the_package_the_data_and_the_licence(small: Path) -> None:
    names = set(zipfile.ZipFile(small).namelist())
    expected = {path.relative_to(PACKAGE).as_posix() for path in SHIPPED}
    assert not [name for name in names if "hfx_tools" in name]
    for folder in ("body_models", "device_configs"):
        expected |= {path.relative_to(ROOT).as_posix() for path in (ROOT / folder).glob("*.json")}
    assert expected | {"LICENSE", "blender_manifest.toml"} <= names


def test_packed_modules_import_packed_modules_only() -> None:
    held = {module_name(path) for path in SHIPPED}
    for path in SHIPPED:
        for actual in imports(path):
            assert actual.module in held, (
                f"{module_name(path)}:{actual.line} imports {actual.module}"
            )
        # These modules search for commands of a pip installation.
        if path.name not in ("tools_package.py", "child.py", "start.py", "registry.py"):
            code = re.sub(r'"""[\s\S]*?"""|#.*', "", path.read_text(encoding="utf-8"))
            assert "hfx_tools" not in code, path


def test_functions_of_formats_that_blender_calls_are_packed() -> None:
    # Exports call the writers of the formats in their dialog, those of rasters and signals for
    # files of a single device, and the checks of formats with envelopes; imports decode envelopes,
    # but read the channels of HJIF by its own reader (test_hjif_import.py).
    for info in FORMATS.values():
        called = ["held", "why_nothing", *(["check"] if info.decode else [])]
        called += [] if info.id == "hjif" else ["decode"]
        if info.dialog is not None:
            called += ["write_track", "write_played"]
            called += ["write_raster", "write_signals"] if info.is_of_device else []
        for kind in called:
            assert not getattr(info, kind).startswith("hfx_tools."), (info.id, kind)
        for kind in ("check", "read", "read_raster", "facts"):
            assert not getattr(info, kind) or callable(info.function(kind)), (info.id, kind)


def test_left_out_commands_say_where_they_are(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(tools_package, "PACKAGE", "hfx_blender.nowhere")
    for command in ("demo", "info", "play", "bench", "texture"):
        assert cli.run([command, "--json"]) == 2
        assert f"'{command}' is not part of the extension" in capsys.readouterr().err


def test_nothing_else_strays_into_the_zip(small: Path) -> None:
    allowed = {
        "",
        ".py",
        ".c",
        ".frag",
        ".vert",
        ".h",
        ".html",
        ".toml",
        ".json",
        ".npz",
        ".md",
        ".svg",
        ".png",
        ".blend",
        ".csv",
        ".dat",
        ".hfxeffect",
        ".hfxpath",
        ".txt",
        ".whl",
    }
    for name in zipfile.ZipFile(small).namelist():
        path = Path(name)
        assert path.suffix in allowed, name
        assert path.suffix or name == "LICENSE", name
        assert not any(part.startswith((".", "__pycache__")) for part in path.parts), name


@pytest.mark.parametrize("stray", ["x.py.orig", "x.pyc", "x.tmp", ".hidden", "__pycache__/x.py"])
def test_editor_leftovers_are_left_out(
    stray: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    package = tmp_path / "hfx_blender"
    (package / stray).parent.mkdir(parents=True)
    (package / stray).touch()
    (package / "kept.py").touch()
    monkeypatch.setattr(build_addon, "PACKAGE", package)
    monkeypatch.setattr(build_addon, "DATA", ())
    assert set(build_addon.files()) == {"LICENSE", "kept.py"}


def test_no_host_and_no_home_is_named(small: Path) -> None:
    host = re.compile(rb"(index-url|file:///|/home/|/root/|\blocalhost\b)")
    with zipfile.ZipFile(small) as archive:
        for name in archive.namelist():
            # Translated messages name the hosts that a user may enter.
            is_text = name.startswith("translations/")
            if Path(name).suffix in {".toml", ".json"} and not is_text:
                assert not host.search(archive.read(name)), name
    assert re.fullmatch(r"([0-9a-f]{64}  [\w.+-]+\.whl\n)+", addon_wheels.LOCK.read_text())


def test_the_same_content_gives_the_same_bytes(wheels: Path, zig: Path, tmp_path: Path) -> None:
    build = build_addon.build_for
    first = build("linux-x64", ("3.11", "3.13"), tmp_path / "a", wheels, zig)
    second = build("linux-x64", ("3.11", "3.13"), tmp_path / "b", wheels, zig)
    assert first.name == second.name == f"hfx_blender-{hfx_blender.__version__}-linux_x64.zip"
    assert first.read_bytes() == second.read_bytes()


# Manifest


def test_the_manifest_agrees_with_the_package(small: Path) -> None:
    manifest = manifest_of(small)
    assert manifest["version"] == hfx_blender.__version__
    assert manifest["blender_version_min"] == "4.2.0"
    assert manifest["blender_version_max"] == "5.3.0", "the first that is not supported"
    assert manifest["license"] == ["SPDX:GPL-3.0-or-later"]
    assert "platforms" not in manifest


def test_the_small_zip_brings_the_library_to_every_platform(small: Path) -> None:
    names = [name.removeprefix("./") for name in manifest_of(small)["wheels"]]
    assert [name for name in names if "/hfx_native-" not in name] == [
        "wheels/pyserial-3.5-py2.py3-none-any.whl",
        "wheels/python_osc-1.10.2-py3-none-any.whl",
        "wheels/websockets-17.4-py3-none-any.whl",
    ]
    names = [name for name in names if "/hfx_native-" in name]
    tags = [name[: -len(".whl")].split("-")[-1] for name in names]
    for platform in addon_wheels.PLATFORMS.values():
        assert sum(platform.runs(tag) for tag in tags) == 1
    with zipfile.ZipFile(small) as archive:
        assert [name for name in archive.namelist() if "/hfx_native-" in name] == names
        own = max(archive.getinfo(name).compress_size for name in names)
    size = small.stat().st_size + (len(names) - 1) * own  # the rest are stand-ins
    for page, sentence in (
        ("docs/install.md", r"\((\d+) MB\), as"),
        ("docs/native.md", r", (\d+) MB, b"),
    ):
        (figure,) = re.findall(sentence, (ROOT / page).read_text(encoding="utf-8"))
        assert float(figure) == pytest.approx(size / 1e6, abs=0.7)
    done = _validated(small)
    assert done.returncode == 0, done.stdout + done.stderr


def test_the_small_zip_may_be_without_the_library(wheels: Path, tmp_path: Path) -> None:
    names = manifest_of(build_addon.build_small(tmp_path, wheels))["wheels"]
    actual = [name.removeprefix("./wheels/").partition("-")[0] for name in names]
    assert actual == ["pyserial", "python_osc", "websockets"]


def test_only_the_permissions_that_are_used_are_asked_for(small: Path) -> None:
    permissions = manifest_of(small)["permissions"]
    source = "\n".join(
        path.read_text(encoding="utf-8") for path in (ROOT / "hfx_blender").rglob("*.py")
    )
    used = {"files"}  # exports
    if re.search(r"^\s*(import|from) (socket|ssl|http|urllib\.request|asyncio)\b", source, re.M):
        used.add("network")
    if "wm.clipboard" in source or "window_manager.clipboard" in source:
        used.add("clipboard")
    assert set(permissions) == used
    assert all(0 < len(reason) <= 64 and reason[-1] != "." for reason in permissions.values())


@pytest.mark.parametrize("platform", sorted(addon_wheels.PLATFORMS))
def test_blender_accepts_the_zip_of_each_platform(
    platform: str, wheels: Path, zig: Path, tmp_path: Path
) -> None:
    pythons = addon_wheels.default_pythons(platform)
    built = build_addon.build_for(platform, pythons, tmp_path, wheels, zig)
    done = _validated(built)
    assert done.returncode == 0, done.stdout + done.stderr
    manifest = manifest_of(built)
    assert manifest["platforms"] == [platform]
    assert manifest["permissions"], "the wheels did not slip into its table"
    with zipfile.ZipFile(built) as archive:
        names = {name for name in archive.namelist() if name.startswith("wheels/")}
        assert {f"./{name}" for name in names} == set(manifest["wheels"])
        for name in names:
            # Copies of changed wheels lie in the platform's folder.
            paths = [folder / Path(name).name for folder in (wheels / platform, wheels)]
            path = next(path for path in paths if path.exists())
            assert archive.read(name) == path.read_bytes()
            assert "universal2" not in name, "Blender before 4.4 does not take it"
        (own,) = [name for name in names if "/hfx_native-" in name]
        assert addon_wheels.PLATFORMS[platform].runs(own[: -len(".whl")].split("-")[-1])


def _validated(path: Path) -> subprocess.CompletedProcess[str]:
    """Passes Blender's check of an extension."""
    tools = "bpy/*/scripts/addons_core/bl_pkg/cli/blender_ext.py"
    tool = next(actual for folder in sys.path for actual in Path(folder or ".").glob(tools))
    return subprocess.run([sys.executable, tool, "validate", path], capture_output=True, text=True)


# In Blender

INSTALL = """
import os, subprocess, sys
from pathlib import Path
import bpy
import addon_utils
from strange_modules import RAN, fill

package, name = sys.argv[1], "bl_ext.user_default.hfx_blender"
addon_utils.enable("bl_pkg")
bpy.ops.extensions.package_install_files(
    filepath=package, repo="user_default", enable_on_install=True
)
assert name in bpy.context.preferences.addons
bpy.ops.hfx.add_avatar()
bpy.ops.hfx.add_volume(modality="vibration", shape="SPHERE")
assert "hfx_blender" not in sys.modules, "imported from elsewhere"
for _ in range(2):
    bpy.ops.preferences.addon_disable(module=name)
    assert not hasattr(bpy.types.Object, "hfx")
    bpy.ops.preferences.addon_enable(module=name)
assert bpy.context.object.hfx.role == "EFFECT"
from bl_ext.user_default.hfx_blender.processes import start

# Beside other extensions, of which some are named as modules of Python; so are wheels of theirs.
strange, *kinds = sys.argv[2:]
beside = Path(start.__file__).parents[2]
wheels = Path(strange).parent / "site-packages"
fill(beside)
fill(wheels, only_known=True)
sys.path.append(str(wheels))
children = [
    start.start(
        start.command(kind),
        {"PYTHONPROFILEIMPORTTIME": "1"},
        cwd=strange,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    for kind in kinds
]
for kind, process in zip(kinds, children):
    told = process.communicate()[1]
    assert RAN not in told, f"{kind}: {told[told.index(RAN):]}"
    assert "hfx_blender.errors" in told, f"{kind} came not to its own imports: {told}"
index = bpy.context.preferences.extensions.repos.find("User Default")
bpy.ops.extensions.package_uninstall(repo_index=index, pkg_id="hfx_blender")
assert not [each for each in sys.modules if each.startswith(name)]
print("installed and gone", flush=True)
os._exit(0)
"""


def test_the_extension_is_installed_used_switched_and_uninstalled(
    small: Path, tmp_path: Path
) -> None:
    pytest.importorskip("bpy")
    resources = tmp_path / "resources"
    resources.mkdir()
    fill(tmp_path / "strange")
    done = subprocess.run(
        [sys.executable, "-c", INSTALL, str(small), str(tmp_path / "strange"), *SHIPPED_CHILDREN],
        env={
            **os.environ,
            "BLENDER_USER_RESOURCES": str(resources),
            "PYTHONPATH": str(Path(__file__).parents[1]),  # of strange_modules
        },
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        cwd=tmp_path,
    )
    assert done.stdout.rstrip().endswith("installed and gone"), done.stdout + done.stderr
    assert "Traceback" not in done.stdout + done.stderr
    assert not [path for path in resources.rglob("*") if "hfx" in path.name]


BARE = """
import importlib, os, pkgutil, subprocess, sys
import bpy
import addon_utils

addon_utils.enable("bl_pkg")
bpy.ops.extensions.package_install_files(
    filepath=sys.argv[1], repo="user_default", enable_on_install=True
)
name = "bl_ext.user_default.hfx_blender"
package = importlib.import_module(name)
count = 0
for module in pkgutil.walk_packages(package.__path__, name + "."):
    if not module.name.endswith("__main__"):  # it runs where it is imported
        importlib.import_module(module.name)
        count += 1
import fast_simplification, scipy.sparse.linalg, trimesh.graph

strays = [
    module.__file__
    for module in list(sys.modules.values())
    if (getattr(module, "__file__", None) or "").startswith(sys.argv[2])
    and module.__name__.partition(".")[0] not in sys.argv[3:]
]
assert not strays, strays

# Live devices, in this process and in one that plays on devices.
DEVICES = '''
import os
from PACKAGE.devices.configuration import load_device
from PACKAGE.devices.live.discovery import serial_ports
from PACKAGE.devices.host.output import OutputLostError
from PACKAGE.devices.transports.serial_port import SerialPort
from PACKAGE.devices.transports.sound_card import SoundCard
from PACKAGE.devices.transports.websocket import WebSocket
import serial.tools.list_ports
import socket

board, end = os.openpty()
port = SerialPort(os.ttyname(end), 115200)
port.write_newest(b"to the board")
assert os.read(board, 100) == b"to the board"
os.write(board, b"from it")
assert port.read() == b"from it"
port.close()
assert len(serial_ports()) == len(serial.tools.list_ports.comports())
try:
    SoundCard(load_device("sound_card_8"), "no such card").close()
except OutputLostError as error:
    assert "portaudio" in str(error).lower() or "no such card" in str(error), error
import _cffi_backend
with socket.create_server(("127.0.0.1", 0)) as nobody:
    at = nobody.getsockname()
try:
    WebSocket(*at, "/", print)
except OutputLostError as error:
    assert "does not answer" in str(error), error
print("devices are there", flush=True)
'''
exec(DEVICES.replace("PACKAGE", name))
own = importlib.import_module(name + ".processes.start")
command = [*own.python_command(), "-c", DEVICES.replace("PACKAGE", "hfx_blender")]
told = own.start(command, stdout=subprocess.PIPE, text=True).communicate()[0]
assert told == "devices are there\\n", told
print(count, "modules imported", flush=True)
os._exit(0)
"""


@pytest.mark.skipif(os.name != "posix", reason="needs pseudo-terminals and symbolic links")
def test_in_a_bare_blender_every_module_imports_and_devices_open(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The zip for this computer works without the packages of the development environment."""
    bpy = pytest.importorskip("bpy")
    version = f"{sys.version_info[0]}.{sys.version_info[1]}"
    lock = addon_wheels.read_lock()
    imported = IMPORTED(PACKAGE)
    folder = tmp_path / "wheels"
    folder.mkdir()
    try:
        here = addon_wheels.select(lock, imported, build_addon.this_platform(), version)
        for name in here.values():
            pack(name, folder)
    except (metadata.PackageNotFoundError, KeyError) as error:
        pytest.skip(f"not installed here, or no wheels for this computer: {error}")
    monkeypatch.setattr(addon_wheels, "fetch", lambda name, _digest, folder: folder / name)
    built = build_addon.build_for(build_addon.this_platform(), (version,), tmp_path, folder)
    resources = tmp_path / "resources"
    resources.mkdir()
    python = bare_python(tmp_path / "bare")
    environment = {
        name: value
        for name, value in os.environ.items()
        if not name.startswith("PYTHON") and name != "VIRTUAL_ENV"
    }
    installed = Path(bpy.__file__).resolve().parents[1]
    done = subprocess.run(
        [python, "-c", BARE, str(built), str(installed), *BLENDERS_OWN],
        env={**environment, "BLENDER_USER_RESOURCES": str(resources)},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        cwd=tmp_path,
    )
    said = done.stdout + done.stderr
    assert re.search(r"devices are there\n(\d+) modules imported\n$", done.stdout), said
    assert int(done.stdout.split()[-3]) == len(SHIPPED) - 2, "all but the package and __main__"


# Wheels


@pytest.mark.parametrize("platform", sorted(addon_wheels.PLATFORMS))
def test_every_blender_gets_scipy(platform: str) -> None:
    lock = addon_wheels.read_lock()
    for python in addon_wheels.default_pythons(platform):
        actual = addon_wheels.select(lock, {"scipy"}, platform, python)
        assert set(actual) == {"scipy"}, python
        assert f"-cp{python.replace('.', '')}-" in actual["scipy"]


def test_blender_4_2_gets_a_scipy_that_knows_its_numpy() -> None:
    for platform in ("linux-x64", "macos-arm64", "macos-x64", "windows-x64"):
        actual = addon_wheels.select(addon_wheels.read_lock(), {"scipy"}, platform, "3.11")
        major, minor = actual["scipy"].split("-")[1].split(".")[:2]
        assert (int(major), int(minor)) <= (1, 15), "1.16 asks for NumPy 1.25, it has 1.24"


@pytest.mark.parametrize(
    ("tag", "platforms"),
    [
        ("manylinux_2_17_x86_64.manylinux2014_x86_64", {"linux-x64"}),
        ("manylinux_2_28_aarch64", set()),
        ("macosx_11_0_arm64", {"macos-arm64"}),
        ("macosx_10_13_x86_64", {"macos-x64"}),
        ("win_amd64", {"windows-x64"}),
        ("win_arm64", {"windows-arm64"}),
        ("win32", set()),
        ("any", set(addon_wheels.PLATFORMS)),
    ],
)
def test_wheels_go_where_they_run(tag: str, platforms: set[str]) -> None:
    name = f"scipy-1.0-cp313-cp313-{tag}.whl"
    runs = {
        platform
        for platform in addon_wheels.PLATFORMS
        if addon_wheels.select([name], {"scipy"}, platform, "3.13")
    }
    assert runs == platforms
    assert not addon_wheels.select([name], {"scipy"}, "linux-x64", "3.11")
    assert not addon_wheels.select([name], {"trimesh"}, "windows-x64", "3.13")


def test_wheels_match_the_imports_of_the_package(wheels: Path, tmp_path: Path) -> None:
    imported = addon_wheels.imported(PACKAGE)
    assert "scipy" in imported and "numpy" not in imported
    built = build_addon.build_for("linux-x64", ("3.13",), tmp_path, wheels)
    actual = {
        Path(pattern).name.split("-")[0].replace("_", "-")
        for pattern in manifest_of(built)["wheels"]
    }
    assert actual == imported
    assert built.stem.endswith("-linux_x64-py313")


def test_an_unbundled_import_stops_the_build(tmp_path: Path) -> None:
    (tmp_path / "x.py").write_text("import json\n\ndef f():\n    import pandas.core\n")
    with pytest.raises(addon_wheels.WheelError, match="'pandas', which Blender does not have"):
        addon_wheels.imported(tmp_path)


@pytest.mark.parametrize(
    "source",
    [
        "try:\n    import {}.x\nexcept ImportError:\n    pass",
        "try:\n    from {} import x\nexcept (ModuleNotFoundError, OSError):\n    x = None",
        "with suppress(ImportError):\n    import json, {}",
        "def f():\n    import {} as x",
        "class C:\n    def f(self):\n        return importlib.import_module('{}.x')",
        "x = import_module('{}')",
        "x = __import__('{}')",
        "if TYPE_CHECKING or find_spec('{}'):\n    pass",
    ],
)
def test_imports_count_anywhere_in_a_file(source: str, tmp_path: Path) -> None:
    (tmp_path / "x.py").write_text(source.format("sounddevice"))
    assert addon_wheels.imported(tmp_path) == {"sounddevice", "cffi"}
    (tmp_path / "x.py").write_text(source.format("serial"))
    assert addon_wheels.imported(tmp_path) == {"pyserial"}
    for absent in ("pandas", "matplotlib", "PIL", "distutils"):
        (tmp_path / "x.py").write_text(source.format(absent))
        with pytest.raises(addon_wheels.WheelError, match=f"'{absent}', which Blender"):
            addon_wheels.imported(tmp_path)


def test_a_computed_name_of_a_module_stops_the_build(tmp_path: Path) -> None:
    (tmp_path / "x.py").write_text("def f(name):\n    return import_module(name)\n")
    with pytest.raises(addon_wheels.WheelError, match="line 2: imports a module by a computed"):
        addon_wheels.imported(tmp_path)
    (tmp_path / "x.py").write_text("import_module('.sibling', __package__)\n")
    assert addon_wheels.imported(tmp_path) == set()


@pytest.mark.parametrize("platform", sorted(addon_wheels.PLATFORMS))
def test_every_blender_gets_all_that_the_package_imports(platform: str) -> None:
    packages = {"cffi", "fast-simplification", "pyserial", "scipy", "sounddevice", "trimesh"}
    packages |= {"python-osc", "websockets"}
    assert IMPORTED(PACKAGE) == packages
    lock = addon_wheels.read_lock()
    is_linux, is_arm = platform.startswith("linux"), platform == "windows-arm64"
    pythons = addon_wheels.PYTHONS if is_linux else addon_wheels.default_pythons(platform)
    for python in pythons:
        actual = addon_wheels.select(lock, packages, platform, python)
        assert packages - set(actual) == ({"fast-simplification"} if is_arm else set())
        assert f"-cp{python.replace('.', '')}-" in actual["cffi"]
        brings_portaudio = "-any." not in actual["sounddevice"]
        assert brings_portaudio != is_linux, actual["sounddevice"]


def test_a_missing_requirement_of_a_wheel_stops_the_build(wheels: Path, tmp_path: Path) -> None:
    lines = ["cffi", "numpy>=1.26", "pandas; extra == 'x'", "PyCParser; implementation_name != 'y'"]
    card, second_card = (
        tmp_path / "sounddevice-1-py3-none-any.whl",
        tmp_path / "cffi-1-py3-none-any.whl",
    )
    for path, required in ((card, lines), (second_card, [])):
        with zipfile.ZipFile(path, "w") as archive:
            text = "Metadata-Version: 2.4\n" + "".join(f"Requires-Dist: {r}\n" for r in required)
            archive.writestr(f"{path.stem[:-12]}.dist-info/METADATA", f"{text}\nnumpy")
    addon_wheels.check_requirements([card, second_card])
    with pytest.raises(addon_wheels.WheelError, match=r"sounddevice-1\S+: requires 'cffi'"):
        addon_wheels.check_requirements([card])


def test_a_wheel_with_other_bytes_is_refused(wheels: Path, tmp_path: Path) -> None:
    scipy = [name for name in addon_wheels.read_lock() if name.startswith("scipy-")]
    name = next(name for name in scipy if "cp313-manylinux" in name)
    (wheels / name).write_bytes((wheels / name).read_bytes() + b" ")
    with pytest.raises(addon_wheels.WheelError, match="not the file"):
        build_addon.build_for("linux-x64", ("3.13",), tmp_path, wheels)
    assert not list(tmp_path.glob("*.zip")), "nothing half built"


def test_every_bundled_wheel_has_its_licence(wheels: Path, tmp_path: Path) -> None:
    name = next(name for name in addon_wheels.read_lock() if name.startswith("scipy"))
    with zipfile.ZipFile(wheels / name, "w") as archive:
        archive.writestr("scipy-1.dist-info/METADATA", "")
    digest = hashlib.sha256((wheels / name).read_bytes()).hexdigest()
    with pytest.raises(addon_wheels.WheelError, match="carries no licence"):
        addon_wheels.fetch(name, digest, wheels)


def test_a_licence_that_a_wheel_forgets_comes_along(wheels: Path, tmp_path: Path) -> None:
    name = next(name for name in addon_wheels.read_lock() if name.startswith("pyserial"))
    wheel = addon_wheels.fetch(name, addon_wheels.read_lock()[name], wheels)
    built = build_addon.build(tmp_path, "x", build_addon.manifest([name]), [wheel])
    with zipfile.ZipFile(built) as archive:
        assert b"Redistribution and use" in archive.read("licences/pyserial.txt")


# Compiled library

LOADED = """
import os, sys
import bpy
import addon_utils

addon_utils.enable("bl_pkg")
bpy.ops.extensions.package_install_files(
    filepath=sys.argv[1], repo="user_default", enable_on_install=True
)
assert not [name for name in sys.modules if name.startswith("hfx_native")]
from bl_ext.user_default.hfx_blender.engine.native import library
assert library.library.cache_info().currsize == 0, "loaded at the start"
print(library.state(), library.library()._name if library.library() else "", flush=True)
os._exit(0)
"""


def test_the_wheel_of_the_library_is_one(zig: Path, tmp_path: Path) -> None:
    target = native_build.TARGETS["windows-x64"]
    wheel = native_wheel.make(target, tmp_path, zig)
    digest = native_build.digest()
    assert wheel.name == f"hfx_native-1.0.0+{digest}-py3-none-win_amd64.whl"
    assert addon_wheels.carries_licence(wheel)
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
        (record,) = [name for name in names if name.endswith("/RECORD")]
        lines = [line.split(",") for line in archive.read(record).decode().splitlines()]
        assert [line[0] for line in lines] == names
        for name, state, size in lines[:-1]:
            data = archive.read(name)
            actual = base64.urlsafe_b64encode(hashlib.sha256(data).digest()).rstrip(b"=").decode()
            assert (state, size) == (f"sha256={actual}", str(len(data)))
        assert f"hfx_native_{digest}/hfx_native.dll" in names


def test_the_installed_extension_loads_its_library(small: Path, tmp_path: Path) -> None:
    """The zip holds six libraries; the one for this computer is loaded."""
    pytest.importorskip("bpy")
    if native_build.this_target() is None:
        pytest.skip("no library is built for this computer")
    resources = tmp_path / "resources"
    resources.mkdir()
    environment = {**os.environ, "BLENDER_USER_RESOURCES": str(resources)}
    environment.pop("HFX_NATIVE", None)
    done = subprocess.run(
        [sys.executable, "-c", LOADED, str(small)],
        env=environment,
        capture_output=True,
        text=True,
        cwd=tmp_path,
    )
    said = done.stdout.splitlines()[-1]
    assert said.startswith(f"compiled {resources}"), done.stdout + done.stderr
    assert f"site-packages/hfx_native_{native_build.digest()}" in Path(said).as_posix()


def test_without_a_compiler_the_build_names_the_cure(
    tmp_path: Path,
    wheels: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def none(*_: object) -> Path:
        raise native_build.BuildError("there is no compiler")

    monkeypatch.setattr(native_build, "fetched_compiler", none)
    monkeypatch.setattr(build_addon, "files", dict)  # quicker
    line = ["build_addon.py", "--platform", "linux-x64", "-o", str(tmp_path), "--wheels"]
    monkeypatch.setattr(sys, "argv", [*line, str(wheels)])
    assert build_addon.main() == 3
    assert "there is no compiler" in (said := capsys.readouterr().err)
    assert "build_addon.py --without-native" in said and not list(tmp_path.glob("*.zip"))
    monkeypatch.setattr(sys, "argv", [*line, str(wheels), "--without-native"])
    assert build_addon.main() == 0
    (built,) = tmp_path.glob("*.zip")
    assert not [name for name in manifest_of(built)["wheels"] if "native" in name]
