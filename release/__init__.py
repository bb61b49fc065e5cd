# SPDX-License-Identifier: GPL-3.0-or-later
"""Build of wheels and of the extension: compiled library, bundled wheels, import path."""
