# SPDX-License-Identifier: GPL-3.0-or-later
"""Compiled versions of loops that numpy cannot vectorize: optional, with the same results.

Each function here does what a function in numpy does elsewhere in the engine, which is used
where no library was built or it is switched off.
"""
