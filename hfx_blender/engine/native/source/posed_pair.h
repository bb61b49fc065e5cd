// SPDX-License-Identifier: GPL-3.0-or-later
// Skin of a cluster at a row: posed where its places are needed, and where its samples are.

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

// Pair of a cluster and a row. Places are posed when they are first needed: most of a cluster stays
// so far from the volume that bounds of its motion since it was posed suffice.
typedef struct {
  double *points;        // (places, 3)
  double *clearance;         // (places,) of those that are posed, how far from the boundary
  double *exact_gaps;         // (places,) of those, distance to the farthest neighbour; below 0: not yet
  int64_t *posed;        // (places,) the number of the pair for which it was
  double *least;         // (units,) clearance is no less
  double *most;          // (units,) nor more, where the volume is as it was
  double *gaps;          // (units,) times the reach: bounds of the farthest distance of skin, see find_gaps
  double floor, ceiling; // that of no unit is less, or more, than these
  double *weights;       // (cells,) before what passed
  hfx_two *matrices;     // see hfx_find_matrices
  hfx_spread spread;
  int64_t row, pair, has_matrices, has_gaps, has_metric;
  double metric[6];      // of shape space: what makes squared metres of ways, see find_metric
  double allowed;        // how far skin may be from its samples, metres
  double turns[2][9];    // cross products to the world, and these back
  int64_t has_turns;
  double skew;           // no less than its largest stretch to the world over its smallest; below 0: not known
} posed_pair;

// Optional details of contacts, in shape space; see contact/contact_query.py. A contact is
// numbered by its row and column.
typedef struct {
  double *places;                 // (contacts, 3) of their vertices
  double *since;                  // (contacts,) when it began
  double *entries, *ways;         // (contacts, 3)
  double *samples;                // (room, 3) inside, of contacts whose vertex is outside
  int64_t *contacts;              // (room,) of samples
  int64_t count, room;            // how many there are, even where there is no room for all
} hfx_details;

// State of the narrow phase.
typedef struct {
  const hfx_table *table;
  const hfx_target *target;
  const hfx_bones *bones;
  const hfx_cluster *cluster;  // NULL where places are given
  const hfx_surface_places *surface;
  hfx_details *details;        // or NULL
  int64_t contact;             // whose samples are recorded; below 0: none
  double began, entry[3], way[3];  // how it was entered first
  hfx_search *search;          // of meshes; not in here, so that the rest stays in registers
  double moved;                // no place has moved farther since the pair before
  int is_same;                 // the volume has the shape that it had then
  hfx_shape shape;
  int64_t number, first;  // the cluster, its first place
  int64_t posed;          // places
  double limit;           // mean distance within which vertices suffice
  double steepest;
  double on_the_way[MOST_STEPS + 1];  // see stretches_of
  int64_t on_the_way_of;              // which way; below 0: none
} context;

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

static inline double weight_of(context *ctx, const double p[3]) {
  const hfx_mesh *mesh = ctx->shape.mesh;
  if (mesh) return hfx_mesh_holds(mesh, p) ? strength_in_mesh(ctx->target, mesh, p, ctx->search) : 0.0;
  if (ctx->target->is_flat) return hfx_contains(ctx->shape, p) ? 1.0 : 0.0;
  return strength_of(ctx->target, 1.0 - hfx_share(ctx->shape, p));
}

// The weights of two places, x, y and z of both, by the formula of a volume.
static inline hfx_two weights_of_two(const context *ctx, const hfx_two p[3]) {
  const hfx_target *target = ctx->target;
  hfx_two gauge = hfx_gauges(ctx->shape, p, target->is_flat);
  if (target->is_flat) return hfx_chosen(gauge <= 1.0, (hfx_two){1.0, 1.0}, (hfx_two){0.0, 0.0});
  hfx_two share = {target->share, target->share}, rise = 1.0 - gauge;
  hfx_two t = hfx_chosen(rise < share, rise, share) / share;
  if (target->is_smooth) t = t * t * (3.0 - 2.0 * t);
  return hfx_chosen(rise > 0.0, t, (hfx_two){0.0, 0.0});
}

// Weights of at most TOGETHER_AT_ONCE places.
static inline void weigh(context *ctx, const double (*points)[3], int64_t count, double *weights) {
  if (!ctx->shape.mesh) {
    for (int64_t k = 0; k < count; k++) weights[k] = weight_of(ctx, points[k]);
    return;
  }
  double planar[3 * TOGETHER_AT_ONCE];
  uint8_t inside[TOGETHER_AT_ONCE];
  for (int64_t k = 0; k < count; k++)
    for (int i = 0; i < 3; i++) planar[i * count + k] = points[k][i];
  hfx_mesh_inside(ctx->shape.mesh->grid, planar, count, inside);
  for (int64_t k = 0; k < count; k++)
    weights[k] =
        inside[k] ? strength_in_mesh(ctx->target, ctx->shape.mesh, points[k], ctx->search) : 0.0;
}

// Clearance of a place from a volume; see Shape.clearance.
static inline double clearance_of(context *ctx, hfx_shape shape, const double p[3]) {
  if (!shape.mesh) return hfx_share(shape, p) - 1.0;
  double clearance = hfx_mesh_clearance(shape.mesh, p, ctx->search);
  // The slope of the strength depends on the mesh: what is inside is sampled.
  return ctx->target->is_flat ? clearance : hfx_larger(clearance, 0.0);
}

// Records a place that is inside, where details need it.
static inline void record_inside(context *ctx, const double p[3]) {
  hfx_details *details = ctx->details;
  if (!details || ctx->contact < 0) return;
  if (details->count < details->room) {
    for (int i = 0; i < 3; i++) details->samples[3 * details->count + i] = p[i];
    details->contacts[details->count] = ctx->contact;
  }
  details->count++;
}

// Poses a place; not inlined, so that place_of is.
static __attribute__((noinline)) void pose(context *ctx, posed_pair *pair, int64_t place) {
  double *point = pair->points + 3 * place;
  pair->posed[place] = pair->pair;
  ctx->posed++;
  if (ctx->cluster) {
    if (!pair->has_matrices) hfx_find_matrices(ctx->cluster, ctx->bones, pair->row, pair->matrices);
    pair->has_matrices = 1;
    hfx_pose(ctx->cluster, pair->matrices, place, point);
  } else {
    const hfx_surface_places *surface = ctx->surface;
    int64_t from = surface->at[pair->row] * surface->place_count + ctx->first + place;
    hfx_moved_by(ctx->target->body_to_shape + 16 * pair->row, surface->places + 3 * from, point);
  }
  pair->clearance[place] = clearance_of(ctx, hfx_shape_at(ctx->target, pair->row), point);
  pair->exact_gaps[place] = -1.0;
  if (place < ctx->table->unit_counts[ctx->number])
    pair->least[place] = pair->most[place] = pair->clearance[place];
}

// A place, posed.
static inline const double *place_of(context *ctx, posed_pair *pair, int64_t place) {
  if (pair->posed[place] != pair->pair) pose(ctx, pair, place);
  return pair->points + 3 * place;
}

// Bounds of the farthest distance of each unit's skin, over its reach.
static void find_gaps(const context *ctx, posed_pair *pair) {
  if (pair->has_gaps) return;
  pair->has_gaps = 1;
  int64_t units = ctx->table->unit_counts[ctx->number];
  double *restrict gaps = pair->gaps;
  if (!ctx->cluster) {
    for (int64_t u = 0; u < units; u++) gaps[u] = 1e300;  // nothing is known; times 0 it is 0
    return;
  }
  const double *restrict extents = ctx->cluster->extents;
  const double *differences = ctx->cluster->differences;
  double along = pair->spread.along * SLACK;
  for (int64_t u = 0; u < units; u++) gaps[u] = along * extents[u];
  for (int64_t b = 0; b < ctx->cluster->bone_count; b++, differences += units) {
    double apart = pair->spread.apart[b] * SLACK;
    for (int64_t u = 0; u < units && apart > 0.0; u++) gaps[u] += apart * differences[u];
  }
}

// Bound of the distance of a unit to its farthest neighbour.
static inline double most_gap(const context *ctx, const posed_pair *pair, int64_t unit) {
  if (!ctx->cluster) return pair->gaps[unit];
  double more = ctx->cluster->distances[unit] - ctx->cluster->extents[unit];
  return pair->gaps[unit] + pair->spread.along * SLACK * more;
}

static inline double gap_of(context *ctx, posed_pair *pair, int64_t unit) {
  const double *own = place_of(ctx, pair, unit);
  if (!(pair->exact_gaps[unit] < 0.0)) return pair->exact_gaps[unit];
  int64_t first = ctx->first, place = first + unit;
  const int32_t *other = ctx->table->around + 2 * ctx->table->quad_starts[place];
  const int32_t *last = ctx->table->around + 2 * ctx->table->quad_starts[place + 1];
  const double x = own[0], y = own[1], z = own[2];
  double squared = 0.0, sum = 0.0;
  for (int step = ctx->table->is_ringed[place] ? 2 : 1; other < last; other += step) {
    const double *p = place_of(ctx, pair, *other - first);
    double way[3] = {p[0] - x, p[1] - y, p[2] - z};
    double each = hfx_dot(way, way);
    squared = each > squared ? each : squared;
    sum += each;  // is not a number where any of them is not
  }
  return pair->exact_gaps[unit] = sqrt(sum == sum ? squared : sum);
}

static inline double reach_of(context *ctx, posed_pair *pair, int64_t unit) {
  return gap_of(ctx, pair, unit) * ctx->table->reaches[ctx->first + unit];
}

// Tests strength at the vertex of a unit for being close enough: the mean over its skin differs by no
// more than the steepest change of strength times the mean distance from the vertex, wherever it is; that of a cell
// by the mean of its units. Rise changes by no more than the way in the space of a convex shape. `is_even`:
// whether the vertices of its cell together are close enough; below 0: not known yet.
static inline int is_unit_even(context *ctx, posed_pair *pair, int64_t unit, int64_t from, int64_t to,
                               int *is_even) {
  if (ctx->target->is_flat || ctx->shape.mesh || ctx->target->amplitude == 0.0) return 0;
  const hfx_table *table = ctx->table;
  double mean = table->means[ctx->first + unit];
  if (most_gap(ctx, pair, unit) * mean <= ctx->limit || gap_of(ctx, pair, unit) * mean <= ctx->limit)
    return 1;
  if (table->is_simple) return 0;
  if (*is_even < 0) {
    // Upper bounds first: distances have to be posed for.
    *is_even = 0;
    for (int is_exact = 0; is_exact < 2 && !*is_even; is_exact++) {
      double sum = 0.0;
      for (int64_t u = from; u < to; u++) {
        double gap = is_exact ? gap_of(ctx, pair, u) : most_gap(ctx, pair, u);
        sum += gap * table->means[ctx->first + u] * table->unit_shares[ctx->first + u];
      }
      *is_even = sum <= ctx->limit;
    }
  }
  return *is_even;
}

// A matrix turns cross products by its determinant times its inverse transposed.
static void find_turns(const context *ctx, posed_pair *pair) {
  const double *a = ctx->target->to_shape + 16 * pair->row, *b = ctx->target->to_world + 16 * pair->row;
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
    for (int j = 0; j < 3; j++) pair->turns[0][3 * i + j] = a[4 * j + i] * sign;
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < 3; j++) {
      const double *m = a + 4 * i, *turn = pair->turns[0] + j;
      pair->turns[1][3 * i + j] = m[0] * turn[0] + m[1] * turn[3] + m[2] * turn[6];
    }
  pair->has_turns = 1;
}

// The normal of a triangle with edges `a` and `b`, as long in the world as the square root of twice its
// area, all in shape space.
static inline void find_normal(const context *ctx, posed_pair *pair, const double a[3], const double b[3],
                               double normal[3]) {
  if (!pair->has_turns) find_turns(ctx, pair);
  double cross[3] = {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
  double squared = 0.0;
  for (int i = 0; i < 3; i++) {
    double world = hfx_dot(pair->turns[0] + 3 * i, cross);
    squared += world * world;
  }
  double size = sqrt(sqrt(squared));
  double lost = 0.0;  // not a number, if any of these is not or is endless
  for (int i = 0; i < 3; i++) {
    normal[i] = hfx_dot(pair->turns[1] + 3 * i, cross) / size;
    lost += normal[i] - normal[i];
  }
  if (lost != 0.0) normal[0] = normal[1] = normal[2] = 0.0;
}

// A quad's triangle as it is posed: its corners, both edges from the first, outwards where it is curved, and
// how far its skin bulges, which is its height as a share of the normal.
typedef struct {
  double corners[3][3], edges[2][3], normal[3], height, bulge;
} triangle;

// No less than how far the skin of a quad bulges, of a unit whose gap is known: a triangle's normal is as long
// as the square root of twice its area, in the world.
static inline double bulge_bound(const context *ctx, posed_pair *pair, int64_t unit, const triangle *t) {
  if (!(t->height > 0.0)) return 0.0;
  if (pair->skew < 0.0)
    pair->skew = hfx_stretch(ctx->target->to_shape + 16 * pair->row, 4) *
                 hfx_stretch(ctx->target->matrices + 16 * pair->row, 4);
  return SLACK * t->height * pair->skew * pair->exact_gaps[unit];
}

// Corners and height of the triangle of a quad; all of them are posed.
static inline void find_corners(const context *ctx, const posed_pair *pair, int64_t unit, int64_t quad,
                                triangle *t) {
  for (int k = 0; k < 3; k++) {
    int64_t place = k ? ctx->table->around[2 * quad + k - 1] - ctx->first : unit;
    for (int i = 0; i < 3; i++) t->corners[k][i] = pair->points[3 * place + i];
  }
  t->height = ctx->table->heights[quad];
}

// Edges, normal and bulge of a triangle whose corners are known.
static inline void find_edges(const context *ctx, posed_pair *pair, triangle *t) {
  for (int k = 0; k < 2; k++)
    for (int i = 0; i < 3; i++) t->edges[k][i] = t->corners[1 + k][i] - t->corners[0][i];
  t->normal[0] = t->normal[1] = t->normal[2] = t->bulge = 0.0;
  if (!(t->height > 0.0)) return;
  find_normal(ctx, pair, t->edges[0], t->edges[1], t->normal);
  t->bulge = SLACK * t->height * sqrt(hfx_dot(t->normal, t->normal));
}

// Number `k` of a quad's samples, where it has `steps` both ways.
static inline hfx_sample sample_of(const context *ctx, int64_t quad, int64_t steps, int64_t k) {
  const hfx_table *table = ctx->table;
  int64_t known = table->steps[quad], room = table->rooms[ctx->number];
  if (steps == known) {
    const double *s = table->blocks[ctx->number] + table->sample_starts[quad] + k;
    return (hfx_sample){s[0], s[room], s[2 * room], s[3 * room]};
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
    p[i] = t->edges[0][i] * s->one + t->corners[0][i] + t->edges[1][i] * s->other + t->normal[i] * s->height;
}

// A way's square, or the product of two, by the metric of a pair.
static inline double product_of(const double m[6], const double a[3], const double b[3]) {
  return a[0] * (m[0] * b[0] + m[1] * b[1] + m[2] * b[2]) +
         a[1] * (m[1] * b[0] + m[3] * b[1] + m[4] * b[2]) +
         a[2] * (m[2] * b[0] + m[4] * b[1] + m[5] * b[2]);
}

// The metric of a pair, and how far its skin may be from its samples; see hfx_table.
static inline void find_metric(const context *ctx, posed_pair *pair) {
  pair->has_metric = 1;
  const double *m = ctx->target->matrices + 16 * pair->row;
  for (int i = 0, n = 0; i < 3; i++)
    for (int j = i; j < 3; j++, n++)
      pair->metric[n] = m[i] * m[j] + m[4 + i] * m[4 + j] + m[8 + i] * m[8 + j];
  pair->allowed = ctx->table->distance_m;
  if (!isfinite(pair->allowed)) return;
  if (!ctx->cluster) {  // how its surface stretches is not known, only how the body does
    const double *m = ctx->target->to_world + 16 * pair->row;
    double most = 0.0;
    for (int j = 0; j < 3; j++)
      most = hfx_larger(most, m[j] * m[j] + m[4 + j] * m[4 + j] + m[8 + j] * m[8 + j]);
    pair->allowed *= sqrt(most);
    return;
  }
  if (!pair->has_matrices) hfx_find_matrices(ctx->cluster, ctx->bones, pair->row, pair->matrices);
  pair->has_matrices = 1;
  double least = INFINITY;
  const double *bone = (const double *)pair->matrices;
  for (int64_t b = 0; b < ctx->cluster->bone_count; b++, bone += 12) {
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
static inline int64_t steps_of(const context *ctx, posed_pair *pair, int64_t quad, const triangle *t) {
  const hfx_table *table = ctx->table;
  int64_t steps = table->steps[quad], finest = table->finest[quad];
  if (steps >= finest) return steps;
  if (!pair->has_metric) find_metric(ctx, pair);
  double squares[3];
  for (int k = 0; k < 3; k++)
    squares[k] = product_of(pair->metric, t->edges[k == 2], t->edges[k > 0]);
  double allowed = pair->allowed * pair->allowed, number = (double)steps;
  if (isfinite(table->spacing_share)) {
    double spacing = table->spacing_share * table->spacing_share * hfx_larger(squares[0], squares[2]);
    allowed = hfx_smaller(allowed, spacing);
  }
  double most = 4.0 * number * number * allowed;
  double third = squares[0] + squares[2] - 2.0 * squares[1];
  // A bound first: of most quads the rest is not in the processor's cache.
  if (table->diagonals[quad] * hfx_larger(hfx_larger(squares[0], squares[2]), third) <= most) return steps;
  most *= 1.0 + 2.0 * ROUNDING;
  if (!(hfx_diagonal(table->quads + quad, squares, number) > most)) return steps;
  double longest = hfx_diagonal(table->quads + quad, squares, INFINITY);
  double wanted = hfx_steps_within(table->quads + quad, squares, longest, sqrt(allowed));
  return wanted < (double)finest ? (int64_t)wanted : finest;
}

#endif
