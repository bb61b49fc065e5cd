# SPDX-License-Identifier: GPL-3.0-or-later
"""Demo scenes, among them the garage of HFX Studio's study, with charts and pictures."""
