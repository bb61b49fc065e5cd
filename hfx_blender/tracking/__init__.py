# SPDX-License-Identifier: GPL-3.0-or-later
"""Live input of other programs by OSC: tracked bodies, values and time; no bpy."""
