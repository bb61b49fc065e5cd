# SPDX-License-Identifier: GPL-3.0-or-later
"""File formats: writers, readers, rules and conversion for own and foreign formats."""
