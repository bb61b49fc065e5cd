# SPDX-License-Identifier: GPL-3.0-or-later
"""Commands of hfx in an installation by pip only."""
