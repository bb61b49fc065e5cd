// SPDX-License-Identifier: GPL-3.0-or-later
// Crossings of a mesh's surface by straight ways, and times inside.

#include <math.h>
#include <stddef.h>

#include "mesh.h"
#include "mesh_tree.h"

// Share of a triangle's edge beyond which a crossing counts, too: no way slips between two.
static const double GRAZE = 1e-9;

// True if a way may meet a box that is `slack` larger; `rate` is 1 over each coordinate of its step.
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

// Time at which a way meets the plane of a triangle; NaN where not within the triangle. Moeller and
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

// Widens `times`, from 0 to 1, by when a straight way between places crosses a surface. Without them it
// is only told whether the way comes within `reach` of the box of a triangle.
static int cross_surface(const hfx_mesh *mesh, const double *from, const double *to, double reach,
                         double times[2]) {
  const hfx_tree *tree = mesh->tree;
  double start[3], step[3], rate[3], sum = 0.0;
  const double slack = mesh->slack + reach;
  for (int k = 0; k < 3; ++k) {
    start[k] = from[k] - mesh->middle[k];
    step[k] = (to[k] - mesh->middle[k]) - start[k];
    rate[k] = 1.0 / step[k];
    sum += start[k] + step[k];
  }
  if (!isfinite(sum) || !meets(start, rate, tree->boxes + BOX, slack)) return 0;
  int64_t waiting[DEEPEST];
  int left = 1;
  waiting[0] = 1;
  while (left) {
    const int64_t node = waiting[--left];
    if (node >= tree->size) {
      if (!times) return 1;
      const double at = hit(start, step, tree->corners + 9 * tree->order[node - tree->size]);
      times[0] = at < times[0] ? at : times[0];
      times[1] = at > times[1] ? at : times[1];
      continue;
    }
    for (int64_t half = 2 * node; half < 2 * node + 2; ++half)
      if (meets(start, rate, tree->boxes + BOX * half, slack)) waiting[left++] = half;
  }
  return 0;
}

void hfx_mesh_passage(const hfx_mesh *mesh, const double (*path)[3], int64_t steps, uint64_t open,
                      double times[2]) {
  times[0] = INFINITY, times[1] = -INFINITY;
  for (int64_t s = 0; s < steps; ++s) {
    double crossed[2] = {INFINITY, -INFINITY};
    if (!(open >> s & 1)) continue;
    cross_surface(mesh, path[s], path[s + 1], 0.0, crossed);
    if (!(crossed[0] <= crossed[1])) continue;
    if (times[0] == INFINITY) times[0] = ((double)s + crossed[0]) / (double)steps;
    times[1] = ((double)s + crossed[1]) / (double)steps;
  }
  if (hfx_mesh_holds(mesh, path[0])) times[0] = 0.0;
  if (hfx_mesh_holds(mesh, path[steps])) times[1] = 1.0;
  if (!(times[0] <= times[1])) times[0] = INFINITY, times[1] = -INFINITY;
}

int hfx_mesh_nears(const hfx_mesh *mesh, const double (*path)[3], int64_t steps, double reach) {
  for (int64_t s = 0; s < steps; ++s)
    if (cross_surface(mesh, path[s], path[s + 1], reach, NULL)) return 1;
  return hfx_mesh_holds(mesh, path[0]);
}

// The same of straight ways from `starts` to `ends` (3, count): first, last (count).
HFX_EXPORT void hfx_mesh_passages(const hfx_mesh *mesh, const double *starts, const double *ends,
                                  int64_t count, double *first, double *last) {
  for (int64_t n = 0; n < count; ++n) {
    double path[2][3], times[2];
    for (int k = 0; k < 3; ++k) path[0][k] = starts[k * count + n], path[1][k] = ends[k * count + n];
    hfx_mesh_passage(mesh, (const double(*)[3])path, 1, 1, times);
    first[n] = times[0], last[n] = times[1];
  }
}
