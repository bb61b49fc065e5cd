# SPDX-License-Identifier: GPL-3.0-or-later
"""What is seen and felt while the scene plays: the preview in the viewport, live devices."""
