# SPDX-License-Identifier: GPL-3.0-or-later
"""Training of a decoder of touch for a user's diffusion model."""
