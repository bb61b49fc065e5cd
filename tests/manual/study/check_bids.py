# SPDX-License-Identifier: GPL-3.0-or-later
"""Check the folders of all designs with the official validator of BIDS.

``pip install bids-validator-deno``, then ``python tests/manual/study/check_bids.py FOLDER``. Each
study is made, answered at its page and validated: before the first answer, with answers, and after
all participants were deleted. Warnings concern what only the researcher knows, such as authors.
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

SHORT = {"duration_ms": [30, 40]}
LEVELS = {"strength": [0.1, 0.2, 0.4, 0.8]}
SCALES = [{"id": "strong", "text": "How strong?", "lowest": "weak", "highest": "strong"}]
PLANS: dict[str, dict[str, Any]] = {
    "paired": {
        "factors": SHORT,
        "compare": {"strength": [0.25, 0.5]},
        "training": 1,
        "catch": 1,
        "questionnaire": "nasa-tlx",
    },
    "rating": {"factors": SHORT | {"actuator": ["r1c1", "r1c2"]}, "scales": SCALES},
    "adjustment": {"factors": SHORT, "adjust": LEVELS},
    "staircase": {"factors": SHORT, "levels": LEVELS, "trials": 5},
    "2afc": {"factors": SHORT, "levels": LEVELS},
    "identification": {
        "factors": SHORT | {"frequency_hz": [50, 100]},
        "identify": "frequency_hz",
    },
}


def main() -> None:
    """Exit code 1 if the validator finds an error."""
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    failed = False
    for design, members in PLANS.items():
        plan = folder / f"{design}.json"
        plan.write_text(json.dumps({"name": f"bids-{design}", "design": design, **members}))
        study = folder / design
        shutil.rmtree(study, ignore_errors=True)
        _hfx("make", str(plan), "-o", str(study))
        # "No subjects" is true of both states without answers; the validator only warns of it.
        for state in ("made", "answered", "deleted"):
            if state == "answered":
                _answer(study)
            if state == "deleted":
                _hfx("delete", str(study), "01")
            errors = _errors(study)
            failed |= bool(errors)
            sys.stdout.write(f"{design:15} {state:9} {', '.join(errors) or 'no error'}\n")
    sys.exit(failed)


def _hfx(*arguments: str) -> None:
    command = [sys.executable, "-m", "hfx_blender", "study", *arguments]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)


def _answer(study: Path) -> None:
    """Run a session on the simulator, and give the first answer to each question."""
    command = [sys.executable, "-m", "hfx_blender", "study", "run", str(study), "--no-browser"]
    command += ["--device", "back_pad", "--to", "simulator", "--path", f"{study}.jsonl"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        found = re.search(r"http://(\S+?)/\S*", process.stdout.readline())
        assert found is not None
        address = found[0].replace("http", "ws", 1) + "/answers"
        with connect(address, origin=f"http://{found[1]}") as socket, suppress(ConnectionClosed):  # type: ignore[arg-type]
            for message in socket:
                kind = json.loads(message)["kind"]
                if kind in ("choice", "scale"):
                    socket.send(json.dumps({"type": "answer", "value": 1}))
                elif kind in ("text", "adjust"):
                    socket.send(json.dumps({"type": "next"}))
    if process.returncode:
        sys.exit(f"{study}: the session ended with exit code {process.returncode}")


def _errors(study: Path) -> list[str]:
    """Codes of the validator's errors."""
    command = ["bids-validator-deno", str(study), "--format", "json"]
    output = subprocess.run(command, capture_output=True, check=False).stdout
    issues = json.loads(output)["issues"]["issues"]
    return [issue["code"] for issue in issues if issue["severity"] == "error"]


if __name__ == "__main__":
    main()
