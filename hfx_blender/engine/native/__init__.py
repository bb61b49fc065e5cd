# SPDX-License-Identifier: GPL-3.0-or-later
"""The loops that numpy cannot make flat, compiled: optional, and never with another result.

Each function here does what a function in numpy does elsewhere in the engine, which is used
where no library was built or it is switched off.
"""
