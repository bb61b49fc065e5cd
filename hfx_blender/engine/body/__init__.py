# SPDX-License-Identifier: GPL-3.0-or-later
"""Perceptual models of the body: their parts, skin paths and files, and the rigs they fit."""
