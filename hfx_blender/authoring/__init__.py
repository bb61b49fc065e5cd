# SPDX-License-Identifier: GPL-3.0-or-later
"""What a creator makes and edits: effects, areas, volumes, clips, and the files that hold them."""
