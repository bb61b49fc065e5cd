# SPDX-License-Identifier: GPL-3.0-or-later
"""Transports of devices, one file each. Opening may take seconds; sending never waits."""
