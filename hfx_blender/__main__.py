# SPDX-License-Identifier: GPL-3.0-or-later
"""Entry point of the command ``hfx``, also ``python -m hfx_blender``."""

from hfx_blender.processes import startup


def main() -> None:
    """Run the command line; modules in the current folder are never imported."""
    startup.begin()
    from hfx_blender import cli

    cli.main()


if __name__ == "__main__":
    main()
