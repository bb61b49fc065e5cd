# SPDX-License-Identifier: GPL-3.0-or-later
"""``hfx device check`` and ``approve``: faults of device scripts, by text and by a trial."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from own_devices import BAND, own_folder, scripted

from hfx_blender import cli
from hfx_blender.devices import script_rendering
from hfx_blender.devices.live import approval
from hfx_blender.files import resources

HALF = "def render(haptics):\n    return haptics.values * 0.5\n"

TEXT_FAULTS = {
    b"def render(haptics)\n    return None\n": "line 1: is no Python",
    b"def render(haptics):\n    return None\nreturn 1\n": "line 3: is no Python",
    b"": "has no function render(haptics)",
    b"def draw(haptics):\n    render = 1\n": "has no function render(haptics)",
    b"def render(haptics):\n    return None\nrender = 5\n": "line 3: 'render' is a constant",
    b"async def render(haptics):\n    return None\n": "line 1: 'render' is an 'async' function",
    b"def render():\n    return None\n": "line 1: 'render' takes 0 arguments",
    b"def render(haptics, other):\n    return None\n": "line 1: 'render' takes 2 arguments",
    b"def render(haptics, *, gain):\n    return None\n": "takes the keyword 'gain'",
    b"def render(haptics):\n    return None\n\x00": "is no Python",
    "x = 'caf\xe9'\n".encode("latin-1") + HALF.encode(): "is no Python",
    b"x = " + b"(" * 5000 + b")" * 5000: "is no Python",
    b"render = lambda haptics, a, b: None\n": "line 1: 'render' takes 3 arguments",
    b"def render(haptics):\n    yield 1.0\n": "line 1: 'render' is a generator",
    HALF.encode() + b"del render\n": "line 3: 'render' is deleted",
}
REASONS = {  # texts without a reason of the compiler, or with a full stop at its end
    b"x = " + b"-" * 100_000 + b"1\n": "complex",
    b"x = " + b"9" * 10_000 + b"\n": "limits",
}
TRIAL_FAULTS = {
    "raise RuntimeError('no port')\n" + HALF: "cannot be started: RuntimeError: no port",
    "def render(haptics):\n    return haptics.nothing\n": "when called with no effect",
    "def render(haptics):\n    return [1.0]\n": "when called with no effect",
    "def render(haptics):\n    e = haptics.strongest('wind')\n    return e and [e.warmth]\n": (
        "when called with an effect of wind: AttributeError"
    ),
    "def render(haptics):\n    return [1.0 / (3 - len(haptics.felt))] * 16\n": "",
    "def render(haptics):\n    return None if len(haptics.felt) < 2 else 1 / 0\n": (
        "when called with effects of all modalities: ZeroDivisionError"
    ),
    "def render(haptics):\n    import sys\n    sys.exit()\n": "SystemExit",
    "def render(haptics):\n    return [1j] * 16\n": "of shape (16,) and type complex, expected",
    "def render(haptics):\n    return ['1'] * 16\n": "of shape (16,) and type str, expected",
    "def render(haptics):\n    return [0.0] * 15 + [10**400]\n": (
        "type float, int, expected (16,) and float, or int of 64 bits"
    ),
    "def render(haptics):\n    return {haptics.actuators[0].id: 1j}\n": (
        "returned 'complex' for control 'amplitude_m_s2'"
    ),
    "def render(haptics):\n    return {haptics.actuators[0].id: 10**400}\n": (
        "allowed is a number that fits a float"
    ),
    "def render(haptics):\n    return 5\n": "of shape () and type int, expected (16,)",
    "def render(haptics):\n    return [[1.0], [1.0, 2.0]]\n": "shape (2,) and type list",
    # The line of the script, not that of the module which raises.
    "import json\ndef render(haptics):\n    return json.loads('[')\n": "(my_band.py, line 3)",
    "def render(haptics):\n    raise MemoryError\n": ": MemoryError (my_band.py, line 2).",
}
RIGHT = {
    "render = lambda haptics: haptics.values\n": "a lambda",
    "if True:\n    def render(haptics, gain=1):\n        return gain * haptics.values\n": "nested",
    "def twice(f):\n    return lambda haptics: f(haptics, 2)\n@twice\ndef render(a, b):\n"
    "    return a.values\n": "decorated",
    "class A:\n    def __call__(self, haptics):\n        return None\nrender = A()\n": "object",
    "\ufeff" + HALF: "byte order mark",
    f"exec({HALF!r})\n": "exec",
    "globals()['render'] = lambda haptics: None\n": "globals",
    "import builtins\nrender = None\nbuiltins.exec('render = lambda haptics: None')\n": "attribute",
    "def bind():\n    global render\n    def render(haptics):\n        return None\nbind()\n": (
        "global"
    ),
    "render = None\nif True:\n    def render(haptics):\n        return None\n": "filled later",
    "def render(haptics):\n    return [*(lambda: (yield 1.0))()] * 16\n": "inner generator",
}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    return own_folder(tmp_path, monkeypatch)


def hfx(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    code = cli.run(["device", *arguments])
    return code, *capsys.readouterr()


def checked(capsys, folder: Path, *options: str) -> tuple[int, str, str]:
    return hfx(capsys, "check", str(folder / "my_band.json"), *options)


@pytest.mark.parametrize(("source", "fault"), TEXT_FAULTS.items(), ids=list(TEXT_FAULTS.values()))
def test_a_fault_of_the_text_is_named_and_refuses_the_approval(folder, capsys, source, fault):
    (folder / "my_band.py").write_bytes(source)
    for command in (["check", str(folder / "my_band.json")], ["approve", BAND]):
        code, _, err = hfx(capsys, *command)
        assert code == 3 and "my_band.py" in err and fault in err and err.count("\n") == 1
    assert approval.approved() == {}


@pytest.mark.parametrize(("source", "reason"), REASONS.items(), ids=list(REASONS.values()))
def test_a_text_that_does_not_compile_has_a_reason_and_one_full_stop(
    folder, capsys, source, reason
):
    (folder / "my_band.py").write_bytes(source)
    _, _, err = checked(capsys, folder)
    assert reason in err.partition("is no Python: ")[2] and err[-3] != "." == err[-2]


@pytest.mark.parametrize("source", TRIAL_FAULTS)
def test_a_trial_names_the_call_that_fails_and_refuses_the_approval(folder, capsys, source):
    scripted(folder, source, is_approved=False)
    fault = TRIAL_FAULTS[source]
    code, _, err = checked(capsys, folder, "--try")
    assert code == (3 if fault else 0) and fault in err and err.count("\n") == bool(fault)
    assert hfx(capsys, "approve", BAND, "--try")[0] == code
    assert bool(approval.approved()) is (not fault)


@pytest.mark.parametrize("source", RIGHT, ids=list(RIGHT.values()))
def test_a_right_script_has_no_fault(folder, capsys, source):
    scripted(folder, source, is_approved=False)
    assert checked(capsys, folder, "--try")[0] == 0
    assert approval.approved() == {}  # a trial approves nothing


def test_a_script_without_approval_is_not_run(folder, capsys, tmp_path):
    """Opening a configuration runs no code; after the approval ``check`` calls the script."""
    scripted(folder, f"open({str(tmp_path / 'ran')!r}, 'w').close()\n{HALF}", is_approved=False)
    code, out, _ = checked(capsys, folder)
    assert code == 0 and "compiled, not called" in out
    code, out, _ = hfx(capsys, "approve", BAND)
    assert code == 0 and "not called" not in out and not (tmp_path / "ran").exists()
    code, out, _ = checked(capsys, folder)
    assert code == 0 and "not called" not in out and (tmp_path / "ran").exists()


def test_a_script_that_never_returns_is_named(folder, capsys, monkeypatch):
    monkeypatch.setattr(script_rendering, "ROW_S", 1.0)
    scripted(folder, "def render(haptics):\n    while True:\n        pass\n")
    code, _, err = checked(capsys, folder)
    assert code == 3 and "called with no effect: it did not answer within 1 s" in err


def test_prints_missing_numbers_and_slow_calls_are_notes(folder, capsys):
    source = (
        "import time\n\n\ndef render(haptics):\n    if haptics.stopped:\n        print('hello')\n"
        "        time.sleep(0.3)\n        return [float('nan')] * 16\n    return None\n"
    )
    scripted(folder, source)
    code, out, _ = checked(capsys, folder, "--json")
    notes = json.loads(out)["notes"]
    assert code == 0 and notes[0] == "its script printed: hello"
    assert "no number in 1 of" in notes[1] and "0.1 s are allowed live" in notes[2]


@pytest.mark.parametrize("name", ["peltier_sleeve", "thermal_grill", "ultrasound_array"])
def test_shipped_scripts_pass_the_trial(capsys, name):
    code, out, _ = hfx(capsys, "check", str(resources.device_configs() / f"{name}.json"))
    assert code == 0 and "not called" not in out
