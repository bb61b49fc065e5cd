# SPDX-License-Identifier: GPL-3.0-or-later
"""Touch of tracked bodies, evaluated from game clips by the players' core (``hfx feel``)."""
