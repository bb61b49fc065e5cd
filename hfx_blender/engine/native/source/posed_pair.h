// SPDX-License-Identifier: GPL-3.0-or-later
// Skin of a cluster at a row as it is looked at: posed where it is asked for, and where its samples
// are.

#ifndef HFX_POSED_PAIR_H
#define HFX_POSED_PAIR_H

#include <math.h>
#include <stddef.h>
#include <stdint.h>

#include "analytic.h"
#include "broad.h"
#include "skin.h"
#include "skin_posing.h"

#define SLACK (1.0 + 1e-9)
#define SPARE 1e-9
#define TOGETHER_AT_ONCE 64  // samples

static const double WHOLE = 1.0 - 1e-9;

// One pair as it is looked at. Places are posed when they are first asked for: most of a cluster
// stays so far from the volume that its motion since it was posed tells enough.
typedef struct {
  double *points;        // (places, 3)
  double *clear;         // (places,) of those that are posed, how far from the boundary
  double *exact;         // (places,) of those, distance to the farthest neighbour; below 0: not yet
  int64_t *posed;        // (places,) the number of the pair for which it was
  double *least;         // (units,) clearance is no less
  double *most;          // (units,) nor more, where the volume is as it was
  double *gaps;          // (units,) bounds of distances to the farthest neighbour, see find_gaps
  double floor, ceiling; // that of no unit is less, or more, than these
  double *weights;       // (cells,) before what passed
  hfx_two *matrices;     // see hfx_find_matrices
  hfx_spread spread;
  int64_t row, pair, has_matrices, has_gaps, has_metric;
  double metric[6];      // of shape space: what makes squared metres of ways, see find_metric
  double allowed;        // how far skin may be from its samples, metres
} side;

// Optional details of contacts, in shape space; see contact/contact_details.py. A contact is
// numbered by its row and column.
typedef struct {
  double *places;                 // (contacts, 3) of their vertices
  double *since;                  // (contacts,) when it began
  double *entries, *ways;         // (contacts, 3)
  double *samples;                // (room, 3) inside, of contacts whose vertex is outside
  int64_t *contacts;              // (room,) of samples
  int64_t count, room;            // how many there are, even where there is no room for all
} hfx_details;

typedef struct {
  const hfx_table *table;
  const hfx_target *target;
  const hfx_bones *bones;
  const hfx_cluster *cluster;  // NULL where places are given
  const hfx_surface_places *given;
  hfx_details *details;        // or NULL
  int64_t contact;             // that is looked at; below 0: its samples are not asked for
  double began, entry[3], way[3];  // how it was entered first
  hfx_search *search;          // of meshes; not in here, so that the rest stays in registers
  double moved;                // no place has moved farther since the pair before
  int is_same;                 // the volume has the shape that it had then
  hfx_shape shape;
  int64_t number, first;  // the cluster, its first place
  double stretch;         // of the row
  double turns[2][9];     // cross products to the world, and these back
  int has_turns;
  int64_t posed;          // places
  double limit;           // mean distance within which vertices tell enough
  double steepest;
  double on_the_way[MOST_STEPS + 1];  // see stretches_of
  int64_t on_the_way_of;              // which way; below 0: none
} look;

// Strength at a relative depth.
static inline double strength_of(const hfx_target *target, double rise) {
  if (!(rise > 0.0)) return 0.0;
  double t = (rise < target->share ? rise : target->share) / target->share;
  return target->is_smooth ? t * t * (3.0 - 2.0 * t) : t;
}

// The same of a place that is inside a mesh.
static double strength_in_mesh(const hfx_target *target, const hfx_mesh *mesh, const double p[3],
                               hfx_search *search) {
  if (target->is_flat) return 1.0;
  if (!(mesh->depth > 0.0)) return 0.0;
  return strength_of(target, hfx_smaller(hfx_mesh_distance(mesh, p, search) / mesh->depth, 1.0));
}

static inline double weight_of(look *at, const double p[3]) {
  const hfx_mesh *mesh = at->shape.mesh;
  if (mesh) return hfx_mesh_holds(mesh, p) ? strength_in_mesh(at->target, mesh, p, at->search) : 0.0;
  if (at->target->is_flat) return hfx_contains(at->shape, p) ? 1.0 : 0.0;
  return strength_of(at->target, 1.0 - hfx_share(at->shape, p));
}

// Weights of at most TOGETHER_AT_ONCE places.
static inline void weigh(look *at, const double (*points)[3], int64_t count, double *weights) {
  if (!at->shape.mesh) {
    for (int64_t k = 0; k < count; k++) weights[k] = weight_of(at, points[k]);
    return;
  }
  double planar[3 * TOGETHER_AT_ONCE];
  uint8_t inside[TOGETHER_AT_ONCE];
  for (int64_t k = 0; k < count; k++)
    for (int i = 0; i < 3; i++) planar[i * count + k] = points[k][i];
  hfx_mesh_inside(at->shape.mesh->grid, planar, count, inside);
  for (int64_t k = 0; k < count; k++)
    weights[k] =
        inside[k] ? strength_in_mesh(at->target, at->shape.mesh, points[k], at->search) : 0.0;
}

// Clearance of a place from a volume; see Shape.clearance.
static inline double clear_of(look *at, hfx_shape shape, const double p[3]) {
  if (!shape.mesh) return hfx_share(shape, p) - 1.0;
  double clear = hfx_mesh_clearance(shape.mesh, p, at->search);
  // The slope of the strength depends on the mesh: what is inside is sampled.
  return at->target->is_flat ? clear : hfx_larger(clear, 0.0);
}

// Tells of a place that is inside, where details ask for it.
static inline void tell_inside(look *at, const double p[3]) {
  hfx_details *details = at->details;
  if (!details || at->contact < 0) return;
  if (details->count < details->room) {
    for (int i = 0; i < 3; i++) details->samples[3 * details->count + i] = p[i];
    details->contacts[details->count] = at->contact;
  }
  details->count++;
}

// Poses a place; not inlined, so that place_of is.
static __attribute__((noinline)) void pose(look *at, side *pair, int64_t place) {
  double *point = pair->points + 3 * place;
  pair->posed[place] = pair->pair;
  at->posed++;
  if (at->cluster) {
    if (!pair->has_matrices) hfx_find_matrices(at->cluster, at->bones, pair->row, pair->matrices);
    pair->has_matrices = 1;
    hfx_pose(at->cluster, pair->matrices, place, point);
  } else {
    const hfx_surface_places *given = at->given;
    int64_t from = given->at[pair->row] * given->place_count + at->first + place;
    hfx_moved_by(at->target->body_to_shape + 16 * pair->row, given->places + 3 * from, point);
  }
  pair->clear[place] = clear_of(at, hfx_shape_at(at->target, pair->row), point);
  pair->exact[place] = -1.0;
  if (place < at->table->unit_counts[at->number])
    pair->least[place] = pair->most[place] = pair->clear[place];
}

// A place, posed.
static inline const double *place_of(look *at, side *pair, int64_t place) {
  if (pair->posed[place] != pair->pair) pose(at, pair, place);
  return pair->points + 3 * place;
}

// Bounds of the distance to the farthest neighbour of each unit.
static void find_gaps(const look *at, side *pair) {
  if (pair->has_gaps) return;
  pair->has_gaps = 1;
  int64_t units = at->table->unit_counts[at->number];
  double *restrict gaps = pair->gaps;
  if (!at->cluster) {
    for (int64_t u = 0; u < units; u++) gaps[u] = 1e300;  // nothing is known; times 0 it is 0
    return;
  }
  const double *restrict distances = at->cluster->distances;
  const double *differences = at->cluster->differences;
  double along = pair->spread.along * SLACK;
  for (int64_t u = 0; u < units; u++) gaps[u] = along * distances[u];
  for (int64_t b = 0; b < at->cluster->bone_count; b++, differences += units) {
    double apart = pair->spread.apart[b] * SLACK;
    for (int64_t u = 0; u < units && apart > 0.0; u++) gaps[u] += apart * differences[u];
  }
}

static inline double gap_of(look *at, side *pair, int64_t unit) {
  const double *own = place_of(at, pair, unit);
  if (!(pair->exact[unit] < 0.0)) return pair->exact[unit];
  int64_t first = at->first, place = first + unit;
  const int64_t *other = at->table->around + 2 * at->table->quad_starts[place];
  const int64_t *last = at->table->around + 2 * at->table->quad_starts[place + 1];
  const double x = own[0], y = own[1], z = own[2];
  double squared = 0.0, sum = 0.0;
  for (int step = at->table->is_ringed[place] ? 2 : 1; other < last; other += step) {
    const double *p = place_of(at, pair, *other - first);
    double way[3] = {p[0] - x, p[1] - y, p[2] - z};
    double each = hfx_dot(way, way);
    squared = each > squared ? each : squared;
    sum += each;  // is not a number where any of them is not
  }
  return pair->exact[unit] = sqrt(sum == sum ? squared : sum);
}

static inline double reach_of(look *at, side *pair, int64_t unit) {
  return gap_of(at, pair, unit) * at->table->reaches[at->first + unit];
}

// Tests strength at the vertex of a unit for being close enough: the mean over its skin differs by no
// more than the steepest change of strength times the mean distance from the vertex, wherever it is; that of a cell
// by the mean of its units. Rise changes by no more than the way in the space of a convex shape. `cell`
// is what is known of its cell: below 0 nothing yet, else whether that is told as a whole.
static inline int is_told(look *at, side *pair, int64_t unit, int64_t from, int64_t to, int *cell) {
  if (at->target->is_flat || at->shape.mesh || at->target->amplitude == 0.0) return 0;
  const hfx_table *table = at->table;
  double mean = table->means[at->first + unit];
  if (pair->gaps[unit] * mean <= at->limit || gap_of(at, pair, unit) * mean <= at->limit)
    return 1;
  if (table->is_simple) return 0;
  if (*cell < 0) {
    // Upper bounds first: distances have to be posed for.
    *cell = 0;
    for (int is_exact = 0; is_exact < 2 && !*cell; is_exact++) {
      double sum = 0.0;
      for (int64_t u = from; u < to; u++) {
        double gap = is_exact ? gap_of(at, pair, u) : pair->gaps[u];
        sum += gap * table->means[at->first + u] * table->unit_shares[at->first + u];
      }
      *cell = sum <= at->limit;
    }
  }
  return *cell;
}

// A matrix turns cross products by its determinant times its inverse transposed.
static inline void find_turns(look *at, int64_t row) {
  const double *a = at->target->to_shape + 16 * row, *b = at->target->to_world + 16 * row;
  double determinants[2];
  const double *matrices[2] = {a, b};
  for (int k = 0; k < 2; k++) {
    const double *m = matrices[k];
    determinants[k] = m[0] * (m[5] * m[10] - m[6] * m[9]) - m[1] * (m[4] * m[10] - m[6] * m[8]) +
                      m[2] * (m[4] * m[9] - m[5] * m[8]);
  }
  double hand = determinants[1] > 0.0 ? 1.0 : (determinants[1] < 0.0 ? -1.0 : 0.0);
  double sign = hand / determinants[0];
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < 3; j++) at->turns[0][3 * i + j] = a[4 * j + i] * sign;
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < 3; j++) {
      const double *m = a + 4 * i, *turn = at->turns[0] + j;
      at->turns[1][3 * i + j] = m[0] * turn[0] + m[1] * turn[3] + m[2] * turn[6];
    }
  at->has_turns = 1;
}

// The normal of a triangle with edges `a` and `b`, as long in the world as the square root of twice its
// area, all in shape space.
static inline void outwards(look *at, int64_t row, const double a[3], const double b[3], double out[3]) {
  if (!at->has_turns) find_turns(at, row);
  double cross[3] = {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
  double squared = 0.0;
  for (int i = 0; i < 3; i++) {
    double world = hfx_dot(at->turns[0] + 3 * i, cross);
    squared += world * world;
  }
  double size = sqrt(sqrt(squared));
  int usable = 1;
  for (int i = 0; i < 3; i++) {
    out[i] = hfx_dot(at->turns[1] + 3 * i, cross) / size;
    usable &= isfinite(out[i]) != 0;
  }
  if (!usable) out[0] = out[1] = out[2] = 0.0;
}

// A quad's triangle as it is posed: a corner, both edges from it, and outwards where it is curved.
typedef struct {
  double corners[3][3], edges[2][3], out[3];
} triangle;

// Corners of the triangle of a quad; all of them are posed.
static inline void corners_of(const look *at, const side *pair, int64_t unit, int64_t quad,
                              double corners[3][3]) {
  for (int k = 0; k < 3; k++) {
    int64_t place = k ? at->table->around[2 * quad + k - 1] - at->first : unit;
    for (int i = 0; i < 3; i++) corners[k][i] = pair->points[3 * place + i];
  }
}

static inline void find_edges(look *at, int64_t row, int64_t quad, triangle *t) {
  for (int k = 0; k < 2; k++)
    for (int i = 0; i < 3; i++) t->edges[k][i] = t->corners[1 + k][i] - t->corners[0][i];
  t->out[0] = t->out[1] = t->out[2] = 0.0;
  if (at->table->heights_m[quad]) outwards(at, row, t->edges[0], t->edges[1], t->out);
}

// Number `k` of a quad's samples, where it has `steps` both ways.
static inline hfx_sample sample_of(const hfx_table *table, int64_t quad, int64_t steps, int64_t k) {
  int64_t known = table->steps[quad];
  if (steps == known) {
    const double *s = table->samples + table->sample_starts[quad] + k;
    return (hfx_sample){s[0], s[table->room], s[2 * table->room], s[3 * table->room]};
  }
  double number = (double)steps, fewer = (double)known / number;
  hfx_sample at = hfx_sample_at(table->quads + quad, ((double)(k / steps) + 0.5) / number,
                                ((double)(k % steps) + 0.5) / number);
  at.share *= fewer * fewer;
  return at;
}

// Position of a sample of a triangle.
static inline void place_sample(const hfx_sample *s, const triangle *t, double p[3]) {
  for (int i = 0; i < 3; i++)
    p[i] = t->edges[0][i] * s->one + t->corners[0][i] + t->edges[1][i] * s->other + t->out[i] * s->height;
}

// A way's square, or the product of two, by the metric of a pair.
static inline double product_of(const double m[6], const double a[3], const double b[3]) {
  return a[0] * (m[0] * b[0] + m[1] * b[1] + m[2] * b[2]) +
         a[1] * (m[1] * b[0] + m[3] * b[1] + m[4] * b[2]) +
         a[2] * (m[2] * b[0] + m[4] * b[1] + m[5] * b[2]);
}

// The metric of a pair, and how far its skin may be from its samples; see
// hfx_table.
static inline void find_metric(const look *at, side *pair) {
  pair->has_metric = 1;
  const double *m = at->target->matrices + 16 * pair->row;
  for (int i = 0, n = 0; i < 3; i++)
    for (int j = i; j < 3; j++, n++)
      pair->metric[n] = m[i] * m[j] + m[4 + i] * m[4 + j] + m[8 + i] * m[8 + j];
  pair->allowed = at->table->distance_m;
  if (!isfinite(pair->allowed)) return;
  if (!at->cluster) {  // how its surface stretches is not known, only how the body does
    const double *m = at->target->to_world + 16 * pair->row;
    double most = 0.0;
    for (int j = 0; j < 3; j++)
      most = hfx_larger(most, m[j] * m[j] + m[4 + j] * m[4 + j] + m[8 + j] * m[8 + j]);
    pair->allowed *= sqrt(most);
    return;
  }
  if (!pair->has_matrices) hfx_find_matrices(at->cluster, at->bones, pair->row, pair->matrices);
  pair->has_matrices = 1;
  double least = INFINITY;
  const double *bone = (const double *)pair->matrices;
  for (int64_t b = 0; b < at->cluster->bone_count; b++, bone += 12) {
    double most = 0.0;
    for (int j = 0; j < 3; j++) {
      double axis[3] = {bone[j], bone[4 + j], bone[8 + j]};
      most = hfx_larger(most, product_of(pair->metric, axis, axis));
    }
    least = hfx_smaller(least, most);
  }
  pair->allowed *= sqrt(least);
}

// Samples of a quad both ways, as it is posed: as many as at rest, until a pose takes skin farther from its
// samples than is accepted; and no more than the finest.
static inline int64_t steps_of(const look *at, side *pair, int64_t quad, const triangle *t) {
  const hfx_table *table = at->table;
  int64_t steps = table->steps[quad], finest = table->finest[quad];
  if (steps >= finest) return steps;
  if (!pair->has_metric) find_metric(at, pair);
  double squares[3];
  for (int k = 0; k < 3; k++)
    squares[k] = product_of(pair->metric, t->edges[k == 2], t->edges[k > 0]);
  double allowed = pair->allowed * pair->allowed, number = (double)steps;
  if (isfinite(table->spacing_share)) {
    double spacing = table->spacing_share * table->spacing_share * hfx_larger(squares[0], squares[2]);
    allowed = hfx_smaller(allowed, spacing);
  }
  double most = 4.0 * number * number * allowed * (1.0 + 2.0 * ROUNDING);
  if (!(hfx_diagonal(table->quads + quad, squares, number) > most)) return steps;
  double wanted = hfx_steps_within(table->quads + quad, squares, sqrt(allowed));
  return wanted < (double)finest ? (int64_t)wanted : finest;
}

#endif
