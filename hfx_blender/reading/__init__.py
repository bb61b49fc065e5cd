# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads the scene into the engine's plain data: description, stepping, motion."""
