# SPDX-License-Identifier: GPL-3.0-or-later
"""Building of body models, measurements and demo scenes: installed by pip, not in the extension.

``build_addon.py`` leaves this folder out of the zip, so no other package may import this one;
:mod:`..commands.left_out` adds the commands of an installed ``hfx_tools``.
"""
