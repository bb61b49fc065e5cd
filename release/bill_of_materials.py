# SPDX-License-Identifier: GPL-3.0-or-later
"""Bill of materials (CycloneDX 1.6) and licences of the distributions in the extension's zips."""

from __future__ import annotations

import email
import email.message
import hashlib
import json
import uuid
import zipfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from . import addon_wheels

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


def bill(version: str, artefacts: Iterable[Path], wheels: Iterable[Path]) -> str:
    """Text of the bill of materials as JSON; equal files give equal text.

    Parameters
    ----------
    version : str
        Version of the release.
    artefacts : iterable of Path
        Files of the release, named without their folder.
    wheels : iterable of Path
        Wheels of other projects inside the extension's zips.
    """
    own = [
        {
            "type": "file",
            "bom-ref": path.name,
            "name": path.name,
            "version": version,
            "hashes": [_hash(path)],
            "licenses": [{"expression": _PLAYERS if _is_player(path) else _OWN}],
        }
        for path in sorted(artefacts)
    ]
    others = [_library(path) for path in sorted(wheels)]
    components = own + others
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
        "components": components,
    }
    return json.dumps(document, indent=2) + "\n"


def third_party_licences(wheels: Iterable[Path]) -> str:
    """Licences of the distributions in wheels: name, version and each different text once."""
    texts: dict[str, set[str]] = {}
    for wheel in sorted(wheels):
        facts = _metadata(wheel)
        for text in _licence_texts(wheel):
            texts.setdefault(text, set()).add(f"{facts['Name']} {facts['Version']}")
    parts = [
        f"{'=' * 80}\n{', '.join(sorted(names))}\n{'=' * 80}\n\n{text.strip()}\n"
        for text, names in sorted(texts.items(), key=lambda item: sorted(item[1]))
    ]
    return "\n".join(parts)


def _library(wheel: Path) -> dict[str, Any]:
    facts = _metadata(wheel)
    name = str(facts["Name"]).lower().replace("_", "-")
    expression = facts.get("License-Expression") or _EXPRESSIONS.get(name)
    if expression is None:
        raise addon_wheels.WheelError(
            f"{wheel.name}: its metadata has no SPDX expression of its licence; add the expression "
            f"to {Path(__file__).name}."
        )
    return {
        "type": "library",
        "bom-ref": wheel.name,
        "name": name,
        "version": facts["Version"],
        "purl": f"pkg:pypi/{name}@{facts['Version']}?file_name={wheel.name}",
        "hashes": [_hash(wheel)],
        "licenses": [{"expression": expression}],
    }


def _hash(path: Path) -> Mapping[str, str]:
    return {"alg": "SHA-256", "content": hashlib.sha256(path.read_bytes()).hexdigest()}


def _is_player(path: Path) -> bool:
    return path.name.startswith(("hfx-godot", "hfx-web", "hfx-core", "org.hfx."))


def _metadata(wheel: Path) -> email.message.Message:
    with zipfile.ZipFile(wheel) as archive:
        (name,) = (n for n in archive.namelist() if n.endswith(".dist-info/METADATA"))
        return email.message_from_bytes(archive.read(name))


def _licence_texts(wheel: Path) -> list[str]:
    with zipfile.ZipFile(wheel) as archive:
        names = [
            name
            for name in archive.namelist()
            if ".dist-info/" in name and name.rpartition("/")[2].upper().startswith(_LICENCE_FILES)
        ]
        texts = [archive.read(name).decode("utf-8", "replace") for name in names]
    stored = addon_wheels.own_licence(wheel.name)
    return texts or [stored.read_text(encoding="utf-8")]
