# SPDX-License-Identifier: GPL-3.0-or-later
"""Fitting of the canonical models to any avatar: posed onto its joints, pulled to its surface."""
