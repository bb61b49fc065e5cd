# SPDX-License-Identifier: GPL-3.0-or-later
"""Programs between HFX's output by OSC and devices with another protocol."""
