# SPDX-License-Identifier: GPL-3.0-or-later
"""The haptic engine: from a scene description to a device-independent track and its rasters.

Pure Python and numpy; never imports ``bpy``. Two doors: :mod:`.scene` in, :mod:`.track` out.

Modules and packages, lowest first: each imports only from those above it in this list.

arrays            types of arrays, counting within groups
stepwise          long work in steps, which may be shown and cancelled
matmul            products and inverses of matrices that start no threads
tolerance         the accepted error
modality          the four modalities: parameters, units, how effects combine
counters          numbers of what the engine did
native            the compiled loops
kinematics        keyframe curves, bone hierarchies, motion between two samples
volume            shapes of haptic volumes
body              perceptual models, their parts and files, rigs
texture           haptic surfaces: height fields, materials, strokes
response_filters  parameters and values of contact response filters
scene             the scene description: the input
samples           haptic samples: the result of an evaluation
reference         the definition of a contact, in plain numpy: read it first
active_rows       rows of a block that count
retargeting       fitting of the canonical models to an avatar
skin              models bound, posed and sampled cell by cell
contact           broad phase, narrow phase, continuous collision detection
surface           samples of skin that moves over haptic surfaces
response          contact responses: how volumes answer a touch
areas             egocentric and allocentric areas, as runs of samples
overlapping       work in a thread while its input is produced
evaluate          evaluation of blocks of animation: the engine's recipe
track             the haptic track on disk: the output
rendering         samples and tracks as rasters of a device's actuators
spatial_sound     volumes as sound sources round a listener
colouring         samples as colours of an avatar
"""
