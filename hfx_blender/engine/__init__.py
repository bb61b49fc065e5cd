# SPDX-License-Identifier: GPL-3.0-or-later
"""The haptic engine: from a scene description to a device-independent track.

Pure Python and numpy; never imports ``bpy``. Two doors: :mod:`.scene` in, :mod:`.track` out.
"""
