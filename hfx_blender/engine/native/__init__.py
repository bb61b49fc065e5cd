# SPDX-License-Identifier: GPL-3.0-or-later
"""Bindings of the compiled inner loops.

Without a library, or with ``HFX_NATIVE=0``, the definitions of :mod:`..reference` are
evaluated instead.
"""
