# SPDX-License-Identifier: GPL-3.0-or-later
"""Skin of perceptual models: bound to a body, posed, and sampled by cells."""
