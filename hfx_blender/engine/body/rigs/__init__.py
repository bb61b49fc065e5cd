# SPDX-License-Identifier: GPL-3.0-or-later
"""Users' rigs: mapping of their bones to the canonical skeleton."""
