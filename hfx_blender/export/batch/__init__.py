# SPDX-License-Identifier: GPL-3.0-or-later
"""Batch processing of scenes: units of work, workers, and a journal of finished work.

An export of one scene is a batch of one. :mod:`batch` hands :mod:`units` to workers: this
process, or processes of this machine (:mod:`local_workers`). :mod:`work` does one, in a process
that has Blender. Farms schedule commands, each of which does a piece of a scene (:mod:`pieces`).
"""
