# SPDX-License-Identifier: GPL-3.0-or-later
"""Filters of contact responses: their parameters, and the values for given inputs."""
