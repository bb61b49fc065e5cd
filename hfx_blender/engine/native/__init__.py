# SPDX-License-Identifier: GPL-3.0-or-later
"""Bindings of the compiled inner loops.

Without a library, or with ``HFX_NATIVE=0``, exports evaluate the definitions of
:mod:`..reference` instead.
"""
