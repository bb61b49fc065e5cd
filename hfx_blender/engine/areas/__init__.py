# SPDX-License-Identifier: GPL-3.0-or-later
"""Areas of effects, egocentric and allocentric: from a block of animation to runs of samples."""
