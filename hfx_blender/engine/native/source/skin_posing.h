// SPDX-License-Identifier: GPL-3.0-or-later
// Posing a cluster at one row.

#ifndef HFX_SKIN_POSING_H
#define HFX_SKIN_POSING_H

#include <math.h>

#include "numbers.h"
#include "pairs_of_numbers.h"
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

// The matrix of a bone of `all` in a pose, rest to target space, (3, 4); any other rests.
static inline void hfx_find_matrix(const double *posed, int64_t posed_bones, int64_t bone,
                                   const double *target, double *matrix) {
  static const double rest[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
  const double *m = bone < 0 || bone >= posed_bones ? rest : posed + 12 * bone;
  for (int i = 0; i < 3; i++, matrix += 4, target += 4) {
    for (int j = 0; j < 4; j++) matrix[j] = target[0] * m[j] + target[1] * m[4 + j] + target[2] * m[8 + j];
    matrix[3] += target[3];
  }
}

// The matrices of a cluster's bones at a row, one after the other: 6 of these each.
static inline void hfx_find_matrices(const hfx_cluster *cluster, const hfx_bones *bones, int64_t row,
                                     hfx_two *matrices) {
  for (int64_t b = 0; b < cluster->bone_count; b++) {
    int64_t slot = bones->slots[cluster->bones[b]];
    const hfx_loose *m = (const hfx_loose *)(bones->matrices + 12 * (row * bones->count + slot));
    for (int i = 0; i < 6; i++) *matrices++ = m[i];
  }
}

static inline void hfx_move(const hfx_two matrix[6], const double *rest, double point[3]) {
  const hfx_loose *place = (const hfx_loose *)rest;
  for (int i = 0; i < 3; i++) {
    hfx_two sums = matrix[2 * i] * place[0] + matrix[2 * i + 1] * place[1];
    point[i] = sums[0] + sums[1];
  }
}

// Position of a place of a cluster.
static inline void hfx_pose(const hfx_cluster *cluster, const hfx_two *matrices, int64_t place,
                            double point[3]) {
  int64_t first = cluster->firsts[place], last = cluster->firsts[place + 1];
  hfx_two mean[6] = {{0.0, 0.0}};
  for (int64_t e = first; e < last; e++) {
    const hfx_two *m = matrices + 6 * cluster->entry_bones[e];
    for (int i = 0; i < 6; i++) mean[i] += m[i] * cluster->weights[e];
  }
  hfx_move(mean, cluster->rest + 4 * place, point);
}

// The same of a place that is the only one, or nearly, that is asked for at a row.
static inline void hfx_pose_one(const hfx_cluster *cluster, const hfx_bones *bones, int64_t row,
                                int64_t place, double point[3]) {
  const double *matrices = bones->matrices + 12 * row * bones->count;
  hfx_two mean[6] = {{0.0, 0.0}};
  for (int64_t e = cluster->firsts[place]; e < cluster->firsts[place + 1]; e++) {
    int64_t slot = bones->slots[cluster->bones[cluster->entry_bones[e]]];
    const hfx_loose *m = (const hfx_loose *)(matrices + 12 * slot);
    for (int i = 0; i < 6; i++) mean[i] += m[i] * cluster->weights[e];
  }
  hfx_move(mean, cluster->rest + 4 * place, point);
}

// Largest distance by which a difference of two matrices moves a place of a cluster's box, whose centre and
// radius are the last of `moved`, see hfx_cluster.
static inline double hfx_box_move(const hfx_two difference[6], const double *moved) {
  hfx_two centre[2] = {{moved[1], moved[2]}, {moved[3], moved[4]}}, squares = {0.0, 0.0};
  double way = 0.0, turned = 0.0;
  for (int i = 0; i < 3; i++) {
    hfx_two one = difference[2 * i], other = difference[2 * i + 1];
    hfx_two sums = one * centre[0] + other * centre[1];
    double each = sums[0] + sums[1];
    way += each * each, turned += other[0] * other[0], squares += one * one;
  }
  hfx_two lengths = hfx_roots((hfx_two){way, turned + squares[0] + squares[1]});
  return lengths[0] + lengths[1] * moved[5];
}

// The matrix of a bone of a cluster at a row.
static inline const hfx_loose *hfx_matrix_of(const hfx_cluster *cluster, const hfx_bones *bones, int64_t row,
                                             int64_t bone) {
  return (const hfx_loose *)(bones->matrices + 12 * (row * bones->count + bones->slots[cluster->bones[bone]]));
}

// Largest distance that any place of a cluster can have moved from one row to another, straight.
static inline double hfx_moved(const hfx_cluster *cluster, const hfx_bones *bones, int64_t before,
                               int64_t after) {
  double most = 0.0;
  for (int64_t b = 0; b < cluster->bone_count; b++) {
    const hfx_loose *one = hfx_matrix_of(cluster, bones, before, b);
    const hfx_loose *other = hfx_matrix_of(cluster, bones, after, b);
    hfx_two difference[6];
    for (int i = 0; i < 6; i++) difference[i] = other[i] - one[i];
    most = hfx_larger(most, hfx_box_move(difference, cluster->moved + 6 * b));
  }
  return most;
}

// Bounds of a posed cluster without posing any of it.
typedef struct {
  double along;              // units are no farther from their neighbours than this times their
  double *apart;             // distance at rest plus, of each bone, this times how far weights differ
  double middle[3], radius;  // a ball that holds all of it
} hfx_spread;

// A place x that bones M_b move with weights w_b is at the sum of all
// w_b M_b x: of such a sum only how the M_b differ from their mean, and how that stretches, matters.
static inline void hfx_find_spread(const hfx_cluster *cluster, const hfx_bones *bones, int64_t row,
                                   hfx_spread *spread) {
  hfx_two mean[6] = {{0.0, 0.0}};
  double farthest = 0.0;
  spread->along = 0.0;
  for (int64_t b = 0; b < cluster->bone_count; b++) {
    const hfx_loose *m = hfx_matrix_of(cluster, bones, row, b);
    double stretch = bones->stretches[row * bones->count + bones->slots[cluster->bones[b]]];
    spread->along = hfx_larger(spread->along, stretch);
    for (int i = 0; i < 6; i++) mean[i] += m[i] * cluster->moved[6 * b];
  }
  for (int64_t b = 0; b < cluster->bone_count; b++) {
    spread->apart[b] = 0.0;
    if (cluster->bone_count < 2) break;
    const hfx_loose *m = hfx_matrix_of(cluster, bones, row, b);
    hfx_two difference[6];
    for (int i = 0; i < 6; i++) difference[i] = m[i] - mean[i];
    spread->apart[b] = hfx_box_move(difference, cluster->moved + 6 * b);
    farthest = hfx_larger(farthest, spread->apart[b]);
  }
  hfx_move(mean, cluster->moved + 1, spread->middle);
  spread->radius = farthest + spread->along * cluster->moved[5];
}

// Largest squared distance that anything in a box can have moved from one matrix to another.
// `linear`, whose rows are `width` apart, leads from the space of the matrices to that of moves.
static inline double hfx_moved_squared(const double *earlier, const double *later, const double *linear,
                                       int width, const double *centre, const double *half) {
  const hfx_loose *one = (const hfx_loose *)earlier, *other = (const hfx_loose *)later;
  hfx_two middle[2] = {{centre[0], centre[1]}, {centre[2], 1.0}};
  hfx_two size[2] = {{half[0], half[1]}, {half[2], 0.0}}, d[6];
  double squared = 0.0;
  for (int i = 0; i < 6; i++) d[i] = other[i] - one[i];
  for (int i = 0; i < 3; i++, linear += width) {
    hfx_two m[2] = {d[0] * linear[0] + d[2] * linear[1] + d[4] * linear[2],
                    d[1] * linear[0] + d[3] * linear[1] + d[5] * linear[2]};
    hfx_two moved = m[0] * middle[0] + m[1] * middle[1];
    hfx_two turned = hfx_sizes(m[0]) * size[0] + hfx_sizes(m[1]) * size[1];
    double way = fabs(moved[0] + moved[1]) + (turned[0] + turned[1]);
    squared += way * way;
  }
  return squared;
}

// Largest motion of anything in boxes that bones move, from one row to another. A pair: a bone and a box.
static inline double hfx_box_moves(const hfx_bones *bones, int64_t before, int64_t after,
                                   const double *linear, int width, int64_t first, int64_t last,
                                   const int64_t *pair_bones, const double *centres,
                                   const double *halves) {
  const double *earlier = bones->matrices + 12 * before * bones->count;
  const double *later = bones->matrices + 12 * after * bones->count;
  double most = 0.0;
  for (int64_t p = first; p < last; p++) {
    int64_t slot = 12 * bones->slots[pair_bones[p]];
    most = hfx_larger(most, hfx_moved_squared(earlier + slot, later + slot, linear, width,
                                              centres + 3 * p, halves + 3 * p));
  }
  return sqrt(most);
}

// Distance between a place in the box of a group by one bone's matrix and by the `mean` of all, at most.
static inline double hfx_apart(const double *matrix, const hfx_two *mean, const double *box) {
  const hfx_loose *m = (const hfx_loose *)matrix;
  hfx_two middle[2] = {{box[0], box[1]}, {box[2], 1.0}}, half[2] = {{box[3], box[4]}, {box[5], 0.0}};
  double squared = 0.0;
  for (int i = 0; i < 3; i++) {
    hfx_two d[2] = {m[2 * i] - mean[2 * i], m[2 * i + 1] - mean[2 * i + 1]};
    hfx_two moved = d[0] * middle[0] + d[1] * middle[1];
    hfx_two turned = hfx_sizes(d[0]) * half[0] + hfx_sizes(d[1]) * half[1];
    double way = fabs(moved[0] + moved[1]) + (turned[0] + turned[1]);
    squared += way * way;
  }
  return sqrt(squared);
}

// No less than the mean distance of any cell's skin of a group from its vertex, in a row's matrices.
static inline double hfx_group_mean(const hfx_groups *known, int64_t group, const int64_t *slots,
                                    const double *matrices, const double *stretches) {
  int64_t first = known->starts[group], last = known->starts[group + 1];
  double stretch = 0.0, bent = 0.0;
  hfx_two mean[6] = {{0.0, 0.0}};
  for (int64_t p = first; p < last; p++) {
    int64_t slot = slots[known->bones[p]];
    const hfx_loose *m = (const hfx_loose *)(matrices + 12 * slot);
    stretch = hfx_larger(stretch, stretches[slot]);
    if (last - first > 1)
      for (int i = 0; i < 6; i++) mean[i] += known->shares[p] * m[i];
  }
  for (int64_t p = first; p < last && last - first > 1; p++)
    if (known->changes[p] != 0.0)
      bent += known->changes[p] *
              hfx_apart(matrices + 12 * slots[known->bones[p]], mean, known->boxes + 6 * group);
  return stretch * known->distances[group] + bent;
}

// True if that of every group of a cluster is no more than `limit` when `scale` times as large.
static inline int hfx_is_even(const hfx_bones *bones, const hfx_groups *known, int64_t row,
                              double scale, double limit) {
  const double *matrices = bones->matrices + 12 * row * bones->count;
  const double *stretches = bones->stretches + row * bones->count;
  for (int64_t g = 0; g < known->count; g++)
    if (!(scale * hfx_group_mean(known, g, bones->slots, matrices, stretches) <= limit)) return 0;
  return 1;
}

#endif
