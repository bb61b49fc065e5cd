# SPDX-License-Identifier: GPL-3.0-or-later
"""Building of body models, measurements and demo scenes: installed by pip, not in the extension.

``build_addon.py`` leaves this folder out of the zip, so nothing outside it imports it;
:mod:`..commands.left_out` finds its commands where they are.
"""
