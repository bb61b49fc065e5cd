# SPDX-License-Identifier: GPL-3.0-or-later
"""Panning: a place between actuators is rendered by the surrounding actuators.

Each scheme is an object of a layout with the method ``gains(points)``: places (n, D) in metres or
directions to gains (n, A).
"""
