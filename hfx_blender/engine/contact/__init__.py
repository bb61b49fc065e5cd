# SPDX-License-Identifier: GPL-3.0-or-later
"""Contact of skin with volumes: broad phase, narrow phase, continuous collision detection."""
