// SPDX-License-Identifier: GPL-3.0-or-later
// Boxes of the parts of a model that bones move, cluster by cluster, before anything is posed.

#ifndef HFX_OUTLINE_H
#define HFX_OUTLINE_H

#include <stdint.h>

// A pair is a cluster and a bone that moves a box of it.
typedef struct {
  int64_t bone_count, clusters;
  const int64_t *bones;   // (bone_count,) those that move anything; others than the pose has: rest
  const int64_t *starts;  // (clusters + 1,) a cluster's first pair
  const int64_t *slots;   // (pairs,) which of these bones
  const int64_t *pair_bones;        // (pairs,) the same in the pose
  const double *centres, *halves;   // (pairs, 3) boxes at rest
  const double *boxes;              // (pairs, 3, 2) the same, centre and half edge of each axis
} hfx_outline;

#endif
