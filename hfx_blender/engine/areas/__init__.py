# SPDX-License-Identifier: GPL-3.0-or-later
"""Areas of effects, egocentric and allocentric: animation blocks to sample runs."""
