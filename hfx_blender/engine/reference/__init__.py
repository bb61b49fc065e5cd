# SPDX-License-Identifier: GPL-3.0-or-later
"""Definition of a contact in plain numpy, as the reference for the engine.

Every formula stands here once, with the source: each skin sample is tested at each time, without
clusters, boxes or caches. Tests compare the engine with this package, and a change of the
definition starts here.

pose       skin positions: linear blend skinning, anchored skin, placements between samples
cells      cells of skin around vertices, and samples of cells
shapes     inside of a volume and the strength there
boundary   nearest boundary point of a volume and the normal there
sweep      times at which a moving point is inside a volume
contact    weights and details of a contact

Results are exact: samples are as dense as at the tolerance ``exact``, or vertices only as at
``paper``. Deviations of other tolerances are documented in ``docs/trade.md``.

Points are (3, N) float64, metres. *World* is the scene's space, *shape space* the volume's own.
"""
