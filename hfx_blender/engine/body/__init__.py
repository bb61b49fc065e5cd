# SPDX-License-Identifier: GPL-3.0-or-later
"""Body models: perceptual models, avatar, body parts, regions, files and rigs."""
