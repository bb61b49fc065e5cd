# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfaces from the user's diffusion model; needs PyTorch, so not in the extension."""
