# SPDX-License-Identifier: GPL-3.0-or-later
"""Process of pip's command ``hfx``: standard streams, signals, Blender's module."""
