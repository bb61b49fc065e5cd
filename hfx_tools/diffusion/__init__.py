# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfaces from a diffusion model of the user's own; needs PyTorch, so not in the extension."""
