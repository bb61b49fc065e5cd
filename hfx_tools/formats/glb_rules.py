# SPDX-License-Identifier: GPL-3.0-or-later
"""Rules of GLB files: the container and the members used by HFX.

Khronos' validator checks all further rules of glTF.
"""

from __future__ import annotations

from hfx_blender.files.findings import Finding, Report
from hfx_blender.formats.glb import glb


def validate(content: bytes, name: str) -> list[Finding]:
    """Return the findings of a file; InputError for unreadable JSON."""
    findings, document = glb.inspected(content, name)
    report = Report("GLB")
    lists = {key: document.get(key, []) for key in ("extensionsUsed", "extensionsRequired")}
    for key, names in lists.items():
        if not isinstance(names, list) or not all(isinstance(item, str) for item in names):
            report.error("TYPE", (None, key), "expected a list of texts")
            return findings + report.findings
    extensions = document.get("extensions")
    for extension in extensions if isinstance(extensions, dict) else ():
        if extension not in lists["extensionsUsed"]:
            report.error("EXTENSION", (None, "extensions"), f"{extension} is not in extensionsUsed")
    for extension in lists["extensionsRequired"]:
        message = f"only readers that know {extension} can open it"
        report.warn("EXTENSION-REQUIRED", None, message)
    return findings + report.findings
