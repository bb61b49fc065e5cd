# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures of materials with known relief, and the training of the network that estimates it."""
