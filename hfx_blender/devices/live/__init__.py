# SPDX-License-Identifier: GPL-3.0-or-later
"""Live devices: from values to bytes at a port, in a process of their own.

Order of everything that reaches hardware: device script (if any), then the guard (finite,
range, slew, time on), then the encoder, then the transport. Stop is data and goes its own way.
"""
