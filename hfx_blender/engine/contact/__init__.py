# SPDX-License-Identifier: GPL-3.0-or-later
"""Contact of skin with haptic volumes: broad and narrow phase, continuous collision detection."""
