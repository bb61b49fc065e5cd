# SPDX-License-Identifier: GPL-3.0-or-later
"""Files of a release: versions, archives with equal bytes, and the bill of materials."""

from __future__ import annotations

import configparser
import hashlib
import importlib
import json
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path
from types import ModuleType

import pytest

from hfx_blender.version import __version__
from release import addon_wheels, archives, bill_of_materials, bundled_libraries, make

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


ELF = b"\x7fELF" + b"\0" * 60


def _wheel(
    folder: Path,
    name: str,
    metadata: str,
    licence: str | None = "May be used.",
    **libraries: bytes,
) -> Path:
    """Write a wheel; ``libraries`` are names in the wheel, with ``__`` for a dot, and contents."""
    information = f"{'-'.join(name.split('-')[:2])}.dist-info"
    files = {f"{information}/METADATA": metadata.encode()}
    files |= {f"lib/{key.replace('__', '.')}": data for key, data in libraries.items()}
    files[f"{information}/RECORD"] = "".join(f"{file},,\n" for file in sorted(files)).encode()
    if licence:
        files[f"{information}/licenses/LICENSE.txt"] = licence.encode()
    return archives.write_zip(folder / name, files)


def _extension(folder: Path, *wheels: Path, platform: str = "linux-x64") -> Path:
    files = {f"wheels/{wheel.name}": wheel.read_bytes() for wheel in wheels}
    files["blender_manifest.toml"] = f'platforms = ["{platform}"]\n'.encode()
    return archives.write_zip(folder / f"hfx_blender-0.1.0-{platform}.zip", files)


def _sha(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def test_the_bill_names_each_file_with_its_sum_and_licence(tmp_path: Path) -> None:
    artefact = tmp_path / "hfx-godot-0.1.0.zip"
    archives.write_zip(artefact, {"a.txt": b"content"})
    wheel = _wheel(
        tmp_path,
        "some_thing-2.5-py3-none-any.whl",
        "Name: some-thing\nVersion: 2.5\nLicense-Expression: MIT-0\n",
    )
    extension = _extension(tmp_path, wheel)
    pinned = {wheel.name: _sha(wheel.read_bytes())}
    text = bill_of_materials.bill("0.1.0", [extension, artefact], pinned)
    assert text == bill_of_materials.bill("0.1.0", [artefact, extension], pinned)
    bill = json.loads(text)
    assert (bill["bomFormat"], bill["specVersion"], bill["version"]) == ("CycloneDX", "1.6", 1)
    components = {component["name"]: component for component in bill["components"]}
    assert components[artefact.name]["hashes"] == [
        {"alg": "SHA-256", "content": _sha(artefact.read_bytes())}
    ]
    assert components[artefact.name]["licenses"] == [{"expression": "MIT"}]
    assert components[extension.name]["licenses"] == [{"expression": "GPL-3.0-or-later"}]
    library = components["some-thing"]
    assert library["licenses"] == [{"expression": "MIT-0"}] and library["version"] == "2.5"
    assert library["purl"].startswith("pkg:pypi/some-thing@2.5")
    assert "pedigree" not in library


def test_the_bill_lists_what_lies_in_each_file_and_no_more(tmp_path: Path) -> None:
    """Wheels and libraries of a zip are its dependencies; pinned wheels of no zip are absent."""
    metadata = "Name: scipy\nVersion: 1\n"
    scipy = _wheel(
        tmp_path,
        "scipy-1-cp313-cp313-win_arm64.whl",
        metadata,
        **{"msvcp140-5f__dll": b"MZ1", "_core__cp313-win_arm64__pyd": b"MZ2"},
    )
    own = _wheel(
        tmp_path,
        "hfx_native-1.0.0+ab-py3-none-win_arm64.whl",
        "Name: hfx_native\nVersion: 1.0.0+ab\nLicense-Expression: GPL-3.0-or-later\n",
        hfx_native__dll=b"MZ3",
    )
    extension = _extension(tmp_path, scipy, own, platform="windows-arm64")
    pinned = {
        scipy.name: _sha(scipy.read_bytes()),
        "scipy-1-cp314-cp314-win_arm64.whl": "0" * 64,  # in no file
    }
    text = bill_of_materials.bill("0.1.0", [extension], pinned)
    assert "cp314" not in text
    bill = json.loads(text)
    needs = {row["ref"]: row.get("dependsOn", []) for row in bill["dependencies"]}
    runtime = f"{scipy.name}/lib/msvcp140-5f.dll"
    assert needs["hfx-blender"] == [extension.name]
    assert needs[extension.name] == [own.name, scipy.name]
    assert needs[scipy.name] == [runtime] and needs[runtime] == []
    refs = [component["bom-ref"] for component in bill["components"]]
    assert sorted(refs) == sorted(set(needs) - {"hfx-blender"})
    (component,) = (c for c in bill["components"] if c["bom-ref"] == runtime)
    assert component["hashes"] == [{"alg": "SHA-256", "content": _sha(b"MZ1")}]
    assert component["licenses"] == [{"expression": "LicenseRef-Microsoft-Distributable-Code"}]


def test_the_bill_follows_the_schema_of_cyclonedx(tmp_path: Path) -> None:
    """Read by the library of the OWASP foundation, which holds the schema."""
    validation = pytest.importorskip("cyclonedx.validation.json")
    schema = pytest.importorskip("cyclonedx.schema")
    wheel = _wheel(
        tmp_path,
        "sounddevice-1-py3-none-win_amd64.whl",
        "Name: sounddevice\nVersion: 1\nLicense-Expression: MIT\n",
        **{"libportaudio64bit__dll": b"MZ1", "libportaudio64bit-asio__dll": b"MZ2"},
    )
    pinned = {wheel.name: _sha(wheel.read_bytes())}
    changed = bundled_libraries.for_platform(wheel, "windows-x64")
    extension = _extension(tmp_path, changed, platform="windows-x64")
    text = bill_of_materials.bill("0.1.0", [extension], pinned)
    assert '"pedigree"' in text and pinned[wheel.name] in text
    validator = validation.JsonStrictValidator(schema.SchemaVersion.V1_6)
    assert validator.validate_str(text) is None
    assert validator.validate_str(text.replace('"bom-ref"', '"bomref"')) is not None


def test_a_distribution_without_a_known_licence_stops_the_release(tmp_path: Path) -> None:
    wheel = _wheel(tmp_path, "other-1-py3-none-any.whl", "Name: other\nVersion: 1\n")
    with pytest.raises(addon_wheels.WheelError, match=r"other-1-py3-none-any\.whl.*licence"):
        bill_of_materials.bill("0.1.0", [_extension(tmp_path, wheel)], {})


def test_a_wheel_that_is_not_pinned_stops_the_release(tmp_path: Path) -> None:
    metadata = "Name: other\nVersion: 1\nLicense-Expression: MIT\n"
    wheel = _wheel(tmp_path, "other-1-py3-none-any.whl", metadata)
    with pytest.raises(addon_wheels.WheelError, match=r"pins no wheel of other"):
        bill_of_materials.bill("0.1.0", [_extension(tmp_path, wheel)], {})


@pytest.mark.parametrize(
    ("name", "content"),
    [("libother-1__so__2", b""), ("other__dll", b"MZ"), ("other__bin", ELF)],
    ids=["by name", "by name of Windows", "by content"],
)
def test_a_library_of_an_unknown_project_stops_the_release(
    name: str, content: bytes, tmp_path: Path
) -> None:
    metadata = "Name: trimesh\nVersion: 1\n"
    wheel = _wheel(tmp_path, "trimesh-1-py3-none-any.whl", metadata, **{name: content})
    extension = _extension(tmp_path, wheel)
    pinned = {wheel.name: _sha(wheel.read_bytes())}
    message = rf"trimesh-1-py3-none-any\.whl.*{name.replace('__', '.')}.*unknown project"
    for write in (
        lambda: bill_of_materials.bill("0.1.0", [extension], pinned),
        lambda: bill_of_materials.third_party_licences([extension]),
    ):
        with pytest.raises(addon_wheels.WheelError, match=message):
            write()


def test_an_unknown_library_of_a_package_for_games_stops_the_release(tmp_path: Path) -> None:
    files = {"package/Plugins/libhfx_haptics.so": ELF, "package/Plugins/libfmod.so": ELF}
    names = {name.removeprefix("package/"): data for name, data in files.items()}
    package = archives.write_tarball(tmp_path / "org.hfx.haptics-0.1.0.tgz", names)
    with pytest.raises(addon_wheels.WheelError, match=r"libfmod\.so"):
        bill_of_materials.third_party_licences([package])


@pytest.mark.parametrize(
    ("file", "name", "expression"),
    [
        ("libgomp-e985bcbb.so.1.0.0", "libgomp", "GPL-3.0-or-later WITH GCC-exception-3.1"),
        ("libgfortran.5.dylib", "libgfortran", "GPL-3.0-or-later WITH GCC-exception-3.1"),
        ("libquadmath-96973f99-934c22de.so.0.0.0", "libquadmath", "LGPL-2.1-or-later"),
        ("libportaudio.dylib", "PortAudio", "MIT"),
        ("libscipy_openblas-68440149.so", "OpenBLAS", "BSD-3-Clause AND BSD-3-Clause-Open-MPI"),
        ("_cffi_backend.cpython-313-x86_64-linux-gnu.so", "libffi", "MIT"),
        ("_cffi_backend.cp313-win_arm64.pyd", "libffi", "MIT"),
        ("_cffi_backend.cpython-313-darwin.so", None, None),  # the system's libffi
        ("hfx_haptics.dll", "hfx_haptics", "MIT AND ZPL-2.1"),
        ("libhfx_haptics.so", "hfx_haptics", "MIT"),
        ("libportaudio64bit-asio.dll", None, None),  # Steinberg's ASIO
    ],
)
def test_libraries_of_pinned_wheels_have_their_licence(
    file: str, name: str | None, expression: str | None
) -> None:
    """Expressions of the projects' licence files: GCC's COPYING.RUNTIME, PortAudio's LICENSE."""
    library = bundled_libraries.library_of(f"some.libs/{file}")
    assert (library and library.name, library and library.expression) == (name, expression)


def test_stored_texts_of_libraries_exist_and_are_used() -> None:
    used = {row.text for row in bundled_libraries.LIBRARIES if row.text}
    texts = {path.name for path in (ROOT / "licences").iterdir()}
    assert used == texts - {"pyserial.txt", "python_osc.txt"}  # licences of distributions


@pytest.mark.parametrize(
    ("platform", "tag", "present"),
    [
        ("windows-x64", "win_amd64", "libportaudio64bit.dll"),
        ("windows-arm64", "win_arm64", "libportaudioarm64.dll"),
        ("macos-arm64", "macosx_11_0_arm64", "libportaudio.dylib"),
    ],
)
def test_sounddevice_keeps_the_portaudio_of_the_platform_without_asio(
    platform: str, tag: str, present: str, tmp_path: Path
) -> None:
    published = "macosx_10_6_universal2" if tag.startswith("macosx") else tag
    names = ("libportaudio.dylib", "libportaudio64bit.dll", "libportaudio64bit-asio.dll")
    names += ("libportaudioarm64.dll", "libportaudioarm64-asio.dll", "libportaudio32bit.dll")
    wheel = _wheel(
        tmp_path,
        f"sounddevice-1-py3-none-{published}.whl",
        "Name: sounddevice\nVersion: 1\n",
        **{name.replace(".", "__"): name.encode() for name in names},
    )
    before = wheel.read_bytes()
    changed = bundled_libraries.for_platform(wheel, platform)
    assert changed.name == f"sounddevice-1-py3-none-{tag}.whl" and wheel.read_bytes() == before
    with zipfile.ZipFile(changed) as archive:
        files = [name for name in archive.namelist() if name.startswith("lib/")]
        record = archive.read("sounddevice-1.dist-info/RECORD").decode()
        assert archive.read(f"lib/{present}") == present.encode()
    assert files == [f"lib/{present}"]
    assert record == f"lib/{present},,\nsounddevice-1.dist-info/METADATA,,\n"


def test_each_licence_text_stands_once_with_its_distributions(tmp_path: Path) -> None:
    wheels = [
        _wheel(
            tmp_path,
            f"{name}-1-py3-none-any.whl",
            f"Name: {name}\nVersion: 1\nLicense-Expression: MIT\n",
            text,
            **libraries,
        )
        for name, text, libraries in (
            ("one", "Same text.", {}),
            ("two", "Same text.", {"libgomp-1__so__1": ELF}),
            ("three", "Different.", {}),
        )
    ]
    text = bill_of_materials.third_party_licences([_extension(tmp_path, *wheels)])
    assert text.count("Same text.") == 1 and text.count("Different.") == 1
    assert "\none 1, two 1\n" in text and "\nthree 1\n" in text
    assert "two 1, libgomp-1.so.1: libgomp, GPL-3.0-or-later WITH GCC-exception-3.1" in text
    assert text.count("GCC RUNTIME LIBRARY EXCEPTION") == 1


def test_a_wheel_without_a_licence_file_has_the_stored_text(tmp_path: Path) -> None:
    metadata = "Name: pyserial\nVersion: 3.5\n"
    wheel = _wheel(tmp_path, "pyserial-3.5-py2.py3-none-any.whl", metadata, licence=None)
    stored = (ROOT / "licences" / "pyserial.txt").read_text(encoding="utf-8").strip()
    assert stored in bill_of_materials.third_party_licences([_extension(tmp_path, wheel)])


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


def test_the_sums_name_each_file_of_the_folder_but_themselves(tmp_path: Path) -> None:
    """Read by ``sha256sum`` of GNU, where that is installed."""
    folders = {"python/a.whl": b"1", "site/assets/b.js": b"2", "START-HERE.md": b"3"}
    for name, content in folders.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(content)
    text = make.sums(tmp_path)
    (tmp_path / make.SUMS).write_text(text, encoding="utf-8")
    assert make.sums(tmp_path) == text
    lines = dict(reversed(line.split("  ")) for line in text.splitlines())
    assert lines == {name: _sha(content) for name, content in folders.items()}
    program = shutil.which("sha256sum")
    if program:
        command = [program, "--check", "--strict", make.SUMS]
        assert subprocess.run(command, cwd=tmp_path, check=False).returncode == 0
        (tmp_path / "START-HERE.md").write_bytes(b"4")
        assert subprocess.run(command, cwd=tmp_path, check=False).returncode == 1


def test_a_site_without_an_address_has_no_map(tmp_path: Path) -> None:
    pytest.importorskip("material", reason="needs mkdocs-material")
    site = make.site(tmp_path / "site")
    assert (site / "index.html").is_file() and (site / "install.html").is_file()
    assert list(site.glob("sitemap*")) == []
    licences = (site / "THIRD-PARTY-LICENCES.txt").read_text(encoding="utf-8")
    assert "Martin Donath" in licences and "Permission is hereby granted" in licences


def test_the_core_package_leads_to_first_values_with_files_of_its_own(tmp_path: Path) -> None:
    with zipfile.ZipFile(make.core_package(tmp_path)) as archive:
        names = set(archive.namelist())
        text = archive.read("README.md").decode()
    commands = re.findall(r"^    (.+)$", text, re.MULTILINE)
    assert commands[0].startswith("cmake -S examples/c") and "garage.hfxclip" in commands[1]
    assert {"examples/c/CMakeLists.txt", "garage.hfxclip"} <= names
    folders = {f"{name.partition('/')[0]}/" for name in names if "/" in name}
    listed = re.findall(r"^\| `([^`]+)`", text, re.MULTILINE)
    assert all(entry in names | folders for entry in listed) and len(listed) == 6


@pytest.fixture
def description_hook(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """Module of the metadata hook, with a stand-in for hatchling."""
    module = ModuleType("interface")
    module.MetadataHookInterface = object  # type: ignore[attr-defined]
    for name in ("hatchling", "hatchling.metadata", "hatchling.metadata.plugin"):
        monkeypatch.setitem(sys.modules, name, ModuleType(name))
    monkeypatch.setitem(sys.modules, "hatchling.metadata.plugin.interface", module)
    monkeypatch.delitem(sys.modules, "release.hatch_metadata", raising=False)
    return importlib.import_module("release.hatch_metadata")


def test_the_description_for_pypi_has_whole_addresses(description_hook: ModuleType) -> None:
    """PyPI resolves no relative address, and shows pictures of GitHub's ``raw`` addresses."""
    text = "![a\nb](docs/p.webp) [c](x.md#y) [d](https://e.org/z) [f](#g) [h](mailto:i@j.k)"
    assert description_hook.with_addresses(text, "https://github.com/o/n", "v1.2.3") == (
        "![a\nb](https://github.com/o/n/raw/v1.2.3/docs/p.webp) "
        "[c](https://github.com/o/n/blob/v1.2.3/x.md#y) "
        "[d](https://e.org/z) [f](#g) [h](mailto:i@j.k)"
    )


@pytest.mark.parametrize("repository", ["", "https://github.com/o/n/"])
def test_the_description_for_pypi_works_without_a_clone(
    repository: str, description_hook: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its commands need no file of the repository, and no link is relative."""
    monkeypatch.setenv("HFX_REPOSITORY", repository)
    hook = description_hook.ReadmeHook()
    hook.root = str(ROOT)
    metadata = {"version": "0.1.0"}
    hook.update(metadata)
    text = metadata["readme"]["text"]  # type: ignore[index]
    assert text.startswith("# HFX for Blender\n") and text.count("\n## Install\n") == 1
    for command in ("-e .", "build_addon.py", "release/", "pytest"):
        assert command not in re.sub(r"\]\([^)]*\)", "]", text), command
    assert "pip install hfx-blender && hfx demo" in text
    addresses = re.findall(r"\]\(([^)]*)\)", text)
    relative = [address for address in addresses if not re.match(r"#|https://", address)]
    assert relative == [] and bool(re.search(r"!\[", text)) == bool(repository)
    captions = [line for line in text.splitlines() if line in ("Guide for creators", "All pages.")]
    assert captions == [] and "Guide for pipelines" not in re.sub(r"\[.*?\]", "", text)
    for section in ("Supported Blenders", "Quick start", "Limits and safety", "Licence"):
        assert re.search(rf"^##+ {section}$", text, re.MULTILINE), section
