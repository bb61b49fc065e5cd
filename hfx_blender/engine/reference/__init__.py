# SPDX-License-Identifier: GPL-3.0-or-later
"""The definition of a contact, in plain numpy: read this to know what the engine computes.

Every formula stands here once, with its source, as it is written down: each place of skin is
looked at, one moment after the other, without clusters, boxes or caches. The engine proper finds
the same sooner; tests compare it with this, and a change of what a contact is begins here.

pose       where a body's skin is: linear blend skinning, and skin that rides on a surface
cells      a vertex stands for its cell of skin; the places that a cell is sampled at
shapes     which places are inside a volume, and how strong it is there
boundary   the nearest place of a volume's boundary, and the normal there
motion     where things are between two samples
sweep      when a moving place of skin is inside a volume
contact    the weights of a contact, and its details

The exact result is meant: samples as dense as at the tolerance ``exact``, or only the vertices, as
at ``paper``. How far all other tolerances may be from that is said in ``docs/trade.md``.

Points are (3, N) float64, metres. *World* is the scene's space, *shape space* the volume's own.
"""
