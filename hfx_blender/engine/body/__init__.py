# SPDX-License-Identifier: GPL-3.0-or-later
"""Body: perceptual models, their parts, their skinning, and how they are built."""
