# SPDX-License-Identifier: GPL-3.0-or-later
"""Transports of devices, one file each. Opening may take its time; sending never waits."""
