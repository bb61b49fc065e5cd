// SPDX-License-Identifier: GPL-3.0-or-later
// A volume at some rows, and which clusters of skin it may touch there.

#ifndef HFX_BROAD_H
#define HFX_BROAD_H

#include <stdint.h>

#include "analytic.h"

// Boxes of the parts of a model that bones move, before anything is posed. A pair is a cluster and a
// bone that moves a box of it.
typedef struct {
  int64_t bone_count, clusters;
  const int64_t *bones;   // (bone_count,) those that move anything; others than the pose has: rest
  const int64_t *starts;  // (clusters + 1,) a cluster's first pair
  const int64_t *slots;   // (pairs,) which of these bones
  const int64_t *pair_bones;        // (pairs,) the same in the pose
  const double *centres, *halves;   // (pairs, 3) boxes at rest
  const double *boxes;              // (pairs, 3, 2) the same, centre and half edge of each axis
} hfx_outline;

// A volume at some rows.
typedef struct {
  int64_t rows;
  int64_t *kinds;                 // (rows,)
  double *halves;                 // (rows,)
  double *to_shape;               // (rows, 4, 4) from the world
  double *to_world;               // (rows, 4, 4) from the body's own space
  int64_t is_flat, is_smooth;
  double share, amplitude;
  double *matrices;               // (rows, 4, 4) shape space to world
  // Only where hfx_place has filled it in.
  double *body_to_shape;          // (rows, 4, 4) the body's own space to shape space
  double *boxes;                  // (rows, 2, 3) world, of the volume
  double *turns;                  // (2, rows) of volume and body since the row before, radians
  const hfx_mesh **meshes;        // (rows,) of rows with a mesh; only where it is met
  const double *swept;            // (rows, 2, 3) boxes of meshes since the row before, or NULL
  uint8_t *is_usable;             // (rows,) not flattened, endless or not a number
} hfx_target;

static inline hfx_shape hfx_shape_at(const hfx_target *target, int64_t row) {
  return (hfx_shape){target->kinds[row], target->halves[row], target->meshes[row]};
}

// Places of the skin of a body without bones, in its own space, at some rows.
typedef struct {
  const double *places;  // (bounds, places, 3)
  const double *own;     // (bounds, cells, 3) of the cells' vertices, or NULL: they are places
  const int64_t *at;     // (rows,) which of these rows
  const int64_t *starts; // (clusters + 1,) each cluster's first place
  int64_t place_count, cell_count;
} hfx_surface_places;

static inline void hfx_moved_by(const double *matrix, const double *from, double to[3]) {
  for (int i = 0; i < 3; i++) to[i] = hfx_dot(matrix + 4 * i, from) + matrix[4 * i + 3];
}

// The largest change of weight for a change of rise.
static inline double hfx_steepest(const hfx_target *target) {
  return target->is_flat ? 0.0 : (target->is_smooth ? 1.5 : 1.0) / target->share;
}

#define MOST_STEPS 64  // straight ones between two rows

// Kinds of test for the cells of a pair.
enum { HFX_NOT, HFX_COVERED, HFX_BY_VERTEX, HFX_WHOLE };

// Pairs of a cluster, ascending, and a row, ascending within it.
typedef struct {
  int64_t count;
  int64_t *clusters, *rows;
  uint8_t *how;
  int64_t *steps;        // followed from the pair before in so many steps; 0: not
} hfx_pairs;

#endif
