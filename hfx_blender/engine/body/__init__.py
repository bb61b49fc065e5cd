# SPDX-License-Identifier: GPL-3.0-or-later
"""The body: perceptual models, their parts, their skinning, and how they are built."""
