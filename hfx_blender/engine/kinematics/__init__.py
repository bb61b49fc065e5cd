# SPDX-License-Identifier: GPL-3.0-or-later
"""Motion over time: keyframe curves, bone hierarchies, placements between two samples."""
