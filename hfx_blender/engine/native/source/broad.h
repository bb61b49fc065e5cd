// SPDX-License-Identifier: GPL-3.0-or-later
// A volume at some rows, and which clusters of skin it may touch there.

#ifndef HFX_BROAD_H
#define HFX_BROAD_H

#include <stdint.h>

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
} hfx_target;

// The largest change of weight for a change of rise.
static inline double hfx_steepest(const hfx_target *target) {
  return target->is_flat ? 0.0 : (target->is_smooth ? 1.5 : 1.0) / target->share;
}

#define MOST_STEPS 64  // straight ones between two rows

// How the cells of a pair are looked at.
enum { HFX_NOT, HFX_COVERED, HFX_BY_VERTEX, HFX_WHOLE };

// Pairs of a cluster, ascending, and a row, ascending within it.
typedef struct {
  int64_t count;
  int64_t *clusters, *rows;
  uint8_t *how;
  int64_t *steps;        // followed from the pair before in so many steps; 0: not
  const double *points;  // (3, total) all places, or NULL: bones pose them
  int64_t total;
  const double *allowed_m;  // (count,) where points are given: how far skin may be from its samples
} hfx_pairs;

#endif
