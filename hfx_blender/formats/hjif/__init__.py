# SPDX-License-Identifier: GPL-3.0-or-later
"""MPEG HJIF (ISO/IEC 23090-31): the interchange format for haptics, as JSON."""
