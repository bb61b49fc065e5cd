// SPDX-License-Identifier: GPL-3.0-or-later
// Broad phase: which clusters a volume can reach, at which rows, and between.

#include <math.h>
#include <string.h>

#include "analytic.h"
#include "broad.h"
#include "hfx_native.h"
#include "skin.h"
#include "skin_posing.h"

#define LEAST_EDGE 1e-4
#define MESH_WALL_M 0.001  // walls of meshes, whose thickness is not known, are taken to be no thinner
#define SWEPT_PARTS 8.0    // of the way of a turning mesh, see PlacedTarget.find_swept

// A body's clusters at the rows of a volume.
typedef struct {
  const hfx_outline *outline; // or NULL: places are given
  int64_t clusters;
  const int64_t *row;         // (rows,) of the block, ascending
  const int64_t *box_rows;    // (bounds,) the same of the boxes of the clusters
  const double *low, *high;   // (bounds, clusters, 3) world, of the clusters
  const double *of_rows;      // (bounds, 2, 3) around all clusters
  const double *of_clusters;  // (clusters, 2, 3) at all of them
  const uint8_t *follows;     // (rows,) whether the row before is the sample before
  const uint8_t *reported;    // (rows,) whether it is reported
  double edge_m;
  int64_t is_split;
  int64_t is_always;          // what may pass is followed, however slowly
  // Results.
  int64_t *box_at;     // (rows,) which of the boxes' rows
  uint8_t *flags;      // (clusters, rows)
  int64_t *near;       // (clusters,) those that the volume can meet at all, ascending
  int64_t near_count;
} hfx_broad;

// Pose of its bones.
typedef struct {
  const double *posed;       // (block, all, 3, 4) rest space to posed armature space
  int64_t bone_count;
  const int64_t *bones;      // those that matter: one that is not among all rests
  const hfx_outline *own;    // of the clusters' own vertices where the skin has others, or NULL
} hfx_posed;

enum { TOUCHES = 1, SIMPLE = 2, FOLLOWED = 4, NEEDED = 8 };

// True if two boxes meet; NaN meets nothing.
static inline int overlap(const double *low, const double *high, const double *box) {
  for (int i = 0; i < 3; i++)
    if (!(low[i] <= box[3 + i] && high[i] >= box[i])) return 0;
  return 1;
}

// Lists clusters that the volume can meet at any row, or within `swing` of its boxes.
static void find_near(hfx_broad *broad, const hfx_target *target, double swing) {
  double box[6];
  for (int i = 0; i < 3; i++) box[i] = INFINITY, box[3 + i] = -INFINITY;
  for (int64_t n = 0; n < target->rows; n++)
    for (int i = 0; i < 3; i++) {
      box[i] = fmin(box[i], target->boxes[6 * n + i] - swing);
      box[3 + i] = fmax(box[3 + i], target->boxes[6 * n + 3 + i] + swing);
    }
  broad->near_count = 0;
  for (int64_t c = 0; c < broad->clusters; c++) {
    const double *whole = broad->of_clusters + 6 * c;
    if (overlap(whole, whole + 3, box)) broad->near[broad->near_count++] = c;
  }
}

// True if all of a box is inside a volume.
static int encloses(const hfx_target *target, int64_t n, const double *low, const double *high) {
  const double *box = target->boxes + 6 * n, *to_shape = target->to_shape + 16 * n;
  hfx_shape shape = {target->kinds[n], target->halves[n], NULL};
  if (shape.kind == HFX_MESH) return 0;
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

// Largest squared distance of the corners of a box (2, 3) from an origin.
static double arm_of(const double *box, const double *matrix) {
  double squared = 0.0;
  for (int i = 0; i < 3; i++) {
    double o = matrix[4 * i + 3], each = hfx_larger(fabs(box[i] - o), fabs(box[3 + i] - o));
    squared += each * each;
  }
  return squared;
}

// Largest distance by which turning may take anything out of both ends' boxes, metres.
static double swing_of(const hfx_broad *broad, const hfx_target *target, int64_t n) {
  double swing = 0.0;
  for (int k = 0; k < 2; k++) {
    double angle = target->turns[k * target->rows + n], arm = 0.0;
    if (angle == 0.0) continue;
    if (target->swept && !k && target->kinds[n] == HFX_MESH) angle /= SWEPT_PARTS;
    for (int64_t row = n - 1; row <= n; row++)
      arm = hfx_larger(arm, k ? arm_of(broad->of_rows + 6 * broad->box_at[row], target->to_world + 16 * row)
                              : arm_of(target->boxes + 6 * row, target->matrices + 16 * row));
    swing += sqrt(arm) * (1.0 - cos(0.5 * angle));
  }
  return swing;
}

// Finds ascending `rows` in ascending `all`, whose last is no less than theirs.
static void find_rows(const int64_t *all, const int64_t *rows, int64_t count, int64_t *at) {
  for (int64_t n = 0, k = 0; n < count; n++) {
    while (all[k] < rows[n]) k++;
    at[n] = k;
  }
}

// Finds clusters whose boxes meet the volume's, and at which rows. Returns how many do at any, and
// lists them in `met`, which has room for all.
HFX_EXPORT int64_t hfx_overlaps(hfx_broad *broad, const hfx_target *target, int64_t *met) {
  int64_t count = 0, rows = target->rows, clusters = broad->clusters;
  double widest = 0.0;
  find_rows(broad->box_rows, broad->row, rows, broad->box_at);
  memset(broad->flags, 0, (size_t)(rows * clusters));
  for (int64_t n = 1; n < rows && isfinite(broad->edge_m); n++)
    if (broad->follows[n]) widest = fmax(widest, swing_of(broad, target, n));
  find_near(broad, target, widest);
  for (int64_t k = 0; k < broad->near_count; k++) {
    int64_t c = broad->near[k];
    int is_met = 0;
    for (int64_t n = 0; n < rows; n++) {
      int64_t at = 3 * (broad->box_at[n] * clusters + c);
      if (!overlap(broad->low + at, broad->high + at, target->boxes + 6 * n)) continue;
      broad->flags[c * rows + n] = TOUCHES, is_met = 1;
    }
    if (is_met) met[count++] = c;
  }
  return count;
}

// The largest motion of skin since the row before that needs no tracking, metres: half of the volume's least
// width, so that nothing passes through it, and no more than can hide a contact of depth `edge`, or one
// that falloff keeps weaker than the tolerance.
static double unseen(const hfx_target *target, int64_t n, double edge, double steepest) {
  double most = 0.0;
  if (target->kinds[n] == HFX_MESH) return hfx_smaller(MESH_WALL_M, 2.0 * edge);
  for (int i = 0; i < 3; i++) {
    const double *m = target->to_shape + 16 * n + 4 * i;
    most = hfx_larger(most, hfx_dot(m, m));
  }
  double thin = 1.0 / sqrt(most), hidden = edge;
  if (!target->is_flat) hidden = hfx_larger(hidden, target->amplitude / steepest * thin);
  return hfx_smaller(thin, 2.0 * hidden);
}

// Largest distance by which anything in a cluster whose places are given has moved against the
// volume since the row before, metres.
static double surface_moved_m(const hfx_target *target, const hfx_surface_places *surface, int64_t n,
                            int64_t c) {
  double most = 0.0;
  for (int64_t p = surface->starts[c]; p < surface->starts[c + 1]; p++) {
    double ends[2][3], squared = 0.0;
    for (int64_t k = 0; k < 2; k++) {
      int64_t row = n - 1 + k, from = surface->at[row] * surface->place_count + p;
      hfx_moved_by(target->body_to_shape + 16 * row, surface->places + 3 * from, ends[k]);
    }
    for (int i = 0; i < 3; i++) ends[1][i] -= ends[0][i];
    for (int i = 0; i < 3; i++) {
      double way = hfx_dot(target->matrices + 16 * n + 4 * i, ends[1]);
      squared += way * way;
    }
    most = hfx_larger(most, squared);
  }
  return sqrt(most);
}

// The same of any cluster; no less where bones move it.
static double moved_m(const hfx_broad *broad, const hfx_target *target, const hfx_bones *bones, int64_t n,
                      const hfx_surface_places *surface, int64_t c) {
  const hfx_outline *known = broad->outline;
  if (surface) return surface_moved_m(target, surface, n, c);
  return hfx_box_moves(bones, n - 1, n, target->matrices + 16 * n, 4, known->starts[c], known->starts[c + 1],
                       known->pair_bones, known->centres, known->halves);
}

// Straight steps, a power of two, that follow a turning motion within `edge`: an arc of length s that turns
// by an angle a leaves its chord by s a / 8, and n steps divide that by n squared.
static int64_t steps_for(double angle, double moved, double edge) {
  double wanted = sqrt(0.5 * 3.14159265358979323846 * moved * angle / 8.0 / fmax(edge, LEAST_EDGE));
  if (!isfinite(wanted)) return MOST_STEPS;
  int64_t steps = 1;
  while ((double)steps < wanted && steps < MOST_STEPS) steps *= 2;
  return steps;
}

// True if at a row vertices suffice for a cluster that is met.
static int is_simple(const hfx_broad *broad, const hfx_target *target, const hfx_bones *bones,
                     const hfx_groups *groups, double steepest, int64_t c, int64_t n) {
  int64_t at = 3 * (broad->box_at[n] * broad->clusters + c);
  if (target->is_flat) return encloses(target, n, broad->low + at, broad->high + at);
  if (!broad->is_split) return 1;
  if (!groups || !(target->amplitude > 0.0)) return 0;
  const hfx_mesh *mesh = target->meshes[n];  // whose strength rises over its largest depth
  if (mesh) steepest = mesh->depth > 0.0 ? steepest / mesh->depth : 0.0;
  return hfx_is_even(bones, groups + c, n, steepest, target->amplitude);
}

// Marks near clusters that may meet the volume between a row and the one before it.
static void follow(hfx_broad *broad, const hfx_target *target, const hfx_bones *bones,
                   const hfx_surface_places *surface, double steepest, int64_t n) {
  int64_t rows = target->rows, clusters = broad->clusters;
  double swing = swing_of(broad, target, n), limit = unseen(target, n, broad->edge_m, steepest);
  const double *boxes = target->boxes + 6 * n;
  double box[6];
  for (int i = 0; i < 3; i++) {
    box[i] = (target->swept ? target->swept[6 * n + i] : hfx_smaller(boxes[i], boxes[i - 6])) - swing;
    box[3 + i] =
        (target->swept ? target->swept[6 * n + 3 + i] : hfx_larger(boxes[3 + i], boxes[i - 3])) + swing;
  }
  int64_t now = 3 * broad->box_at[n] * clusters, before = 3 * broad->box_at[n - 1] * clusters;
  for (int64_t k = 0; k < broad->near_count; k++) {
    int64_t c = broad->near[k];
    const double *low = broad->low + 3 * c, *high = broad->high + 3 * c;
    int meets = 1;
    for (int i = 0; i < 3 && meets; i++)
      meets = hfx_smaller(low[now + i], low[before + i]) <= box[3 + i] &&
              hfx_larger(high[now + i], high[before + i]) >= box[i];
    if (!meets) continue;
    uint8_t *flag = broad->flags + c * rows + n;
    // Skin enters nothing from wholly inside, and is felt anyway where it gets there.
    if (target->is_flat && ((flag[-1] | (broad->is_always ? 0 : flag[0])) & SIMPLE)) continue;
    if (broad->is_always || !(moved_m(broad, target, bones, n, surface, c) <= limit)) *flag |= FOLLOWED;
  }
}

// Kind of test for the cells of a pair.
static uint8_t how_of(const hfx_broad *broad, const hfx_target *target, uint8_t flag) {
  if (!(flag & TOUCHES)) return HFX_NOT;
  if (target->is_flat && (flag & SIMPLE)) return HFX_WHOLE;
  return (flag & SIMPLE) || !broad->is_split ? HFX_BY_VERTEX : HFX_COVERED;
}

// The matrices of bones that move anything of the near clusters, at all rows; those of others stay as
// they are. `is_used` has room for all matrices of a row.
static void find_matrices(const hfx_broad *broad, const hfx_target *target, const hfx_posed *pose,
                          hfx_bones *bones, uint8_t *is_used) {
  const hfx_outline *outlines[2] = {broad->outline, pose->own};
  memset(is_used, 0, (size_t)bones->count);
  for (int k = 0; k < 2 && outlines[k]; k++)
    for (int64_t i = 0; i < broad->near_count; i++) {
      const int64_t *starts = outlines[k]->starts + broad->near[i];
      for (int64_t p = starts[0]; p < starts[1]; p++) is_used[bones->slots[outlines[k]->pair_bones[p]]] = 1;
    }
  for (int64_t n = 0; n < target->rows; n++)
    for (int64_t b = 0; b < bones->count; b++) {
      double *matrix = bones->matrices + 12 * (n * bones->count + b);
      if (!is_used[b]) continue;
      hfx_find_matrix(pose->posed + 12 * broad->row[n] * pose->bone_count, pose->bone_count, pose->bones[b],
                      target->body_to_shape + 16 * n, matrix);
      bones->stretches[n * bones->count + b] = hfx_stretch(matrix, 4);
    }
}

// Marks the near clusters, and rows, of the narrow phase.
static void find_needed(hfx_broad *broad, const hfx_target *target, const hfx_bones *bones,
                        const hfx_surface_places *surface, const hfx_groups *groups) {
  double steepest = hfx_steepest(target);
  int64_t rows = target->rows;
  for (int64_t k = 0; k < broad->near_count; k++) {
    int64_t c = broad->near[k];
    uint8_t *flags = broad->flags + c * rows;
    for (int64_t n = 0; n < rows; n++)
      if (flags[n] && is_simple(broad, target, bones, groups, steepest, c, n)) flags[n] |= SIMPLE;
  }
  for (int64_t n = 1; n < rows && isfinite(broad->edge_m); n++)
    if (broad->follows[n]) follow(broad, target, bones, surface, steepest, n);
  for (int64_t k = 0; k < broad->near_count; k++) {
    uint8_t *flags = broad->flags + broad->near[k] * rows;
    for (int64_t n = 0; n < rows; n++) {
      int is_before = n + 1 < rows && (flags[n + 1] & FOLLOWED);
      if (((flags[n] & TOUCHES) && broad->reported[n]) || (flags[n] & FOLLOWED) || is_before)
        flags[n] |= NEEDED;
    }
  }
}

// Lists the pairs of a cluster and a row of the narrow phase; see contacts.begin. `bones` are filled
// in as far as they matter; `groups` are known for clusters that are met where the volume falls off. `pairs`
// have room for all rows of the near clusters. Of the pairs' clusters, each once, ascending: all;
// those whose skin is covered or followed; those whose vertices suffice: `lists` has room for all near
// clusters thrice; `counts` are theirs, and the most steps of any pair.
HFX_EXPORT void hfx_reach(hfx_broad *broad, const hfx_target *target, const hfx_posed *pose,
                          hfx_bones *bones, uint8_t *is_used, const hfx_surface_places *surface,
                          const hfx_groups *groups, hfx_pairs *pairs, int64_t *lists,
                          int64_t *counts) {
  int64_t rows = target->rows, p = 0;
  for (int i = 0; i < 4; i++) counts[i] = 0;
  if (!surface) find_matrices(broad, target, pose, bones, is_used);
  find_needed(broad, target, bones, surface, groups);
  for (int64_t k = 0; k < broad->near_count; k++) {
    int64_t c = broad->near[k], is_in[3] = {0, 0, 0};
    for (int64_t n = 0; n < rows; n++) {
      uint8_t flag = broad->flags[c * rows + n];
      if (!(flag & NEEDED)) continue;
      uint8_t how = how_of(broad, target, flag);
      int is_followed = (flag & FOLLOWED) != 0;
      double angle = target->turns[n] + target->turns[rows + n];
      pairs->clusters[p] = c, pairs->rows[p] = n, pairs->how[p] = how;
      pairs->steps[p] = is_followed;
      if (is_followed && angle > 0.0)
        pairs->steps[p] = steps_for(angle, moved_m(broad, target, bones, n, surface, c), broad->edge_m);
      if (pairs->steps[p] > counts[3]) counts[3] = pairs->steps[p];
      is_in[0] = 1, is_in[1] |= is_followed || how == HFX_COVERED, is_in[2] |= how == HFX_BY_VERTEX;
      p++;
    }
    for (int i = 0; i < 3; i++)
      if (is_in[i]) lists[i * broad->near_count + counts[i]++] = c;
  }
  pairs->count = p;
}
