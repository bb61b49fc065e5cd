// SPDX-License-Identifier: GPL-3.0-or-later
// Distances of points to a mesh's triangles: TriangleTree of volume/mesh_distance.py.

#include <float.h>
#include <math.h>

#include "mesh.h"
#include "mesh_tree.h"
#include "numbers.h"

// Rounding of a box's distance against that of its triangles: nothing is left out for it.
static const double WIDER = 1.0 + 1e-12;

// A bound of a distance is found ten times faster than it, and is nearly as useful: half of what it may
// lack is lost in a search, the rest on the way from it.
static const double SURE = 0.4, LOOKED = 0.7;

// Shares of the extent: beyond the first one the distance to the box is enough; nearer to the boundary
// than the second one a point may count for either side.
static const double AROUND = 1.0 / 16.0, UNSURE = 1e-9;

typedef struct {
  const double *boxes;  // (2 size, 6)
  int64_t size;
  const double *frames;  // (size, 16)
  int64_t together;      // leaves
} Tree;

// Squared distance in the plane to a segment from the origin; whether left of it.
static double to_side(double x, double y, double end_x, double end_y, int *left_of) {
  const double square = end_x * end_x + end_y * end_y;
  double share = (x * end_x + y * end_y) / (square > 0.0 ? square : 1.0);
  share = share < 0.0 ? 0.0 : share > 1.0 ? 1.0 : share;
  *left_of |= x * end_y < y * end_x;
  const double away_x = x - share * end_x, away_y = y - share * end_y;
  return away_x * away_x + away_y * away_y;
}

// Squared distance to a triangle; where that is more than `best` it may be less, but also more
// than `best`.
static inline double to_triangle(const double *point, const double *frame, double best) {
  double offset[3];
  for (int k = 0; k < 3; ++k) offset[k] = point[k] - frame[ORIGIN + k];
  const double z = dot(offset, frame + AXIS_Z);
  if (z * z > best) return z * z;
  const double x = dot(offset, frame + AXIS_X), y = dot(offset, frame + AXIS_Y);
  const double length = frame[LENGTH], apex_x = frame[APEX_X], apex_y = frame[APEX_Y];
  // The angles at both ends of the longest edge are acute: below it, it is the nearest.
  if (!(y > 0.0)) {
    const double beside = x - (x < 0.0 ? 0.0 : x > length ? length : x);
    return beside * beside + y * y + z * z;
  }
  int beyond = 0;
  const double left = to_side(x, y, apex_x, apex_y, &beyond);
  const double right = to_side(length - x, y, length - apex_x, apex_y, &beyond);
  return (beyond ? lesser(left, right) : 0.0) + z * z;
}

static double to_box(const double *point, const double *box) {
  double gaps[3];
  for (int k = 0; k < 3; ++k) {
    const double below = box[k] - point[k], above = point[k] - box[3 + k];
    const double gap = below > above ? below : above;
    gaps[k] = gap > 0.0 ? gap : 0.0;
  }
  return gaps[0] * gaps[0] + gaps[1] * gaps[1] + gaps[2] * gaps[2];
}

// The least of `best` and of the squared distances to triangles in boxes no farther than `limit`
// and than `share` of the least so far; `at` becomes the leaf, if any is nearer.
static double least(const Tree *tree, const double *point, double best, double limit, double share,
                    int64_t *at) {
  const int64_t last = tree->size / tree->together;
  int64_t waiting[DEEPEST], node = 1;
  double gaps[DEEPEST], bound = lesser(limit, share * best);
  int count = 0;
  for (;;) {
    while (node < last) {
      const double *box = tree->boxes + BOX * 2 * node;
      const double left = to_box(point, box), right = to_box(point, box + BOX);
      const int is_right = right < left;
      const double nearer = is_right ? right : left, farther = is_right ? left : right;
      if (farther <= bound) {
        waiting[count] = 2 * node + !is_right;
        gaps[count++] = farther;
      }
      if (!(nearer <= bound)) break;
      node = 2 * node + is_right;
    }
    for (int64_t k = 0; node >= last && k < tree->together; ++k) {
      const int64_t leaf = (node - last) * tree->together + k;
      const double squared = to_triangle(point, tree->frames + FRAME * leaf, best);
      if (squared < best) {
        best = squared;
        *at = leaf;
        bound = lesser(limit, share * best);
      }
    }
    do {
      if (!count) return best;
      --count;
    } while (!(gaps[count] <= bound));
    node = waiting[count];
  }
}

static int is_finite(const double *point) {
  return isfinite(point[0]) && isfinite(point[1]) && isfinite(point[2]);
}

static Tree all_of(const hfx_tree *tree) {
  return (Tree){tree->boxes, tree->size, tree->frames, tree->size < TOGETHER ? tree->size : TOGETHER};
}

// Leaves of the nearest triangles of points (3, count) within the distances given, and the distances:
// -1 and infinity without one, NaN for what is not finite.
HFX_EXPORT void hfx_mesh_nearest(const hfx_tree *known, const double *points, int64_t count,
                                 int64_t *leaves, double *distances) {
  const Tree tree = all_of(known);
  int64_t last = 0;
  for (int64_t n = 0; n < count; ++n) {
    const double point[3] = {points[n], points[count + n], points[2 * count + n]};
    const double farthest = distances[n] * distances[n] * WIDER;
    leaves[n] = -1;
    if (!is_finite(point)) {
      distances[n] = NAN;
      continue;
    }
    // Points that follow each other are often neighbours: the last one's triangle is a bound.
    const double guess = to_triangle(point, tree.frames + FRAME * last, INFINITY);
    int64_t at = guess <= farthest ? last : -1;
    const double best = least(&tree, point, lesser(guess, farthest), INFINITY, WIDER, &at);
    distances[n] = at < 0 ? INFINITY : sqrt(best);
    leaves[n] = at;
    if (at >= 0) last = at;
  }
}

// A mesh that deforms is another one at each row: nothing that was found of the one before holds.
static void begin_search(const hfx_mesh *mesh, hfx_search *search) {
  if (search->mesh != mesh) *search = (hfx_search){.mesh = mesh};
}

double hfx_mesh_distance(const hfx_mesh *mesh, const double p[3], hfx_search *search) {
  begin_search(mesh, search);
  const Tree tree = all_of(mesh->tree);
  double point[3];
  for (int k = 0; k < 3; ++k) point[k] = p[k] - mesh->middle[k];
  if (!is_finite(point)) return NAN;
  const double guess = to_triangle(point, tree.frames + FRAME * search->at, INFINITY);
  return sqrt(least(&tree, point, guess, INFINITY, WIDER, &search->at));
}

// No more than the distance of a point about the middle and no less than the share SURE of it, in far
// less time: boxes beyond the share LOOKED of what was found are left out, and where a place has moved
// by so little that the last search tells enough, there is none.
static double distance_at_least(const hfx_tree *known, const double *point, hfx_search *search) {
  const Tree tree = all_of(known);
  if (!is_finite(point)) return NAN;
  double way = 0.0;
  for (int k = 0; k < 3; ++k) way += (point[k] - search->known[k]) * (point[k] - search->known[k]);
  way = sqrt(way);
  if (search->is_known && search->least - way >= SURE * (search->most + way)) return search->least - way;
  const double guess = to_triangle(point, tree.frames + FRAME * search->at, INFINITY);
  search->most = sqrt(least(&tree, point, guess, INFINITY, LOOKED * LOOKED, &search->at));
  search->least = LOOKED * search->most;
  search->is_known = 1;
  for (int k = 0; k < 3; ++k) search->known[k] = point[k];
  return search->least;
}

double hfx_mesh_clearance(const hfx_mesh *mesh, const double p[3], hfx_search *search) {
  begin_search(mesh, search);
  const double *low = mesh->grid->box, *high = low + 3;
  double to_box = -INFINITY, extent = 0.0, far = 0.0, about[3];
  for (int k = 0; k < 3; ++k) {
    to_box = hfx_larger(to_box, hfx_larger(low[k] - p[k], p[k] - high[k]));
    extent = hfx_larger(extent, high[k] - low[k]), far = hfx_larger(far, fabs(low[k] + high[k]));
    about[k] = p[k] - mesh->middle[k];
  }
  if (!(to_box < AROUND * extent)) return hfx_larger(to_box, 0.0);
  const double unsure = UNSURE * extent + 8.0 * DBL_EPSILON * far;
  const double away = hfx_larger(distance_at_least(mesh->tree, about, search) - unsure, 0.0);
  return hfx_mesh_holds(mesh, p) ? -away : away;
}

// The same of points (3, count).
HFX_EXPORT void hfx_mesh_clearances(const hfx_mesh *mesh, const double *points, int64_t count,
                                    double *clear) {
  hfx_search search = {.at = 0};
  for (int64_t n = 0; n < count; ++n) {
    const double point[3] = {points[n], points[count + n], points[2 * count + n]};
    clear[n] = hfx_mesh_clearance(mesh, point, &search);
  }
}

// Squared distance to a triangle that is near: the `width` boxes with the nearest middles go on
// down, those that are as near in the order they had. nodes, away (2 width): scratch.
static double first_guess(const Tree *tree, const double *point, int64_t width, int64_t *nodes,
                          double *away) {
  int64_t count = 1;
  nodes[0] = 1;
  for (int64_t level = 1; level < tree->size; level *= 2) {
    for (int64_t n = 0; n < count; ++n) {
      nodes[count + n] = 2 * nodes[n] + 1;
      nodes[n] = 2 * nodes[n];
    }
    count *= 2;
    for (int64_t n = 0; n < count; ++n) {
      const double *box = tree->boxes + BOX * nodes[n];
      double squared = 0.0;
      for (int k = 0; k < 3; ++k) {
        const double gap = point[k] - 0.5 * (box[k] + box[3 + k]);
        squared += gap * gap;
      }
      away[n] = squared;
    }
    if (count <= width) continue;
    for (int64_t n = 1; n < count; ++n) {
      const double key = away[n];
      const int64_t node = nodes[n];
      int64_t at = n;
      for (; at > 0 && away[at - 1] > key; --at) {
        away[at] = away[at - 1];
        nodes[at] = nodes[at - 1];
      }
      away[at] = key;
      nodes[at] = node;
    }
    count = width;
  }
  double best = INFINITY;
  for (int64_t n = 0; n < count; ++n) {
    const double *frame = tree->frames + FRAME * (nodes[n] - tree->size);
    best = lesser(to_triangle(point, frame, best), best);
  }
  return best;
}

// Distances of TriangleTree.distances_beyond, of the very same triangles: what is found is too large by as
// much. points (3, count), distances (count); nodes, away (2 width): scratch.
HFX_EXPORT void hfx_mesh_distances_beyond(const hfx_tree *known, const double *points, int64_t count,
                                          double limit, double slack, int64_t width, int64_t *nodes,
                                          double *away, double *distances) {
  const Tree tree = {known->boxes, known->size, known->frames, 1};
  const double share = 1.0 / ((1.0 + slack) * (1.0 + slack));
  for (int64_t n = 0; n < count; ++n) {
    const double point[3] = {points[n], points[count + n], points[2 * count + n]};
    double best = first_guess(&tree, point, width, nodes, away);
    int64_t at = 0;
    if (best > limit * limit) best = least(&tree, point, best, share * best, WIDER, &at);
    distances[n] = sqrt(best);
  }
}
