# SPDX-License-Identifier: GPL-3.0-or-later
"""Panning: a place between actuators is rendered by its neighbours.

Every scheme is a small object made from an actuator layout once, with one method:
``gains(points)`` takes places, (n, D) metres or directions, and yields (n, A) gains.
"""
