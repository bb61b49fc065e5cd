# SPDX-License-Identifier: GPL-3.0-or-later
"""Start of the command line: a command imports its own module only."""

import subprocess
import sys

_SCRIPT = """
import sys
from hfx_blender import cli
code = cli.run(sys.argv[1:])
commands = {name.rpartition(".")[2] for name in sys.modules if ".commands." in name}
print("\\n" + " ".join(sorted(commands & set(cli.left_out.COMMANDS))), code)
"""


def _imported(*arguments: object) -> str:
    called = [sys.executable, "-c", _SCRIPT, *map(str, arguments)]
    return subprocess.run(called, capture_output=True, text=True, check=True).stdout.split("\n")[-2]


def test_a_command_imports_no_other_command(tmp_path):
    path = tmp_path / "a.json"
    path.write_text("{}")

    assert _imported("device", "list").startswith("device ")
    # The checks of a file use what 'hfx info' reads.
    assert _imported("validate", path) == "info validate 3"


def test_an_unknown_command_lists_all(capfd):
    from hfx_blender import cli

    assert cli.run(["exprot"]) == 2
    message = capfd.readouterr().err
    assert "'exprot'" in message
    assert all(f"'{name}'" in message for name in cli.left_out.COMMANDS)
