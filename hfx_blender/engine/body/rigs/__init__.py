# SPDX-License-Identifier: GPL-3.0-or-later
"""Rigs that others made: which of their bones is which of the canonical skeleton."""
