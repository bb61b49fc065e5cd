// SPDX-License-Identifier: GPL-3.0-or-later
// Posing a cluster at one row.

#ifndef HFX_SKIN_POSING_H
#define HFX_SKIN_POSING_H

#include <math.h>

#include "skin.h"

// Smaller and larger, and not a number where either is.
static inline double hfx_smaller(double a, double b) { return (a <= b || a != a) ? a : b; }
static inline double hfx_larger(double a, double b) { return (a >= b || a != a) ? a : b; }

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

// Bounds of how far a cluster's units can be from their neighbours at a row: `along` times their
// distance at rest plus `apart` times how far their weights differ. See _SkinnedClusters.skin.
static inline void hfx_gap_factors(const hfx_cluster *cluster, const hfx_bones *bones, int64_t row,
                                   double *along, double *apart) {
  double middle[12] = {0.0};
  *along = *apart = 0.0;
  for (int64_t b = 0; b < cluster->bone_count; b++) {
    int64_t at = row * bones->count + bones->slots[cluster->bones[b]];
    const double *m = bones->matrices + 12 * at;
    *along = hfx_larger(*along, bones->stretches[at]);
    for (int i = 0; i < 12; i++) middle[i] += m[i] * cluster->moved[6 * b];
  }
  if (cluster->bone_count < 2) return;
  for (int64_t b = 0; b < cluster->bone_count; b++) {
    const double *m = bones->matrices + 12 * (row * bones->count + bones->slots[cluster->bones[b]]);
    const double *moved = cluster->moved + 6 * b;
    double way = 0.0, turned = 0.0;
    for (int i = 0; i < 3; i++) {
      double d[4];
      for (int j = 0; j < 4; j++) d[j] = m[4 * i + j] - middle[4 * i + j];
      double each = d[0] * moved[1] + d[1] * moved[2] + d[2] * moved[3] + d[3] * moved[4];
      way += each * each;
      turned += d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
    }
    *apart = hfx_larger(*apart, sqrt(way) + sqrt(turned) * moved[5]);
  }
}

#endif
