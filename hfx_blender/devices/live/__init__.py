# SPDX-License-Identifier: GPL-3.0-or-later
"""Live devices: client of the output process, which converts values to bytes at a port.

Order of the steps: device script (if any), guard (finite, range, slew, time on), encoder,
transport. Stop bytes go past these steps.
"""
