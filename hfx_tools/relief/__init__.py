# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures of materials with known relief, and training of the relief network."""
