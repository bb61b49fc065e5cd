# SPDX-License-Identifier: GPL-3.0-or-later
"""Khronos' validator of glTF: npm package gltf-validator, found by Node through NODE_PATH.

Install with ``npm install --no-save --prefix FOLDER gltf-validator`` and
``NODE_PATH=FOLDER/node_modules``; ``.ci/run`` does so and fails without Node. Elsewhere, without
the package, files count as valid and ``test_khronos_validator_is_asked`` is skipped.
"""

from __future__ import annotations

import json
import shutil
import subprocess
from functools import cache
from pathlib import Path

_PROGRAM = """
const validator = require('gltf-validator');
const bytes = new Uint8Array(require('fs').readFileSync(process.argv[1]));
validator.validateBytes(bytes).then(
  report => console.log(JSON.stringify(report.issues.messages)));
"""


@cache
def is_there() -> bool:
    """Test for Node and the npm package."""
    node = shutil.which("node")
    command = [node or "", "-e", "require('gltf-validator')"]
    return node is not None and subprocess.run(command, capture_output=True).returncode == 0


def gltf_faults(path: Path) -> list[str]:
    """Return errors and warnings about a GLB file, except about extensions outside Khronos' list.

    Empty without Node or the package.
    """
    if not is_there():
        return []
    done = subprocess.run(
        ["node", "-e", _PROGRAM, str(path)], capture_output=True, text=True, check=True
    )
    document = json.loads(done.stdout)
    return [f"{item['pointer']}: {item['message']}" for item in document if item["severity"] < 2]
