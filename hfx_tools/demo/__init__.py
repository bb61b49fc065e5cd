# SPDX-License-Identifier: GPL-3.0-or-later
"""The demo: the garage of HFX Studio's study, built, exported, drawn and summed up."""
