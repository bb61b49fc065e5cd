# SPDX-License-Identifier: GPL-3.0-or-later
"""Building of the body models from MakeHuman's data: source, skin, cells, result."""
