// SPDX-License-Identifier: GPL-3.0-or-later
// Placement of volumes, boxes around them, and rotation angles between placements. See engine/volume/shape.py and
// engine/contact/broad_phase.py.

#include <float.h>
#include <math.h>
#include <string.h>

#include "analytic.h"
#include "broad.h"
#include "hfx_native.h"
#include "turning.h"

#define FLATTEST 1e-6

// The largest and the least stretch of a matrix.
static void stretches_of(const double m[9], double *largest, double *least) {
  double a[3][3];  // columns
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < 3; j++) a[j][i] = m[3 * i + j];
  hfx_square_up(a, 0);
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
  for (int i = 0; i < 3; i++) hfx_cross(b + 3 * ((i + 1) % 3), b + 3 * ((i + 2) % 3), crosses[i]);
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

static int is_near(const double matrix[16], double farthest) {
  for (int i = 0; i < 16; i++)
    if (!(fabs(matrix[i]) <= farthest)) return 0;
  return 1;
}

// Tests a placement (4, 4) for being that of the row before.
static int stays(const double *now) {
  int is_same = 1;
  for (int i = 0; i < 16; i++) is_same &= now[i] == now[i - 16];
  return is_same;
}

// Fills in a target at some rows of a block, `matrices` (block, 4, 4) place the volume in the world,
// `to_world` (block, 4, 4) the body, `shapes` (block,) say which of the shapes it has (NULL: the
// first), whose kinds, halves and `limits` (count, 2, 3) are known. How many rows can be used: where
// nothing is flattened, endless or not a number; of the others nothing else is told.
HFX_EXPORT int64_t hfx_place(hfx_target *target, const int64_t *row, const double *matrices,
                             const double *to_world, const int32_t *shapes, const int64_t *kinds,
                             const double *halves, const double *limits, int64_t count,
                             double farthest) {
  int64_t usable = 0;
  for (int64_t n = 0; n < target->rows; n++) {
    double *matrix = target->matrices + 16 * n, *world = target->to_world + 16 * n;
    double *inverse = target->to_shape + 16 * n, *shape = target->body_to_shape + 16 * n;
    int64_t which = shapes ? shapes[row[n]] : 0;
    target->meshes[n] = NULL, target->is_usable[n] = 0;
    if (which < 0 || which >= count) continue;
    target->kinds[n] = kinds[which], target->halves[n] = halves[which];
    memcpy(matrix, matrices + 16 * row[n], 16 * sizeof(*matrix));
    memcpy(world, to_world + 16 * row[n], 16 * sizeof(*world));
    target->turns[n] = n ? hfx_turned_by(matrix - 16, matrix) : 0.0;
    target->turns[target->rows + n] = n ? hfx_turned_by(world - 16, world) : 0.0;
    if (n && target->is_usable[n - 1] && stays(matrix))
      memcpy(inverse, inverse - 16, 16 * sizeof(*inverse));
    else if (!is_near(matrix, farthest) || !invert(matrix, inverse))
      continue;
    target->is_usable[n] = 1, usable++;
    for (int i = 0; i < 4; i++)
      for (int j = 0; j < 4; j++) {
        const double *one = inverse + 4 * i, *other = world + j;
        shape[4 * i + j] = one[0] * other[0] + one[1] * other[4] + one[2] * other[8] + one[3] * other[12];
      }
    box_of(limits + 6 * which, matrix, target->boxes + 6 * n);
  }
  return usable;
}

// Flatter than this, a volume's box is not sure: determinant over the product of columns' lengths,
// far above what counts as flattened. Lengths far from overflow.
#define UPRIGHT 0.05
#define SHORTEST 1e-90
#define LONGEST 1e90
#define ROUNDING 1e-12

// Constants of a volume's box while its axes stay.
typedef struct {
  double shift[3], reach[3], arm[3];  // of the box's centre from the origin; half edges
  double longest;                     // squared, of a corner from the origin
  int is_sure;
} hfx_axes;

static hfx_axes axes_of(const double *matrix, const double bounds[6]) {
  hfx_axes axes = {.longest = 0.0, .is_sure = 1};
  double volume = 1.0;
  for (int j = 0; j < 3; j++) {
    const double *m = matrix + j;
    double length = sqrt(m[0] * m[0] + m[4] * m[4] + m[8] * m[8]);
    axes.is_sure &= length > SHORTEST && length < LONGEST;
    volume *= length;
  }
  const double *a = matrix, *b = matrix + 4, *c = matrix + 8;
  double determinant = a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0]) +
                       a[2] * (b[0] * c[1] - b[1] * c[0]);
  axes.is_sure &= fabs(determinant) >= UPRIGHT * volume;
  for (int i = 0; i < 3; i++) {
    const double *m = matrix + 4 * i;
    axes.shift[i] = axes.reach[i] = axes.arm[i] = 0.0;
    for (int j = 0; j < 3; j++) {
      double middle = 0.5 * (bounds[j] + bounds[3 + j]), half = 0.5 * (bounds[3 + j] - bounds[j]);
      axes.shift[i] += m[j] * middle;
      axes.reach[i] += fabs(m[j]) * half;
      axes.arm[i] += fabs(m[j]) * (fabs(middle) + half);
    }
    axes.longest += axes.arm[i] * axes.arm[i];
  }
  return axes;
}

// See reach._VolumeBoxes: around all that volumes are and move through at some rows, (2, 3) each;
// whether that is sure. `bounds` (2, 3) of each are in shape space. Rows where a volume is off, whose
// `levels` (count, rows) are not above 0, count only as to whether it turns.
HFX_EXPORT void hfx_volume_boxes(int64_t count, int64_t rows, const double *matrices,
                                 const double *levels, const double *bounds, double *boxes,
                                 uint8_t *is_sure) {
  for (int64_t e = 0; e < count; e++, boxes += 6, bounds += 6, levels += rows) {
    hfx_axes axes = {.is_sure = 0};
    double longest = 0.0;
    int turns = 0, is_known = 0;
    is_sure[e] = 1;
    for (int i = 0; i < 3; i++) boxes[i] = INFINITY, boxes[3 + i] = -INFINITY;
    for (int64_t n = 0; n < rows; n++) {
      const double *matrix = matrices + 16 * (e * rows + n);
      int is_same = n > 0;
      for (int i = 0; i < 3 && is_same; i++)
        for (int j = 0; j < 3; j++) is_same &= matrix[4 * i + j] == matrix[4 * i + j - 16];
      turns |= n > 0 && !is_same;
      is_known &= is_same;
      if (!(levels[n] > 0.0)) continue;
      if (!is_known) axes = axes_of(matrix, bounds), is_known = 1;
      is_sure[e] &= axes.is_sure;
      longest = fmax(longest, axes.longest);
      for (int i = 0; i < 3; i++) {
        double origin = matrix[4 * i + 3], centre = axes.shift[i] + origin;
        double reach = axes.reach[i] + ROUNDING * (axes.arm[i] + fabs(origin));
        is_sure[e] &= isfinite(origin) != 0;
        boxes[i] = hfx_smaller(boxes[i], centre - reach);
        boxes[3 + i] = hfx_larger(boxes[3 + i], centre + reach);
      }
    }
    // Between two rows a turning volume stays within its longest arm of both boxes.
    double swing = turns ? sqrt(longest) : 0.0;
    for (int i = 0; i < 3; i++) boxes[i] -= swing, boxes[3 + i] += swing;
  }
}

// By how much each of some placements (count, 4, 4) turns to become another, (count,).
HFX_EXPORT void hfx_turns(int64_t count, const double *before, const double *after, double *angles) {
  for (int64_t n = 0; n < count; n++) angles[n] = hfx_turned_by(before + 16 * n, after + 16 * n);
}
