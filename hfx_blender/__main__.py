# SPDX-License-Identifier: GPL-3.0-or-later
"""Entry point of the command ``hfx``, also ``python -m hfx_blender``."""

from hfx_blender.processes import startup


def main() -> None:
    """Run the command line; modules in the current folder are never imported."""
    startup.begin()
    from hfx_blender.processes.tools_package import tools_module

    command_line = tools_module("command_process.command_line")
    assert command_line is not None, "pip installs both packages"
    command_line.main()


if __name__ == "__main__":
    main()
