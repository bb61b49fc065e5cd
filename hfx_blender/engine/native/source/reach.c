// SPDX-License-Identifier: GPL-3.0-or-later
// Broad phase: which clusters a volume can reach, at which rows, and between. See
// engine/{placed,swept}.py, whose terms these are.

#include <math.h>
#include <string.h>

#include "analytic.h"
#include "broad.h"
#include "hfx_native.h"
#include "outline.h"
#include "skin.h"
#include "skin_posing.h"

#define LEAST_EDGE 1e-4

// A body's clusters and a volume at some rows.
typedef struct {
  int64_t rows;
  const hfx_outline *outline;
  const double *matrices;     // (rows, 4, 4) shape space to world
  const double *boxes;        // (rows, 2, 3) world, of the volume
  const double *low, *high;   // (all rows, clusters, 3) world, of the clusters
  const double *of_rows;      // (all rows, 2, 3) around all clusters
  const double *of_clusters;  // (clusters, 2, 3) at all rows
  const int64_t *at;          // (rows,) which of all rows
  const uint8_t *follows;     // (rows,) whether the row before is the sample before
  const uint8_t *heard;       // (rows,) whether it is reported
  const double *turns;        // (2, rows) of volume and body since the row before; NULL: none
  double edge_m;
  int64_t is_split;
  // What is found out.
  uint8_t *flags;      // (clusters, rows)
  int64_t *near;       // (clusters,) those that the volume's box can meet at all
  int64_t near_count;
} hfx_broad;

enum { TOUCHES = 1, SIMPLE = 2, FOLLOWED = 4, NEEDED = 8 };

// Whether two boxes meet; a number that is none meets nothing.
static inline int overlap(const double *low, const double *high, const double *box) {
  for (int i = 0; i < 3; i++)
    if (!(low[i] <= box[3 + i] && high[i] >= box[i])) return 0;
  return 1;
}

// Which clusters the volume can meet at any row, or within `swing` of its boxes.
static void find_near(hfx_broad *broad, double swing) {
  double box[6];
  for (int i = 0; i < 3; i++) box[i] = INFINITY, box[3 + i] = -INFINITY;
  for (int64_t n = 0; n < broad->rows; n++)
    for (int i = 0; i < 3; i++) {
      box[i] = fmin(box[i], broad->boxes[6 * n + i] - swing);
      box[3 + i] = fmax(box[3 + i], broad->boxes[6 * n + 3 + i] + swing);
    }
  broad->near_count = 0;
  for (int64_t c = 0; c < broad->outline->clusters; c++) {
    const double *whole = broad->of_clusters + 6 * c;
    if (overlap(whole, whole + 3, box)) broad->near[broad->near_count++] = c;
  }
}

// Which clusters' boxes meet the volume's at which rows; how often that is the case.
HFX_EXPORT int64_t hfx_overlaps(hfx_broad *broad, uint8_t *is_met) {
  int64_t count = 0, rows = broad->rows, clusters = broad->outline->clusters;
  memset(broad->flags, 0, (size_t)(rows * clusters));
  memset(is_met, 0, (size_t)clusters);
  find_near(broad, 0.0);
  for (int64_t k = 0; k < broad->near_count; k++) {
    int64_t c = broad->near[k];
    for (int64_t n = 0; n < rows; n++) {
      int64_t at = 3 * (broad->at[n] * clusters + c);
      if (!overlap(broad->low + at, broad->high + at, broad->boxes + 6 * n)) continue;
      broad->flags[c * rows + n] = is_met[c] = TOUCHES;
      count++;
    }
  }
  return count;
}

// See placed._enclosed: whether all of a box is inside a volume.
static int encloses(const hfx_broad *broad, const hfx_target *target, int64_t n, const double *low,
                    const double *high) {
  const double *box = broad->boxes + 6 * n, *to_shape = target->to_shape + 16 * n;
  hfx_shape shape = {target->kinds[n], target->halves[n]};
  for (int i = 0; i < 3; i++)
    if (!(low[i] >= box[i] && high[i] <= box[3 + i])) return 0;
  for (int k = 0; k < 8; k++) {
    double corner[3], local[3];
    for (int i = 0; i < 3; i++) corner[i] = (k >> i & 1) ? high[i] : low[i];
    for (int i = 0; i < 3; i++) local[i] = hfx_dot(to_shape + 4 * i, corner) + to_shape[4 * i + 3];
    if (!hfx_contains(shape, local)) return 0;
  }
  return 1;
}

// How far the corners of a box (2, 3) are from an origin at most, squared.
static double arm_of(const double *box, const double *matrix) {
  double squared = 0.0;
  for (int i = 0; i < 3; i++) {
    double o = matrix[4 * i + 3], each = hfx_larger(fabs(box[i] - o), fabs(box[3 + i] - o));
    squared += each * each;
  }
  return squared;
}

// See Placed._swings: how far turning may take anything out of both ends' boxes, metres.
static double swing_of(const hfx_broad *broad, const hfx_target *target, int64_t n) {
  double swing = 0.0;
  for (int k = 0; k < 2 && broad->turns; k++) {
    double angle = broad->turns[k * broad->rows + n], arm = 0.0;
    if (angle == 0.0) continue;
    for (int64_t row = n - 1; row <= n; row++)
      arm = hfx_larger(arm, k ? arm_of(broad->of_rows + 6 * broad->at[row], target->to_world + 16 * row)
                              : arm_of(broad->boxes + 6 * row, broad->matrices + 16 * row));
    swing += sqrt(arm) * (1.0 - cos(0.5 * angle));
  }
  return swing;
}

// See swept.unseen_m.
static double unseen(const hfx_target *target, int64_t n, double edge, double steepest) {
  double most = 0.0;
  for (int i = 0; i < 3; i++) {
    const double *m = target->to_shape + 16 * n + 4 * i;
    most = hfx_larger(most, hfx_dot(m, m));
  }
  double thin = 1.0 / sqrt(most), hidden = edge;
  if (!target->is_flat) hidden = hfx_larger(hidden, target->amplitude / steepest * thin);
  return hfx_smaller(thin, 2.0 * hidden);
}

// See SkinnedModel.cluster_moves: how far anything in a cluster can have moved against the volume
// since the row before, metres.
static double moved_m(const hfx_broad *broad, const hfx_bones *bones, int64_t n, int64_t c) {
  const hfx_outline *known = broad->outline;
  return hfx_box_moves(bones, n - 1, n, broad->matrices + 16 * n, 4, known->starts[c], known->starts[c + 1],
                       known->pair_bones, known->centres, known->halves);
}

// See swept.steps_for.
static int64_t steps_for(double angle, double moved, double edge) {
  double wanted = sqrt(0.5 * 3.14159265358979323846 * moved * angle / 8.0 / fmax(edge, LEAST_EDGE));
  if (!isfinite(wanted)) return MOST_STEPS;
  int64_t steps = 1;
  while ((double)steps < wanted && steps < MOST_STEPS) steps *= 2;
  return steps;
}

// Whether at a row vertices tell enough of a cluster that is met.
static int is_simple(const hfx_broad *broad, const hfx_target *target, const hfx_bones *bones,
                     const hfx_groups *groups, double steepest, int64_t c, int64_t n) {
  int64_t at = 3 * (broad->at[n] * broad->outline->clusters + c);
  if (target->is_flat) return encloses(broad, target, n, broad->low + at, broad->high + at);
  if (!broad->is_split) return 1;
  return target->amplitude > 0.0 && hfx_is_even(bones, groups + c, n, steepest, target->amplitude);
}

// Which near clusters may meet the volume between a row and the one before it.
static void follow(hfx_broad *broad, const hfx_target *target, const hfx_bones *bones, double steepest,
                   int64_t n) {
  int64_t rows = broad->rows, clusters = broad->outline->clusters;
  double swing = swing_of(broad, target, n), limit = unseen(target, n, broad->edge_m, steepest);
  const double *boxes = broad->boxes + 6 * n;
  double box[6];
  for (int i = 0; i < 3; i++) {
    box[i] = hfx_smaller(boxes[i], boxes[i - 6]) - swing;
    box[3 + i] = hfx_larger(boxes[3 + i], boxes[i - 3]) + swing;
  }
  int64_t now = 3 * broad->at[n] * clusters, before = 3 * broad->at[n - 1] * clusters;
  for (int64_t k = 0; k < broad->near_count; k++) {
    int64_t c = broad->near[k];
    const double *low = broad->low + 3 * c, *high = broad->high + 3 * c;
    int meets = 1;
    for (int i = 0; i < 3 && meets; i++)
      meets = hfx_smaller(low[now + i], low[before + i]) <= box[3 + i] &&
              hfx_larger(high[now + i], high[before + i]) >= box[i];
    if (!meets) continue;
    uint8_t *flag = broad->flags + c * rows + n;
    // From wholly inside nothing enters; to there it is felt anyway.
    if (target->is_flat && ((flag[0] | flag[-1]) & SIMPLE)) continue;
    if (!(moved_m(broad, bones, n, c) <= limit)) *flag |= FOLLOWED;
  }
}

// Which clusters are looked at, at which rows, and how; see contact.begin. `groups` are known for
// clusters that are met where the volume falls off. How many pairs there are.
HFX_EXPORT int64_t hfx_reach(hfx_broad *broad, const hfx_target *target, const hfx_bones *bones,
                             const hfx_groups *groups) {
  double steepest = hfx_steepest(target), widest = 0.0;
  int64_t rows = broad->rows, count = 0;
  for (int64_t k = 0; k < broad->near_count; k++) {
    int64_t c = broad->near[k];
    uint8_t *flags = broad->flags + c * rows;
    for (int64_t n = 0; n < rows; n++)
      if (flags[n] && is_simple(broad, target, bones, groups, steepest, c, n)) flags[n] |= SIMPLE;
  }
  if (isfinite(broad->edge_m)) {
    for (int64_t n = 1; n < rows; n++)
      if (broad->follows[n]) widest = fmax(widest, swing_of(broad, target, n));
    if (widest > 0.0) find_near(broad, widest);
    for (int64_t n = 1; n < rows; n++)
      if (broad->follows[n]) follow(broad, target, bones, steepest, n);
  }
  for (int64_t k = 0; k < broad->near_count; k++) {
    uint8_t *flags = broad->flags + broad->near[k] * rows;
    for (int64_t n = 0; n < rows; n++) {
      int is_before = n + 1 < rows && (flags[n + 1] & FOLLOWED);
      if (!(((flags[n] & TOUCHES) && broad->heard[n]) || (flags[n] & FOLLOWED) || is_before)) continue;
      flags[n] |= NEEDED;
      count++;
    }
  }
  return count;
}

// How the cells of a pair are looked at.
static uint8_t how_of(const hfx_broad *broad, const hfx_target *target, uint8_t flag) {
  if (!(flag & TOUCHES)) return HFX_NOT;
  if (target->is_flat && (flag & SIMPLE)) return HFX_WHOLE;
  return (flag & SIMPLE) || !broad->is_split ? HFX_BY_VERTEX : HFX_COVERED;
}

// The pairs that hfx_reach counted. Of their clusters, each once, ascending: all; those whose skin is
// covered or followed; those of which vertices tell. `lists` has room for all near clusters thrice.
HFX_EXPORT void hfx_pair_up(const hfx_broad *broad, const hfx_target *target, const hfx_bones *bones,
                            const hfx_pairs *pairs, int64_t *lists, int64_t counts[3]) {
  int64_t rows = broad->rows, p = 0;
  counts[0] = counts[1] = counts[2] = 0;
  for (int64_t k = 0; k < broad->near_count; k++) {
    int64_t c = broad->near[k], is_in[3] = {0, 0, 0};
    for (int64_t n = 0; n < rows; n++) {
      uint8_t flag = broad->flags[c * rows + n];
      if (!(flag & NEEDED)) continue;
      uint8_t how = how_of(broad, target, flag);
      int is_followed = (flag & FOLLOWED) != 0;
      pairs->clusters[p] = c, pairs->rows[p] = n, pairs->how[p] = how;
      pairs->steps[p] = is_followed;
      double angle = !broad->turns ? 0.0 : broad->turns[n] + broad->turns[rows + n];
      if (is_followed && angle > 0.0)
        pairs->steps[p] = steps_for(angle, moved_m(broad, bones, n, c), broad->edge_m);
      is_in[0] = 1, is_in[1] |= is_followed || how == HFX_COVERED, is_in[2] |= how == HFX_BY_VERTEX;
      p++;
    }
    for (int i = 0; i < 3; i++)
      if (is_in[i]) lists[i * broad->near_count + counts[i]++] = c;
  }
}
