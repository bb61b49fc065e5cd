# SPDX-License-Identifier: GPL-3.0-or-later
"""Parallel evaluation of blocks on several processor cores, with identical results."""
