# SPDX-License-Identifier: GPL-3.0-or-later
"""Haptic engine: scene description to device-independent track and rasters.

Pure Python and numpy, without ``bpy``. Input is :mod:`.scene`, output :mod:`.track`.

Modules and packages, lowest first; each imports only from entries above:

arrays            array types, products and inverses without threads, archives of arrays
stepwise          long work in steps, with progress and cancelling
tolerance         accepted error
modality          the four modalities: parameters, units, combination of effects
counters          counters of the engine's work
native            compiled loops
kinematics        keyframe curves, bone hierarchies, motion between two samples
volume            shapes of haptic volumes
body              perceptual models, their parts and files, rigs
texture           haptic surfaces: height fields, materials, strokes
response_filters  parameters and values of contact response filters
scene             scene description: the input
samples           haptic samples: the result of an evaluation
reference         definition of contact in plain numpy: read it first
active_rows       selection of rows of a block
retargeting       fit of the canonical models to an avatar
skin              models bound, posed and sampled by cells
contact           broad phase, narrow phase, continuous collision detection
surface           samples of skin moving over haptic surfaces
response          contact responses of volumes
areas             egocentric and allocentric areas as sample runs
overlapping       work in a thread while its input is produced
evaluate          evaluation of animation blocks: top level of the engine
track             haptic track on disk: the output
rendering         samples and tracks as rasters of a device's actuators
colouring         samples as colours of an avatar
"""
