# SPDX-License-Identifier: GPL-3.0-or-later
"""Measurements of time, as ratios within one run; the tests assert no timings."""
