# SPDX-License-Identifier: GPL-3.0-or-later
"""Spatial sound of haptic objects: sources around a listener, over any loudspeakers.

After the audio display of Politis, Pugliese, Takala (audio-tactile belt), section 4.3.
"""
