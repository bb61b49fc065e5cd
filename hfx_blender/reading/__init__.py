# SPDX-License-Identifier: GPL-3.0-or-later
"""The scene, read into the engine's plain data: what is in it, when it is stepped, how it moves."""
