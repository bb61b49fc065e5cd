# SPDX-License-Identifier: GPL-3.0-or-later
"""Commands of ``hfx``, a file each: ``add_parser`` declares arguments, ``run`` executes."""
