# SPDX-License-Identifier: GPL-3.0-or-later
"""Contact response: how a haptic volume answers a touch, as a stack of filters.

What follows from one moment alone (:mod:`touches`) is kept apart from what remembers
(:mod:`settling`), so that parts of a scene may be recorded apart and put together again.
"""
