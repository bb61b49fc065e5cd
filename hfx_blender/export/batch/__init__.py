# SPDX-License-Identifier: GPL-3.0-or-later
"""Batch processing of scenes: units of work, workers, and a journal of finished work.

:mod:`batch` assigns :mod:`units` to workers: this process, or for pip's command processes of this
machine (``hfx_tools/export_workers/``). :mod:`work` executes a unit in a process with Blender.
Render farms run a command per piece of a scene (:mod:`pieces`).
"""
