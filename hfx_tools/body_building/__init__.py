# SPDX-License-Identifier: GPL-3.0-or-later
"""Making the body models from the MakeHuman data: source, skin, cells, result."""
