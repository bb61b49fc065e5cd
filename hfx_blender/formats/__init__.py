# SPDX-License-Identifier: GPL-3.0-or-later
"""Files of other programs and of our own: writers, readers, rules, conversion."""
