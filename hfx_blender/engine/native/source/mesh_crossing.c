// SPDX-License-Identifier: GPL-3.0-or-later
// Where straight ways cross a mesh's surface: SurfaceTree of volume/mesh_crossing.py.

#include <math.h>
#include <stddef.h>

#include "drift.h"
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

// A mesh's surface; see native/mesh_tree.py.
typedef struct {
  const double *boxes;    // (2 size, 6)
  const int64_t *order;   // (size,)
  int64_t size;
  const double *corners;  // (triangles, 3, 3)
  double slack;           // how much the boxes are too small
  const double *middle;   // (3,) what the tree is about, in the points' space
} hfx_surface;

// Widens `times`, from 0 to 1, by when a straight way, about the middle, crosses a surface. Without
// them it is only told whether the way comes within `reach` of the box of a triangle.
static int cross_surface(const hfx_surface *surface, const double *start, const double *end,
                         double reach, double times[2]) {
  double step[3], rate[3];
  const double slack = surface->slack + reach;
  for (int k = 0; k < 3; ++k) {
    step[k] = end[k] - start[k];
    rate[k] = 1.0 / step[k];
  }
  if (!meets(start, rate, surface->boxes + BOX, slack)) return 0;
  int64_t waiting[DEEPEST];
  int left = 1;
  waiting[0] = 1;
  while (left) {
    const int64_t node = waiting[--left];
    if (node >= surface->size) {
      if (!times) return 1;
      const double at = hit(start, step, surface->corners + 9 * surface->order[node - surface->size]);
      times[0] = at < times[0] ? at : times[0];
      times[1] = at > times[1] ? at : times[1];
      continue;
    }
    for (int64_t half = 2 * node; half < 2 * node + 2; ++half)
      if (meets(start, rate, surface->boxes + BOX * half, slack)) waiting[left++] = half;
  }
  return 0;
}

// Whether a way through places comes within `reach` of the box around all triangles.
static int is_near(const hfx_surface *surface, const double (*path)[3], int64_t steps, double reach) {
  const double slack = surface->slack + reach;
  for (int k = 0; k < 3; ++k) {
    double low = INFINITY, high = -INFINITY;
    for (int64_t s = 0; s <= steps; ++s) {
      low = lesser(path[s][k], low);
      high = greater(path[s][k], high);
    }
    if (!(low <= surface->boxes[BOX + 3 + k] + slack && high >= surface->boxes[BOX + k] - slack)) return 0;
  }
  return 1;
}

// Points' ways in intervals of several steps: before, after (3, count); intervals (count); see
// hfx_path for the others.
typedef struct {
  int64_t count, steps, all;
  const double *from_before, *from_after;
  const int64_t *interval;
  const double *before, *after;
} hfx_ways;

// The n-th of them, about the middle of a surface, (steps + 1, 3); whether all of it is finite.
static int way_of(const hfx_surface *surface, const hfx_ways *ways, int64_t n, double path[][3]) {
  double before[3], after[3], sum = 0.0;
  for (int k = 0; k < 3; ++k) {
    before[k] = ways->before[k * ways->count + n];
    after[k] = ways->after[k * ways->count + n];
  }
  hfx_path(ways->from_before, ways->from_after, ways->all, ways->interval[n], ways->steps, 0, ways->steps,
           before, after, path);
  for (int64_t s = 0; s <= ways->steps; ++s)
    for (int k = 0; k < 3; ++k) sum += path[s][k] -= surface->middle[k];
  return isfinite(sum) != 0;
}

// When they cross a surface, from 0 to 1 of each interval: first, last (count), infinite where nothing
// is crossed.
HFX_EXPORT void hfx_mesh_crossings(const hfx_surface *surface, const hfx_ways *ways, double *first,
                                   double *last) {
  double path[MOST_STEPS + 1][3];
  for (int64_t n = 0; n < ways->count; ++n) {
    first[n] = INFINITY;
    last[n] = -INFINITY;
    if (!way_of(surface, ways, n, path) || !is_near(surface, (const double(*)[3])path, ways->steps, 0.0))
      continue;
    for (int64_t s = 0; s < ways->steps; ++s) {
      double times[2] = {INFINITY, -INFINITY};
      cross_surface(surface, path[s], path[s + 1], 0.0, times);
      if (!(times[0] <= times[1])) continue;
      if (first[n] == INFINITY) first[n] = ((double)s + times[0]) / (double)ways->steps;
      last[n] = ((double)s + times[1]) / (double)ways->steps;
    }
  }
}

// Which may come within `reaches` (count) of the surface, or cross it.
HFX_EXPORT void hfx_mesh_nears(const hfx_surface *surface, const hfx_ways *ways, const double *reaches,
                               uint8_t *nears) {
  double path[MOST_STEPS + 1][3];
  for (int64_t n = 0; n < ways->count; ++n) {
    nears[n] = 0;
    if (!way_of(surface, ways, n, path) ||
        !is_near(surface, (const double(*)[3])path, ways->steps, reaches[n]))
      continue;
    for (int64_t s = 0; s < ways->steps && !nears[n]; ++s)
      nears[n] = (uint8_t)cross_surface(surface, path[s], path[s + 1], reaches[n], NULL);
  }
}
