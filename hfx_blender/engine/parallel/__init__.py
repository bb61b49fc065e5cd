# SPDX-License-Identifier: GPL-3.0-or-later
"""Blocks of time that several processor cores evaluate; what is felt does not depend on it."""
