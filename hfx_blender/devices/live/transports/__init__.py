# SPDX-License-Identifier: GPL-3.0-or-later
"""Ways to a device, one file each. Opening may take its time; sending never waits."""
