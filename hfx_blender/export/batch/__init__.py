# SPDX-License-Identifier: GPL-3.0-or-later
"""Batch processing of scenes: units of work, workers, and a journal of finished work.

The export of one scene is a batch of one. :mod:`batch` assigns :mod:`units` to workers: this
process, or processes of this machine (:mod:`local_workers`). :mod:`work` executes a unit in a
process with Blender. Render farms run one command per piece of a scene (:mod:`pieces`).
"""
