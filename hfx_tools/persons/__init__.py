# SPDX-License-Identifier: GPL-3.0-or-later
"""Profiles of persons: measurement, and values of clips and games at a person's strengths."""
