# SPDX-License-Identifier: GPL-3.0-or-later
"""Bill of materials (CycloneDX 1.6) and licences of other projects in the files of a release."""

from __future__ import annotations

import email
import email.message
import hashlib
import io
import json
import tomllib
import uuid
import zipfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from . import addon_wheels, native_wheel
from .addon_wheels import LICENCES, OFFICIAL, WheelError
from .bundled_libraries import Library, libraries, member

_OWN = "GPL-3.0-or-later"
_PLAYERS = "MIT"  # of the packages for games
# SPDX expressions of distributions whose metadata has a licence without an SPDX expression.
_EXPRESSIONS = {
    "fast-simplification": "MIT",
    "pyserial": "BSD-3-Clause",
    "python-osc": "Unlicense",
    "scipy": "BSD-3-Clause",
    "trimesh": "MIT",
}
_LICENCE_FILES = ("LICENSE", "LICENCE", "COPYING", "NOTICE")
_CHANGE = "Libraries of further systems and libraries with ASIO are left out; see RECORD."


class Wheel(NamedTuple):
    """A wheel inside an extension: file name, content, and Blender's name of the platform, empty
    in the small extension."""

    name: str
    content: bytes
    platform: str

    @property
    def is_own(self) -> bool:
        return self.name.startswith(f"{native_wheel.NAME}-")


def wheels_in(extension: Path) -> list[Wheel]:
    """Wheels inside an extension, sorted by name; empty for other packages of a release."""
    if extension.suffix != ".zip":
        return []
    with zipfile.ZipFile(extension) as archive:
        names = sorted(name for name in archive.namelist() if name.endswith(".whl"))
        if not names:
            return []
        manifest = tomllib.loads(archive.read("blender_manifest.toml").decode())
        platform = "".join(manifest.get("platforms", [])[:1])
        return [Wheel(name.rpartition("/")[2], archive.read(name), platform) for name in names]


def bill(version: str, artefacts: Iterable[Path], pinned: Mapping[str, str]) -> str:
    """Text of the bill of materials as JSON; equal files give equal text.

    Parameters
    ----------
    version : str
        Version of the release.
    artefacts : iterable of Path
        Files of the release, named without their folder. The wheels and libraries inside are
        components, too, and the dependencies of their file.
    pinned : mapping of str to str
        Name -> SHA-256 of the wheels published by their projects (``addon_wheels.read_lock``).

    Raises
    ------
    WheelError
        A licence is unknown, or two wheels have one name.
    """
    components: dict[str, dict[str, Any]] = {}
    needs: dict[str, list[str]] = {"hfx-blender": []}
    for path in sorted(artefacts):
        needs["hfx-blender"].append(path.name)
        components[path.name] = {
            "type": "file",
            "bom-ref": path.name,
            "name": path.name,
            "version": version,
            "hashes": [_hash(path.read_bytes())],
            "licenses": [{"expression": _PLAYERS if _is_player(path) else _OWN}],
        }
        wheels = wheels_in(path)
        package = Wheel(path.name, path.read_bytes(), "")
        direct = {k: v for k, v in libraries(path.name, package.content).items() if "!" not in k}
        needs[path.name] = [wheel.name for wheel in wheels]
        needs[path.name] += [f"{path.name}/{name}" for name in sorted(direct)]
        for name, library in direct.items():
            components[f"{path.name}/{name}"] = _library(package, name, library)
        for wheel in wheels:
            component = _distribution(wheel, pinned)
            if components.setdefault(wheel.name, component) != component:
                raise WheelError(f"{wheel.name}: two wheels of different content have this name.")
            inside = libraries(wheel.name, wheel.content)
            needs[wheel.name] = [f"{wheel.name}/{name}" for name in sorted(inside)]
            for name, library in inside.items():
                components[f"{wheel.name}/{name}"] = _library(wheel, name, library)
    content = json.dumps(components, sort_keys=True).encode()
    serial = uuid.UUID(bytes=hashlib.sha256(content).digest()[:16], version=4)
    document = {
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "serialNumber": f"urn:uuid:{serial}",
        "version": 1,
        "metadata": {
            "component": {
                "type": "application",
                "bom-ref": "hfx-blender",
                "name": "hfx-blender",
                "version": version,
                "licenses": [{"expression": _OWN}],
            }
        },
        "components": list(components.values()),
        "dependencies": [
            {"ref": ref, "dependsOn": refs} if refs else {"ref": ref}
            for ref, refs in ({key: [] for key in components} | needs).items()
        ],
    }
    return json.dumps(document, indent=2) + "\n"


def third_party_licences(artefacts: Iterable[Path]) -> str:
    """Licences of the other projects inside files of a release.

    A list names each distribution and library with its licence; each different text follows once.

    Raises
    ------
    WheelError
        A library has no row in ``bundled_libraries.LIBRARIES``, or a licence is unknown.
    """
    texts: dict[str, set[str]] = {}
    rows = set()
    for path in sorted(artefacts):
        # An unknown library of any file is an error.
        for file, library in libraries(path.name, path.read_bytes()).items():
            if library.text and "!" not in file:
                rows.add(f"{path.name}, {file}: {library.name}, {library.expression}")
                text = (LICENCES / library.text).read_text(encoding="utf-8")
                texts.setdefault(text, set()).add(f"libraries for Windows in {path.name}")
        for wheel in wheels_in(path):
            if wheel.is_own:
                continue
            facts = _metadata(wheel)
            name = f"{facts['Name']} {facts['Version']}"
            rows.add(f"{name}: {_expression(wheel, facts)}")
            for text in _licence_texts(wheel):
                texts.setdefault(text, set()).add(name)
            for file, library in libraries(wheel.name, wheel.content).items():
                base = file.rpartition("/")[2]
                rows.add(f"{name}, {base}: {library.name}, {library.expression}")
                if library.text:
                    text = (LICENCES / library.text).read_text(encoding="utf-8")
                    texts.setdefault(text, set()).add(f"{library.name} in {name}")
    head = "Other projects inside the extensions (SPDX expressions of their licences):\n\n"
    parts = [
        f"{'=' * 80}\n{', '.join(sorted(names))}\n{'=' * 80}\n\n{text.strip()}\n"
        for text, names in sorted(texts.items(), key=lambda item: sorted(item[1]))
    ]
    return "\n".join([head + "".join(f"{row}\n" for row in sorted(rows)), *parts])


def _distribution(wheel: Wheel, pinned: Mapping[str, str]) -> dict[str, Any]:
    """Component of a wheel; a changed wheel names the published wheel as its ancestor."""
    facts = _metadata(wheel)
    name = str(facts["Name"]).lower().replace("_", "-")
    component = {
        "type": "library",
        "bom-ref": wheel.name,
        "name": name,
        "version": facts["Version"],
        "hashes": [_hash(wheel.content)],
        "licenses": [{"expression": _expression(wheel, facts)}],
    }
    if wheel.is_own:
        return component
    published = wheel.name
    if component["hashes"][0]["content"] not in pinned.values():
        distribution = wheel.name.partition("-")[0].replace("_", "-")
        chosen = addon_wheels.select(pinned, {distribution}, wheel.platform, OFFICIAL[0])
        if distribution not in chosen:
            raise WheelError(f"{wheel.name}: {addon_wheels.LOCK.name} pins no wheel of {name}.")
        published = chosen[distribution]
        ancestor = {
            "type": "library",
            "name": published,
            "version": facts["Version"],
            "hashes": [{"alg": "SHA-256", "content": pinned[published]}],
        }
        component["pedigree"] = {"ancestors": [ancestor], "notes": _CHANGE}
    component["purl"] = f"pkg:pypi/{name}@{facts['Version']}?file_name={published}"
    return component


def _library(wheel: Wheel, name: str, library: Library) -> dict[str, Any]:
    content = member(wheel.name, wheel.content, name)
    component = {
        "type": "library",
        "bom-ref": f"{wheel.name}/{name}",
        "name": library.name,
        "description": name,
        "hashes": [_hash(content)],
        "licenses": [{"expression": library.expression}],
    }
    if library.source:
        component["externalReferences"] = [{"type": "website", "url": library.source}]
    return component


def _expression(wheel: Wheel, facts: email.message.Message) -> str:
    """SPDX expression of a distribution's licence."""
    name = str(facts["Name"]).lower().replace("_", "-")
    expression = facts.get("License-Expression") or _EXPRESSIONS.get(name)
    if expression is None:
        raise WheelError(
            f"{wheel.name}: its metadata has no SPDX expression of its licence; add the expression "
            f"to {Path(__file__).name}."
        )
    return str(expression)


def _hash(content: bytes) -> dict[str, str]:
    return {"alg": "SHA-256", "content": hashlib.sha256(content).hexdigest()}


def _is_player(path: Path) -> bool:
    return path.name.startswith(("hfx-godot", "hfx-web", "hfx-core", "org.hfx."))


def _metadata(wheel: Wheel) -> email.message.Message:
    with zipfile.ZipFile(io.BytesIO(wheel.content)) as archive:
        (name,) = (n for n in archive.namelist() if n.endswith(".dist-info/METADATA"))
        return email.message_from_bytes(archive.read(name))


def _licence_texts(wheel: Wheel) -> list[str]:
    with zipfile.ZipFile(io.BytesIO(wheel.content)) as archive:
        names = [
            name
            for name in archive.namelist()
            if ".dist-info/" in name and name.rpartition("/")[2].upper().startswith(_LICENCE_FILES)
        ]
        texts = [archive.read(name).decode("utf-8", "replace") for name in names]
    stored = addon_wheels.own_licence(wheel.name)
    return texts or [stored.read_text(encoding="utf-8")]
