# SPDX-License-Identifier: GPL-3.0-or-later
"""The commands of ``hfx``, one file each: ``add_parser`` states its arguments, ``run`` does it."""
