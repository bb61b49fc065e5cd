# SPDX-License-Identifier: GPL-3.0-or-later
"""Commands of hfx that only an installation by pip has."""
