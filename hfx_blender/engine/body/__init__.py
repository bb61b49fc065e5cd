# SPDX-License-Identifier: GPL-3.0-or-later
"""Body: perceptual models, their parts, regions, files and rigs."""
