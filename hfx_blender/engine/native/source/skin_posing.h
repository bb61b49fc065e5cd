// SPDX-License-Identifier: GPL-3.0-or-later
// Posing a cluster at one row.

#ifndef HFX_SKIN_POSING_H
#define HFX_SKIN_POSING_H

#include <math.h>

#include "numbers.h"
#include "skin.h"

// No less than what a matrix whose rows are `width` apart stretches any direction by: the norm of
// its product with its transpose is at most the largest sum of a row's absolute values.
static inline double hfx_stretch(const double *m, int width) {
  double most = 0.0;
  for (int i = 0; i < 3; i++) {
    double sum = 0.0;
    for (int j = 0; j < 3; j++) {
      const double *a = m + width * i, *b = m + width * j;
      sum += fabs(a[0] * b[0] + a[1] * b[1] + a[2] * b[2]);
    }
    most = hfx_larger(most, sum);
  }
  return sqrt(most);
}

typedef double hfx_two __attribute__((vector_size(16)));

// The matrices of a cluster's bones at a row, by columns, for hfx_pose: 4 of each bone, (x, y) and
// (z, 0) of each. Room for 16 doubles a bone.
static inline void hfx_find_columns(const hfx_cluster *cluster, const hfx_bones *bones, int64_t row,
                                    hfx_two *columns) {
  for (int64_t b = 0; b < cluster->bone_count; b++) {
    const double *m = bones->matrices + 12 * (row * bones->count + bones->slots[cluster->bones[b]]);
    for (int j = 0; j < 4; j++, columns += 2) {
      columns[0] = (hfx_two){m[j], m[4 + j]};
      columns[1] = (hfx_two){m[8 + j], 0.0};
    }
  }
}

// Where a place of a cluster is.
static inline void hfx_pose(const hfx_cluster *cluster, const hfx_two *columns, int64_t place,
                            double point[3]) {
  hfx_two xy = {0.0, 0.0}, z = {0.0, 0.0};
  for (int64_t e = cluster->firsts[place]; e < cluster->firsts[place + 1]; e++) {
    const double *f = cluster->factors + 4 * e;
    const hfx_two *m = columns + 8 * cluster->entry_bones[e];
    xy += m[0] * f[0] + m[2] * f[1] + (m[4] * f[2] + m[6] * f[3]);
    z += m[1] * f[0] + m[3] * f[1] + (m[5] * f[2] + m[7] * f[3]);
  }
  point[0] = xy[0], point[1] = xy[1], point[2] = z[0];
}

// How far any place of a cluster can have moved from one row to another, straight.
static inline double hfx_moved(const hfx_cluster *cluster, const hfx_bones *bones, int64_t before,
                               int64_t after) {
  double most = 0.0;
  for (int64_t b = 0; b < cluster->bone_count; b++) {
    int64_t slot = bones->slots[cluster->bones[b]];
    const double *one = bones->matrices + 12 * (before * bones->count + slot);
    const double *other = bones->matrices + 12 * (after * bones->count + slot);
    const double *moved = cluster->moved + 6 * b;
    double way = 0.0, turned = 0.0;
    for (int i = 0; i < 3; i++) {
      double d[4];
      for (int j = 0; j < 4; j++) d[j] = other[4 * i + j] - one[4 * i + j];
      double each = d[0] * moved[1] + d[1] * moved[2] + d[2] * moved[3] + d[3];
      way += each * each;
      turned += d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
    }
    most = hfx_larger(most, sqrt(way) + sqrt(turned) * moved[5]);
  }
  return most;
}

// What is known of a posed cluster without posing any of it.
typedef struct {
  double along, apart;       // units are no farther from their neighbours than `along` times their
                             // distance at rest plus `apart` times how far their weights differ
  double middle[3], radius;  // a ball that holds all of it
} hfx_spread;

// See _SkinnedClusters.skin. A place x that bones M_b move with weights w_b is at the sum of all
// w_b M_b x: of such a sum only how the M_b differ from their mean, and how that stretches, matters.
static inline hfx_spread hfx_spread_of(const hfx_cluster *cluster, const hfx_bones *bones,
                                       int64_t row) {
  hfx_spread spread = {0.0, 0.0, {0.0, 0.0, 0.0}, 0.0};
  double mean[12] = {0.0};
  for (int64_t b = 0; b < cluster->bone_count; b++) {
    int64_t at = row * bones->count + bones->slots[cluster->bones[b]];
    const double *m = bones->matrices + 12 * at;
    spread.along = hfx_larger(spread.along, bones->stretches[at]);
    for (int i = 0; i < 12; i++) mean[i] += m[i] * cluster->moved[6 * b];
  }
  for (int64_t b = 0; b < cluster->bone_count && cluster->bone_count > 1; b++) {
    const double *m = bones->matrices + 12 * (row * bones->count + bones->slots[cluster->bones[b]]);
    const double *moved = cluster->moved + 6 * b;
    double way = 0.0, turned = 0.0;
    for (int i = 0; i < 3; i++) {
      double d[4];
      for (int j = 0; j < 4; j++) d[j] = m[4 * i + j] - mean[4 * i + j];
      double each = d[0] * moved[1] + d[1] * moved[2] + d[2] * moved[3] + d[3] * moved[4];
      way += each * each;
      turned += d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
    }
    spread.apart = hfx_larger(spread.apart, sqrt(way) + sqrt(turned) * moved[5]);
  }
  const double *centre = cluster->moved + 1;
  for (int i = 0; i < 3; i++)
    spread.middle[i] = mean[4 * i] * centre[0] + mean[4 * i + 1] * centre[1] +
                       mean[4 * i + 2] * centre[2] + mean[4 * i + 3];
  spread.radius = spread.apart + spread.along * cluster->moved[5];
  return spread;
}

// How far anything in boxes that bones move can have moved from one row to another. A pair is a
// bone and a box; `linear`, whose rows are `width` apart, leads from the space of the matrices to
// that of moves.
static inline double hfx_box_moves(const hfx_bones *bones, int64_t before, int64_t after,
                                   const double *linear, int width, int64_t first, int64_t last,
                                   const int64_t *pair_bones, const double *centres,
                                   const double *halves) {
  const double *earlier = bones->matrices + 12 * before * bones->count;
  const double *later = bones->matrices + 12 * after * bones->count;
  double most = 0.0;
  for (int64_t p = first; p < last; p++) {
    const double *centre = centres + 3 * p, *half = halves + 3 * p;
    int64_t slot = 12 * bones->slots[pair_bones[p]];
    double d[12], squared = 0.0;
    for (int i = 0; i < 12; i++) d[i] = later[slot + i] - earlier[slot + i];
    for (int i = 0; i < 3; i++) {
      const double *turn = linear + width * i;
      double m[4];
      for (int j = 0; j < 4; j++) m[j] = turn[0] * d[j] + turn[1] * d[4 + j] + turn[2] * d[8 + j];
      double way = fabs(m[0] * centre[0] + m[1] * centre[1] + m[2] * centre[2] + m[3]);
      way += fabs(m[0]) * half[0] + fabs(m[1]) * half[1] + fabs(m[2]) * half[2];
      squared += way * way;
    }
    most = hfx_larger(most, squared);
  }
  return sqrt(most);
}

// How far a bone takes the cells of a group from where all together do, whose matrix is `mean`.
static inline double hfx_apart(const double *matrix, const double *mean, const double *box) {
  double squared = 0.0;
  for (int i = 0; i < 3; i++) {
    double d[4];
    for (int j = 0; j < 4; j++) d[j] = matrix[4 * i + j] - mean[4 * i + j];
    double way = fabs(d[0] * box[0] + d[1] * box[1] + d[2] * box[2] + d[3]);
    way += fabs(d[0]) * box[3] + fabs(d[1]) * box[4] + fabs(d[2]) * box[5];
    squared += way * way;
  }
  return sqrt(squared);
}

// See CellSizes.means: no less than the mean distance of any cell's skin from its vertex at a row.
static inline double hfx_cell_mean(const hfx_bones *bones, const hfx_groups *known, int64_t row) {
  const double *matrices = bones->matrices + 12 * row * bones->count;
  const double *stretches = bones->stretches + row * bones->count;
  double most = 0.0;
  for (int64_t g = 0; g < known->count; g++) {
    int64_t first = known->starts[g], last = known->starts[g + 1];
    double stretch = 0.0, bent = 0.0, mean[12] = {0.0};
    for (int64_t p = first; p < last; p++) {
      int64_t slot = bones->slots[known->bones[p]];
      stretch = hfx_larger(stretch, stretches[slot]);
      if (last - first > 1)
        for (int i = 0; i < 12; i++) mean[i] += known->shares[p] * matrices[12 * slot + i];
    }
    for (int64_t p = first; p < last && last - first > 1; p++) {
      int64_t slot = bones->slots[known->bones[p]];
      if (known->changes[p] != 0.0)
        bent += known->changes[p] * hfx_apart(matrices + 12 * slot, mean, known->boxes + 6 * g);
    }
    most = hfx_larger(most, stretch * known->distances[g] + bent);
  }
  return most;
}

#endif
