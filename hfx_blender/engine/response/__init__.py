# SPDX-License-Identifier: GPL-3.0-or-later
"""Contact response of haptic volumes: stacks of filters with memory.

Stateless parts (:mod:`touches`) and memory (:mod:`settling`) are separate, so that parts of a scene
can be recorded separately and joined.
"""
