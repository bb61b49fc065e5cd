# SPDX-License-Identifier: GPL-3.0-or-later
"""HMPG, the binary form of HJIF (ISO/IEC 23090-31): a stream of units that hold packets of bits.

Source of the syntax: the standard's reference software (MPEGGroup, HapticReferenceSoftware),
``IOStream.cpp``, ``IOBinaryFields.h`` and the enumerations of ``Types``. Both directions work on
the document of :mod:`hfx_blender.formats.hjif`, so there is no second model.
"""
