# SPDX-License-Identifier: GPL-3.0-or-later
"""Files of a release: versions, archives with equal bytes, and the bill of materials."""

from __future__ import annotations

import configparser
import hashlib
import importlib
import json
import re
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path
from types import ModuleType

import pytest

from hfx_blender.version import __version__
from release import addon_wheels, archives, bill_of_materials, make

ROOT = Path(__file__).resolve().parents[2]


def test_all_packages_have_one_version() -> None:
    players = ROOT / "players"
    plugin = configparser.ConfigParser()
    plugin.read(players / "godot" / "addons" / "hfx" / "plugin.cfg", encoding="utf-8")
    header = (players / "core" / "hfx_player.h").read_text(encoding="utf-8")
    numbers = re.findall(r"#define HFX_PLAYER_VERSION_(?:MAJOR|MINOR|PATCH) (\d+)", header)
    manifest = (ROOT / "hfx_blender" / "blender_manifest.toml").read_text(encoding="utf-8")
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    versions = {
        "extension": tomllib.loads(manifest)["version"],
        "Godot": plugin["plugin"]["version"].strip('"'),
        "Unity": json.loads((players / "unity" / "package.json").read_bytes())["version"],
        "web": json.loads((players / "web" / "package.json").read_bytes())["version"],
        "core": ".".join(numbers),
        "citation": re.findall(r"^version: (\S+)$", citation, re.MULTILINE)[0],
        "changelog": re.findall(r"^## \[([\d.]+)\]", changelog, re.MULTILINE)[0],
    }
    assert versions == dict.fromkeys(versions, __version__)


def test_the_source_distribution_holds_all_that_git_tracks() -> None:
    tracked = subprocess.run(
        ["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=False
    ).stdout.splitlines()
    if not tracked:
        pytest.skip("not a clone")
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    listed = set(project["tool"]["hatch"]["build"]["targets"]["sdist"]["only-include"])
    assert {name.partition("/")[0] for name in tracked} - listed <= {".gitignore", ".github"}


def test_archives_of_equal_files_have_equal_bytes(tmp_path: Path) -> None:
    files = {"b/two.txt": b"2" * 999, "one.txt": b"1", "inner.whl": b"3" * 999}
    turned = dict(reversed(files.items()))
    for write, name in ((archives.write_zip, "a.zip"), (archives.write_tarball, "a.tgz")):
        first = write(tmp_path / "first" / name, files)
        second = write(tmp_path / "second" / name, turned)
        assert first.read_bytes() == second.read_bytes()
    with zipfile.ZipFile(tmp_path / "first" / "a.zip") as archive:
        entries = {entry.filename: entry for entry in archive.infolist()}
    assert entries["inner.whl"].compress_size == 999 > entries["b/two.txt"].compress_size
    with tarfile.open(tmp_path / "first" / "a.tgz") as tar:
        assert [entry.name for entry in tar] == [f"package/{name}" for name in sorted(files)]
        assert {(entry.mtime, entry.uid, entry.uname) for entry in tar} == {(0, 0, "")}


def _wheel(folder: Path, name: str, metadata: str, licence: str | None = "May be used.") -> Path:
    information = f"{'-'.join(name.split('-')[:2])}.dist-info"
    files = {f"{information}/METADATA": metadata.encode()}
    if licence:
        files[f"{information}/licenses/LICENSE.txt"] = licence.encode()
    return archives.write_zip(folder / name, files)


def test_the_bill_names_each_file_with_its_sum_and_licence(tmp_path: Path) -> None:
    artefact = tmp_path / "hfx-godot-0.1.0.zip"
    artefact.write_bytes(b"content")
    extension = tmp_path / "hfx_blender-0.1.0-linux_x64.zip"
    extension.write_bytes(b"other content")
    wheel = _wheel(
        tmp_path,
        "some_thing-2.5-py3-none-any.whl",
        "Name: some-thing\nVersion: 2.5\nLicense-Expression: MIT-0\n",
    )
    text = bill_of_materials.bill("0.1.0", [extension, artefact], [wheel])
    assert text == bill_of_materials.bill("0.1.0", [artefact, extension], [wheel])
    bill = json.loads(text)
    assert (bill["bomFormat"], bill["specVersion"], bill["version"]) == ("CycloneDX", "1.6", 1)
    components = {component["name"]: component for component in bill["components"]}
    assert components[artefact.name]["hashes"] == [
        {"alg": "SHA-256", "content": hashlib.sha256(b"content").hexdigest()}
    ]
    assert components[artefact.name]["licenses"] == [{"expression": "MIT"}]
    assert components[extension.name]["licenses"] == [{"expression": "GPL-3.0-or-later"}]
    library = components["some-thing"]
    assert library["licenses"] == [{"expression": "MIT-0"}] and library["version"] == "2.5"
    assert library["purl"].startswith("pkg:pypi/some-thing@2.5")


def test_a_distribution_without_a_known_licence_stops_the_release(tmp_path: Path) -> None:
    wheel = _wheel(tmp_path, "other-1-py3-none-any.whl", "Name: other\nVersion: 1\n")
    with pytest.raises(addon_wheels.WheelError, match=r"other-1-py3-none-any\.whl.*licence"):
        bill_of_materials.bill("0.1.0", [], [wheel])


def test_each_licence_text_stands_once_with_its_distributions(tmp_path: Path) -> None:
    wheels = [
        _wheel(tmp_path, f"{name}-1-py3-none-any.whl", f"Name: {name}\nVersion: 1\n", text)
        for name, text in (("one", "Same text."), ("two", "Same text."), ("three", "Different."))
    ]
    text = bill_of_materials.third_party_licences(wheels)
    assert text.count("Same text.") == 1 and text.count("Different.") == 1
    assert "one 1, two 1" in text and "three 1" in text


def test_a_wheel_without_a_licence_file_has_the_stored_text(tmp_path: Path) -> None:
    metadata = "Name: pyserial\nVersion: 3.5\n"
    wheel = _wheel(tmp_path, "pyserial-3.5-py2.py3-none-any.whl", metadata, licence=None)
    stored = (ROOT / "licences" / "pyserial.txt").read_text(encoding="utf-8").strip()
    assert stored in bill_of_materials.third_party_licences([wheel])


def test_first_steps_name_each_package_and_no_other() -> None:
    systems = ("linux_x64", "macos_arm64", "macos_x64", "windows_arm64", "windows_x64")
    zips = [f"blender/hfx_blender-{__version__}-{tag}.zip" for tag in (*systems, "no_wheels")]
    games = [
        f"games/hfx-godot-{__version__}.zip",
        f"games/hfx-web-{__version__}.tgz",
        f"games/hfx-core-{__version__}.zip",
        f"games/org.hfx.haptics-{__version__}.tgz",
    ]
    named = re.findall(r"`((?:blender|games)/\S+)`", make.start_here())
    assert sorted(set(named)) == sorted(zips + games)
    assert "{" not in make.start_here()


def test_the_core_package_leads_to_first_values_with_files_of_its_own(tmp_path: Path) -> None:
    with zipfile.ZipFile(make.core_package(tmp_path)) as archive:
        names = set(archive.namelist())
        text = archive.read("README.md").decode()
    commands = re.findall(r"^    (.+)$", text, re.MULTILINE)
    assert commands[0].startswith("cmake -S examples/c") and "garage.hfxclip" in commands[1]
    assert {"examples/c/CMakeLists.txt", "garage.hfxclip"} <= names
    folders = {f"{name.partition('/')[0]}/" for name in names if "/" in name}
    listed = re.findall(r"^\| `([^`]+)`", text, re.MULTILINE)
    assert all(entry in names | folders for entry in listed) and len(listed) == 5


def test_the_description_for_pypi_has_whole_addresses(monkeypatch: pytest.MonkeyPatch) -> None:
    """PyPI resolves no relative address, and shows pictures of GitHub's ``raw`` addresses."""
    module = ModuleType("interface")
    module.MetadataHookInterface = object  # type: ignore[attr-defined]
    for name in ("hatchling", "hatchling.metadata", "hatchling.metadata.plugin"):
        monkeypatch.setitem(sys.modules, name, ModuleType(name))
    monkeypatch.setitem(sys.modules, "hatchling.metadata.plugin.interface", module)
    monkeypatch.delitem(sys.modules, "release.hatch_metadata", raising=False)
    hook = importlib.import_module("release.hatch_metadata")
    text = "![a\nb](docs/p.webp) [c](x.md#y) [d](https://e.org/z) [f](#g) [h](mailto:i@j.k)"
    assert hook.with_addresses(text, "https://github.com/o/n", "v1.2.3") == (
        "![a\nb](https://github.com/o/n/raw/v1.2.3/docs/p.webp) "
        "[c](https://github.com/o/n/blob/v1.2.3/x.md#y) "
        "[d](https://e.org/z) [f](#g) [h](mailto:i@j.k)"
    )
