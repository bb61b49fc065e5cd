# SPDX-License-Identifier: GPL-3.0-or-later
"""Retargeting: fits of the canonical perceptual models to any avatar."""
