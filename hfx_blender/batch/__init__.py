# SPDX-License-Identifier: GPL-3.0-or-later
"""Batch processing of scenes: units of work, workers, and a journal of finished work.

An export of one scene is a batch of one. :mod:`batch` hands :mod:`units` to workers: this
process, processes of this machine (:mod:`local_workers`), or a Dask cluster
(:mod:`dask_workers`). :mod:`work` does one, in a process that has Blender.
"""
