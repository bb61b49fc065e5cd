# SPDX-License-Identifier: GPL-3.0-or-later
"""Entry of the command line ``hfx``: parser of all commands and exit codes."""

import argparse
import os
import re
import sys
import tempfile
import traceback
from collections.abc import Iterator, Sequence
from contextlib import nullcontext, redirect_stdout
from pathlib import Path
from typing import Any, NoReturn

from .commands import left_out
from .commands.console import Console
from .errors import HfxError, InputError, OutputError, UsageError, fault_of_file
from .files import limits
from .files.atomic import inputs_kept
from .processes import blender_session, process_end, startup
from .version import __version__

EPILOG = """\
exit codes: 0 done; 2 wrong usage; 3 bad input (nothing written for it); 4 a device failed;
5 some of several inputs failed, or a format could not hold all of a device (the rest is complete);
129, 130, 143 ended by SIGHUP, Ctrl-C, SIGTERM; 1 a defect of hfx.
"""


class _Parser(argparse.ArgumentParser):
    def __init__(self, **settings: Any) -> None:
        # Abbreviated options would change meaning with a new option.
        super().__init__(**settings, allow_abbrev=False)
        # Values may begin with a minus: --frames -10:20.
        self._negative_number_matcher = re.compile(r"-[\d.]")

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> tuple[Any, list[str]]:
        """Parse arguments; a positional argument of several values also takes those after options,
        as in ``a.blend -o DIR b.blend``, which argparse returns as unknown."""
        options, unknown = super().parse_known_args(args, namespace)
        several = [action for action in self._actions if action.nargs in ("+", "*")]
        if several and not any(text.startswith("-") for text in unknown):
            getattr(options, several[0].dest).extend(map(several[0].type or str, unknown))
            unknown = []
        return options, unknown

    def error(self, message: str) -> NoReturn:
        self.print_usage(sys.stderr)
        raise UsageError(message)


def build_parser(
    prog: str = "hfx", names: Sequence[str] = left_out.COMMANDS
) -> argparse.ArgumentParser:
    """Build the parser of the named commands, as far as this installation has them."""
    parser = _Parser(
        prog=prog,
        description="Haptic tracks from Blender scenes.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"hfx {__version__}")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for name in names:
        if (module := left_out.module(name)) is not None:
            module.add_parser(commands)
    return parser


def run(arguments: Sequence[str], prog: str = "hfx") -> int:
    """Run a command and return the exit code; print each user fault as a single line.

    SystemExit is raised by ``--help`` and ``--version`` only.
    """
    console = Console(as_json="--json" in arguments)
    try:
        left_out.refuse(arguments)
        # Modules of the other commands are not imported: half of a short command's time.
        names = arguments[:1] if arguments[:1] and arguments[0] in left_out.COMMANDS else None
        parser = build_parser(prog, names or left_out.COMMANDS)
        process_end.check()
        options = parser.parse_args(arguments)
        # Blender prints reports of operators to Python's standard output.
        with open(os.devnull, "w") as nowhere, redirect_stdout(nowhere):
            has_largest = "largest" in options
            with (
                limits.raised(options.largest) if has_largest else nullcontext(),
                inputs_kept(_named_files(options)),
            ):
                code = int(options.run(options, console))
        # A signal during the last piece of work still ends the command with the signal's code.
        process_end.check()
        if code or console.fault is None:
            return code
        return unprinted(console, console.fault)
    except HfxError as error:
        console.warn(f"hfx: {error}")
        console.result({"error": str(error)})
        return error.exit_code
    except process_end.TerminatedError as ended:
        # The watching thread may have written the sentence already.
        if process_end.claims_farewell():
            console.warn(f"hfx: {ended}")
        # From here on this thread ends the process: the watching thread stands down.
        process_end.answered()
        return ended.exit_code
    except KeyboardInterrupt:  # inside another program's process, without our signal handlers
        console.warn("hfx: interrupted; nothing half written was left behind")
        return 130
    except OSError as error:
        fault = fault_of_file(error) if error.filename is not None else _lost_folder()
        if fault is None:
            return defect(console)
        console.warn(f"hfx: {fault}")
        console.result({"error": str(fault)})
        return fault.exit_code
    except Exception:
        return defect(console)


def _named_files(options: argparse.Namespace) -> Iterator[Path]:
    """Yield existing files among the option values, except options that name results."""
    for name, value in vars(options).items():
        if name not in _RESULTS:
            for item in value if isinstance(value, list) else [value]:
                if isinstance(item, str | Path) and os.path.isfile(item):
                    yield Path(item)


def unprinted(console: Console, fault: OSError) -> int:
    """Warn about results that could not be printed, and return the exit code."""
    console.warn(f"hfx: standard output: cannot be written ({fault.strerror}).")
    return OutputError.exit_code


def _lost_folder() -> InputError | None:
    """InputError for a removed current folder or a missing temporary folder; None otherwise."""
    try:
        os.getcwd()
    except OSError as error:
        return InputError(f"the current folder cannot be used ({error.strerror}).")
    try:
        tempfile.gettempdir()
    except OSError:
        return InputError(
            "no temporary folder can be used; name one with the environment variable TMPDIR."
        )
    return None


def defect(console: Console) -> int:
    """Print the current traceback as a defect of hfx and return exit code 1."""
    text = "hfx: a defect of hfx, please report it:\n" + traceback.format_exc()
    console.warn(text, several_lines=True)
    return 1


_RESULTS = ("output", "target", "report", "history")

# In an installed Blender: ``blender scene.blend --command hfx export ...``

_blender_command: Any = None


def run_in_blender(arguments: list[str]) -> int:
    """Run a command in Blender's own process and return the exit code."""
    if blender_session.inside_blender():
        startup.clean_import_path()  # safe: Blender's process ends with this command
    try:
        return run(arguments, prog="blender --command hfx")
    except SystemExit as finished:  # --help
        return finished.code if isinstance(finished.code, int) else 0


def register() -> None:
    """Register the command ``hfx`` with Blender; nothing in Blender's Python module."""
    global _blender_command
    # Blender's Python module has no command line. Its handle would be released after Python's end:
    # Blender 4.5 crashes, because BPyCommandHandler's destructor takes Python's lock.
    if blender_session.inside_blender():
        import bpy

        _blender_command = bpy.utils.register_cli_command("hfx", run_in_blender)


def unregister() -> None:
    """Unregister the command."""
    global _blender_command
    if _blender_command is not None:
        import bpy

        bpy.utils.unregister_cli_command(_blender_command)
        _blender_command = None
