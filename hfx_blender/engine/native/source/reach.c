// SPDX-License-Identifier: GPL-3.0-or-later
// Broad phase: which clusters a volume can reach, at which rows, and between. See
// engine/{placed,swept}.py and engine/volume/placement.py, whose terms these are.

#include <float.h>
#include <math.h>

#include "analytic.h"
#include "broad.h"
#include "hfx_native.h"
#include "skin.h"
#include "skin_posing.h"

#define FLATTEST 1e-6
#define LEAST_EDGE 1e-4
#define TURNS 30  // of Jacobi's method: it arrives after five or so

// The largest and the least stretch of a matrix, by Jacobi's one-sided method.
static void stretches_of(const double m[9], double *largest, double *least) {
  double a[3][3];  // columns
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < 3; j++) a[j][i] = m[3 * i + j];
  for (int turn = 0; turn < TURNS; turn++) {
    int is_done = 1;
    for (int p = 0; p < 2; p++)
      for (int q = p + 1; q < 3; q++) {
        double pp = hfx_dot(a[p], a[p]), qq = hfx_dot(a[q], a[q]), pq = hfx_dot(a[p], a[q]);
        if (!(fabs(pq) > 1e-15 * sqrt(pp * qq))) continue;
        is_done = 0;
        double ratio = (qq - pp) / (2.0 * pq);
        double t = (ratio >= 0.0 ? 1.0 : -1.0) / (fabs(ratio) + sqrt(1.0 + ratio * ratio));
        double c = 1.0 / sqrt(1.0 + t * t), s = c * t;
        for (int i = 0; i < 3; i++) {
          double one = a[p][i], other = a[q][i];
          a[p][i] = c * one - s * other, a[q][i] = s * one + c * other;
        }
      }
    if (is_done) break;
  }
  *largest = 0.0, *least = INFINITY;
  for (int k = 0; k < 3; k++) {
    double size = sqrt(hfx_dot(a[k], a[k]));
    if (size > *largest) *largest = size;
    if (size < *least) *least = size;
  }
}

static int exponent_of(double a, double b, double c) {
  int exponent;
  frexp(fmax(fmax(fabs(a), fabs(b)), fabs(c)), &exponent);
  return exponent;
}

// See inverse_placement. Whether the inverse can be used.
static int invert(const double matrix[16], double inverse[16]) {
  double balanced[9], back[9], offset[3];
  int columns[3], rows[3];
  for (int i = 0; i < 12; i++)
    if (!isfinite(matrix[i])) return 0;
  for (int j = 0; j < 3; j++) columns[j] = exponent_of(matrix[j], matrix[4 + j], matrix[8 + j]);
  for (int i = 0; i < 3; i++) {
    for (int j = 0; j < 3; j++) balanced[3 * i + j] = ldexp(matrix[4 * i + j], -columns[j]);
    rows[i] = exponent_of(balanced[3 * i], balanced[3 * i + 1], balanced[3 * i + 2]);
    for (int j = 0; j < 3; j++) balanced[3 * i + j] = ldexp(balanced[3 * i + j], -rows[i]);
  }
  double largest, least;
  stretches_of(balanced, &largest, &least);
  if (!(least > FLATTEST * largest)) return 0;
  const double *b = balanced;
  double crosses[3][3], found[9];
  for (int i = 0; i < 3; i++) {
    const double *next = b + 3 * ((i + 1) % 3), *last = b + 3 * ((i + 2) % 3);
    for (int j = 0; j < 3; j++)
      crosses[i][j] = next[(j + 1) % 3] * last[(j + 2) % 3] - next[(j + 2) % 3] * last[(j + 1) % 3];
  }
  double determinant = hfx_dot(b, crosses[0]);
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < 3; j++) found[3 * i + j] = crosses[j][i] / determinant;
  // One step of Newton's iteration takes away what cancellation left.
  double left[9];
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < 3; j++)
      left[3 * i + j] = (i == j ? 2.0 : 0.0) - (b[3 * i] * found[j] + b[3 * i + 1] * found[3 + j] +
                                                b[3 * i + 2] * found[6 + j]);
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < 3; j++) {
      double each = found[3 * i] * left[j] + found[3 * i + 1] * left[3 + j] + found[3 * i + 2] * left[6 + j];
      back[3 * i + j] = ldexp(each, -columns[i] - rows[j]);
      if (!isfinite(back[3 * i + j])) return 0;
    }
  for (int i = 0; i < 3; i++) {
    offset[i] = -(back[3 * i] * matrix[3] + back[3 * i + 1] * matrix[7] + back[3 * i + 2] * matrix[11]);
    if (!isfinite(offset[i])) return 0;
    for (int j = 0; j < 3; j++) inverse[4 * i + j] = back[3 * i + j];
    inverse[4 * i + 3] = offset[i];
  }
  inverse[12] = inverse[13] = inverse[14] = 0.0, inverse[15] = 1.0;
  return 1;
}

// See world_bounds: a box around a volume, (2, 3).
static void box_of(const double bounds[6], const double matrix[16], double box[6]) {
  for (int i = 0; i < 3; i++) {
    const double *m = matrix + 4 * i;
    double centre = m[3], reach = 0.0, largest = fabs(m[3]);
    for (int j = 0; j < 3; j++) {
      double middle = 0.5 * (bounds[j] + bounds[3 + j]), half = 0.5 * (bounds[3 + j] - bounds[j]);
      centre += m[j] * middle;
      reach += fabs(m[j]) * half;
      largest += fabs(m[j]) * (fabs(middle) + half);
    }
    reach += 8.0 * DBL_EPSILON * largest;
    box[i] = centre - reach, box[3 + i] = centre + reach;
  }
}

// Where a volume is at some rows: its inverses, how it sees the body, its world boxes (rows, 2, 3).
// Whether all of it can be used: nothing is flattened, endless or not a number.
HFX_EXPORT int64_t hfx_place(int64_t rows, const double *matrices, const double *to_world,
                             const double *bounds, double farthest, double *inverses,
                             double *to_shape, double *boxes) {
  for (int64_t n = 0; n < rows; n++) {
    const double *matrix = matrices + 16 * n, *world = to_world + 16 * n;
    double *inverse = inverses + 16 * n, *shape = to_shape + 16 * n;
    for (int i = 0; i < 16; i++)
      if (!(fabs(matrix[i]) <= farthest)) return 0;
    if (!invert(matrix, inverse)) return 0;
    for (int i = 0; i < 4; i++)
      for (int j = 0; j < 4; j++) {
        const double *one = inverse + 4 * i, *other = world + j;
        shape[4 * i + j] = one[0] * other[0] + one[1] * other[4] + one[2] * other[8] + one[3] * other[12];
      }
    box_of(bounds + 6 * n, matrix, boxes + 6 * n);
  }
  return 1;
}

// A body's clusters and a volume at some rows.
typedef struct {
  int64_t rows, clusters;
  const double *matrices;      // (rows, 4, 4) shape space to world
  const double *boxes;         // (rows, 2, 3) world, of the volume
  const double *low, *high;    // (all rows, clusters, 3) world, of the clusters
  const int64_t *at;           // (rows,) which of all rows
  const uint8_t *follows;      // (rows,) whether the row before is the sample before
  const uint8_t *heard;        // (rows,) whether it is reported
  const double *turns;         // (2, rows) of volume and body since the row before; NULL: none
  const int64_t *pair_starts;  // (clusters + 1,) bones of clusters, with boxes of what they move
  const int64_t *pair_bones;
  const double *centres, *halves;
  double edge_m;
  int64_t is_split;
} hfx_broad;

enum { TOUCHES = 1, SIMPLE = 2, FOLLOWED = 4 };

static inline int overlap(const double *low, const double *high, const double *box) {
  return low[0] <= box[3] && low[1] <= box[4] && low[2] <= box[5] &&  //
         high[0] >= box[0] && high[1] >= box[1] && high[2] >= box[2];
}

// Which clusters' boxes meet the volume's, (rows, clusters); how often that is the case.
HFX_EXPORT int64_t hfx_overlaps(const hfx_broad *broad, uint8_t *flags, uint8_t *is_met) {
  int64_t count = 0;
  for (int64_t c = 0; c < broad->clusters; c++) is_met[c] = 0;
  for (int64_t n = 0; n < broad->rows; n++)
    for (int64_t c = 0; c < broad->clusters; c++, flags++) {
      int64_t at = 3 * (broad->at[n] * broad->clusters + c);
      *flags = overlap(broad->low + at, broad->high + at, broad->boxes + 6 * n) ? TOUCHES : 0;
      is_met[c] |= *flags;
      count += *flags;
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

// See Placed._swings: how far turning may take anything out of both ends' boxes, metres.
static double swing_of(const hfx_broad *broad, const hfx_target *target, int64_t n) {
  double swing = 0.0;
  for (int k = 0; k < 2; k++) {
    double angle = broad->turns ? broad->turns[k * broad->rows + n] : 0.0, arm = 0.0;
    if (angle == 0.0) continue;
    for (int64_t row = n - 1; row <= n; row++) {
      const double *origin = (k ? target->to_world : broad->matrices) + 16 * row;
      for (int64_t c = 0; c < (k ? broad->clusters : 1); c++) {
        int64_t at = 3 * (broad->at[row] * broad->clusters + c);
        const double *low = k ? broad->low + at : broad->boxes + 6 * row;
        const double *high = k ? broad->high + at : broad->boxes + 6 * row + 3;
        double squared = 0.0;
        for (int i = 0; i < 3; i++) {
          double o = origin[4 * i + 3], each = hfx_larger(fabs(low[i] - o), fabs(high[i] - o));
          squared += each * each;
        }
        arm = hfx_larger(arm, squared);
      }
    }
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
  return hfx_box_moves(bones, n - 1, n, broad->matrices + 16 * n, 4, broad->pair_starts[c],
                       broad->pair_starts[c + 1], broad->pair_bones, broad->centres, broad->halves);
}

// See swept.steps_for.
static int64_t steps_for(double angle, double moved, double edge) {
  double wanted = sqrt(0.5 * 3.14159265358979323846 * moved * angle / 8.0 / fmax(edge, LEAST_EDGE));
  if (!isfinite(wanted)) return MOST_STEPS;
  int64_t steps = 1;
  while ((double)steps < wanted && steps < MOST_STEPS) steps *= 2;
  return steps;
}

// Which clusters are looked at, at which rows, and how; see contact.find. Of `flags` those of
// hfx_overlaps are there; `groups` are known for clusters that are met where the volume falls off.
HFX_EXPORT void hfx_reach(const hfx_broad *broad, const hfx_target *target, const hfx_bones *bones,
                          const hfx_groups *groups, uint8_t *flags, hfx_pairs *pairs) {
  double steepest = hfx_steepest(target);
  int64_t rows = broad->rows, clusters = broad->clusters;
  for (int64_t n = 0; n < rows; n++)
    for (int64_t c = 0; c < clusters; c++) {
      uint8_t *flag = flags + n * clusters + c;
      int64_t at = 3 * (broad->at[n] * clusters + c);
      int is_simple = 1;
      if (target->is_flat)
        is_simple = *flag && encloses(broad, target, n, broad->low + at, broad->high + at);
      else if (*flag && broad->is_split)
        is_simple = target->amplitude > 0.0 &&
                    steepest * hfx_cell_mean(bones, groups + c, n) <= target->amplitude;
      if (is_simple) *flag |= SIMPLE;
    }
  for (int64_t n = 1; n < rows && isfinite(broad->edge_m); n++) {
    if (!broad->follows[n]) continue;
    double swing = swing_of(broad, target, n), limit = unseen(target, n, broad->edge_m, steepest);
    double box[6];
    for (int i = 0; i < 3; i++) {
      box[i] = hfx_smaller(broad->boxes[6 * n + i], broad->boxes[6 * (n - 1) + i]) - swing;
      box[3 + i] = hfx_larger(broad->boxes[6 * n + 3 + i], broad->boxes[6 * (n - 1) + 3 + i]) + swing;
    }
    for (int64_t c = 0; c < clusters; c++) {
      uint8_t *flag = flags + n * clusters + c;
      int64_t at = 3 * (broad->at[n] * clusters + c), before = 3 * (broad->at[n - 1] * clusters + c);
      double low[3], high[3];
      for (int i = 0; i < 3; i++) {
        low[i] = hfx_smaller(broad->low[at + i], broad->low[before + i]);
        high[i] = hfx_larger(broad->high[at + i], broad->high[before + i]);
      }
      if (!overlap(low, high, box)) continue;
      // From wholly inside nothing enters; to there it is felt anyway.
      if (target->is_flat && ((*flag | flag[-clusters]) & SIMPLE)) continue;
      if (!(moved_m(broad, bones, n, c) <= limit)) *flag |= FOLLOWED;
    }
  }
  pairs->count = 0;
  for (int64_t c = 0; c < clusters; c++)
    for (int64_t n = 0; n < rows; n++) {
      uint8_t flag = flags[n * clusters + c];
      int is_before = n + 1 < rows && (flags[(n + 1) * clusters + c] & FOLLOWED);
      if (!(((flag & TOUCHES) && broad->heard[n]) || (flag & FOLLOWED) || is_before)) continue;
      int64_t p = pairs->count++;
      pairs->clusters[p] = c, pairs->rows[p] = n;
      pairs->how[p] = HFX_NOT;
      if (flag & TOUCHES) {
        int is_simple = (flag & SIMPLE) != 0;
        if (target->is_flat && is_simple)
          pairs->how[p] = HFX_WHOLE;
        else
          pairs->how[p] = is_simple || !broad->is_split ? HFX_BY_VERTEX : HFX_COVERED;
      }
      pairs->steps[p] = (flag & FOLLOWED) != 0;
      double angle = !broad->turns ? 0.0 : broad->turns[n] + broad->turns[rows + n];
      if (pairs->steps[p] && angle > 0.0)
        pairs->steps[p] = steps_for(angle, moved_m(broad, bones, n, c), broad->edge_m);
    }
}
