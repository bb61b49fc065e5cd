# SPDX-License-Identifier: GPL-3.0-or-later
"""Bindings of the compiled library, which finds contacts; :mod:`..reference` defines what it finds.

Where no library was built or it is switched off, exports compute that definition.
"""
