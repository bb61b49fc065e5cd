# SPDX-License-Identifier: GPL-3.0-or-later
"""Bindings of the compiled inner loops. What contacts they find is defined by :mod:`..reference`.

Where no library was built or it is switched off, exports compute that definition.
"""
