// SPDX-License-Identifier: GPL-3.0-or-later
// Where straight ways cross a mesh's surface: SurfaceTree of volume/mesh_crossing.py.

#include <math.h>

#include "mesh_tree.h"

// How far beyond a triangle's edge a crossing counts, as a share: no way slips between two.
static const double GRAZE = 1e-9;

// Whether a way may meet a box that is `slack` larger; `rate` is 1 over each coordinate of its step.
static int meets(const double *start, const double *rate, const double *box, double slack) {
  double enter = 0.0, leave = 1.0;
  for (int k = 0; k < 3; ++k) {
    const double one = (box[k] - slack - start[k]) * rate[k];
    const double other = (box[3 + k] + slack - start[k]) * rate[k];
    // A step of 0 gives infinities, alike outside and unlike within; what is not a number is a
    // point on a face, which is taken as within: the comparisons are so that it changes nothing.
    const double low = other < one ? other : one, high = one > other ? one : other;
    enter = low > enter ? low : enter;
    leave = high < leave ? high : leave;
  }
  return enter <= leave + GRAZE;
}

// Where a way meets the plane of a triangle; NaN where not within the triangle. Moeller and
// Trumbore, "Fast, minimum storage ray/triangle intersection", 1997.
static double hit(const double *start, const double *step, const double *corners) {
  double one[3], other[3], offset[3], across[3], turned[3];
  for (int k = 0; k < 3; ++k) {
    one[k] = corners[3 + k] - corners[k];
    other[k] = corners[6 + k] - corners[k];
    offset[k] = start[k] - corners[k];
  }
  cross(step, other, across);
  const double volume = dot(one, across);
  const double u = dot(offset, across) / volume;
  cross(offset, one, turned);
  const double v = dot(step, turned) / volume, at = dot(other, turned) / volume;
  const int within = u >= -GRAZE && v >= -GRAZE && u + v <= 1.0 + GRAZE;
  return within && at >= -GRAZE && at <= 1.0 + GRAZE ? at : NAN;
}

// boxes (2 size, 6), order (size), corners (triangles, 3, 3); starts, ends (3, count), about
// `middle` (3) in the tree; first, last (count): infinite where nothing is crossed.
HFX_EXPORT void hfx_mesh_crossings(const double *boxes, const int64_t *order, int64_t size,
                                   const double *corners, double slack, const double *middle,
                                   const double *starts, const double *ends, int64_t count,
                                   double *first, double *last) {
  for (int64_t n = 0; n < count; ++n) {
    double start[3], step[3], rate[3], soonest = INFINITY, latest = -INFINITY;
    int usable = 1;
    for (int k = 0; k < 3; ++k) {
      const double begin = starts[k * count + n], end = ends[k * count + n];
      usable &= isfinite(begin + end) != 0;
      start[k] = begin - middle[k];
      step[k] = end - begin;
      rate[k] = 1.0 / step[k];
    }
    if (usable && meets(start, rate, boxes + BOX, slack)) {
      int64_t waiting[DEEPEST];
      int left = 1;
      waiting[0] = 1;
      while (left) {
        const int64_t node = waiting[--left];
        if (node >= size) {
          const double at = hit(start, step, corners + 9 * order[node - size]);
          soonest = at < soonest ? at : soonest;
          latest = at > latest ? at : latest;
          continue;
        }
        for (int64_t half = 2 * node; half < 2 * node + 2; ++half)
          if (meets(start, rate, boxes + BOX * half, slack)) waiting[left++] = half;
      }
    }
    first[n] = soonest;
    last[n] = latest;
  }
}
