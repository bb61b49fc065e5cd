// SPDX-License-Identifier: GPL-3.0-or-later
// Contact of skin with a volume that has a formula: how much of each cell is inside, and what
// passed since the row before. See engine/{narrow,swept}.py, whose terms these are.

#include <math.h>
#include <stddef.h>

#include "analytic.h"
#include "broad.h"
#include "hfx_native.h"
#include "skin.h"
#include "skin_posing.h"

#define MOST_STEPS 64
#define STEP_KINDS 7  // powers of two up to MOST_STEPS
#define PLACES_ALONG 5
#define SLACK (1.0 + 1e-9)
#define SPARE 1e-9

static const double WHOLE = 1.0 - 1e-9;

// How points that rest in a body's frame move, in 2^k steps of each interval; see swept.Drift.
typedef struct {
  const double *before[STEP_KINDS];  // (steps + 1, rows - 1, 4, 4)
  const double *after[STEP_KINDS];
  int64_t intervals;
} hfx_drift;

// Where weights go.
typedef struct {
  void *weights;  // (rows, columns)
  const int64_t *column_of;  // of cells
  int64_t columns, is_single, posed;  // `posed` is counted up: how many places were
} hfx_found;

typedef struct {
  double when, change;  // of how much is inside
} event;

// One pair as it is looked at. Places are posed when they are first asked for: most of a cluster
// stays so far from the volume that its motion since it was posed tells enough.
typedef struct {
  double *points;        // (places, 3)
  double *clear;         // (places,) of those that are posed, how far from the boundary
  double *exact;         // (places,) of those, distance to the farthest neighbour; below 0: not yet
  int64_t *posed;        // (places,) the number of the pair for which it was
  double *least;         // (units,) clearance is no less
  double *weights;       // (cells,) before what passed
  hfx_two *columns;      // see hfx_find_columns
  hfx_spread spread;
  int64_t row, pair, has_columns;
} side;

typedef struct {
  const hfx_table *table;
  const hfx_target *target;
  const hfx_bones *bones;
  const hfx_cluster *cluster;  // NULL where points are given
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
} look;

static double weight_of(const look *at, const double p[3]) {
  const hfx_target *target = at->target;
  if (target->is_flat) return hfx_contains(at->shape, p) ? 1.0 : 0.0;
  double rise = 1.0 - hfx_share(at->shape, p);
  if (!(rise > 0.0)) return 0.0;
  double t = (rise < target->share ? rise : target->share) / target->share;
  return target->is_smooth ? t * t * (3.0 - 2.0 * t) : t;
}

// A place, posed.
static inline const double *place_of(look *at, side *pair, int64_t place) {
  double *point = pair->points + 3 * place;
  if (pair->posed[place] == pair->pair) return point;
  pair->posed[place] = pair->pair;
  at->posed++;
  if (at->cluster) {
    if (!pair->has_columns) hfx_find_columns(at->cluster, at->bones, pair->row, pair->columns);
    pair->has_columns = 1;
    hfx_pose(at->cluster, pair->columns, place, point);
  }
  hfx_shape shape = {at->target->kinds[pair->row], at->target->halves[pair->row]};
  pair->clear[place] = hfx_share(shape, point) - 1.0;
  pair->exact[place] = -1.0;
  if (place < at->table->unit_counts[at->number]) pair->least[place] = pair->clear[place];
  return point;
}

// A bound of the distance to the farthest neighbour of a unit (its place in the cluster).
static inline double gap_bound(const look *at, const side *pair, int64_t unit) {
  if (!at->cluster) return 1e300;  // nothing is known; times 0 it is 0
  const hfx_cluster *c = at->cluster;
  return (pair->spread.along * c->distances[unit] + pair->spread.apart * c->differences[unit]) * SLACK;
}

static double gap_of(look *at, side *pair, int64_t unit) {
  const double *own = place_of(at, pair, unit);
  if (!(pair->exact[unit] < 0.0)) return pair->exact[unit];
  const hfx_table *table = at->table;
  int64_t place = at->first + unit;
  double squared = 0.0;
  int both = table->is_ringed[place] ? 1 : 2;
  for (int64_t q = table->quad_starts[place]; q < table->quad_starts[place + 1]; q++)
    for (int k = 0; k < both; k++) {
      const double *other = place_of(at, pair, table->around[2 * q + k] - at->first);
      double way[3] = {other[0] - own[0], other[1] - own[1], other[2] - own[2]};
      squared = hfx_larger(squared, hfx_dot(way, way));
    }
  return pair->exact[unit] = sqrt(squared);
}

static inline double reach_of(look *at, side *pair, int64_t unit) {
  return gap_of(at, pair, unit) * at->table->reaches[at->first + unit];
}

// See narrow.told_by_vertices: whether strength at the vertex of a unit is close enough. `cell`
// is what is known of its cell: below 0 nothing yet, else whether that is told as a whole.
static int is_told(look *at, side *pair, int64_t unit, int64_t from, int64_t to, int *cell) {
  if (at->target->is_flat || at->target->amplitude == 0.0) return 0;
  const hfx_table *table = at->table;
  if (gap_of(at, pair, unit) * table->means[at->first + unit] <= at->limit) return 1;
  if (table->is_simple) return 0;
  if (*cell < 0) {
    double sum = 0.0;
    for (int64_t u = from; u < to; u++)
      sum += gap_of(at, pair, u) * table->means[at->first + u] * table->unit_shares[at->first + u];
    *cell = sum <= at->limit;
  }
  return *cell;
}

// See Target._turns: a matrix turns cross products by its determinant times its inverse transposed.
static void find_turns(look *at, int64_t row) {
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

// See Target.outwards.
static void outwards(look *at, int64_t row, const double a[3], const double b[3], double out[3]) {
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

static void corners_of(look *at, side *pair, int64_t unit, int64_t quad,
                       double corners[3][3]) {
  for (int k = 0; k < 3; k++) {
    int64_t place = k ? at->table->around[2 * quad + k - 1] - at->first : unit;
    const double *point = place_of(at, pair, place);
    for (int i = 0; i < 3; i++) corners[k][i] = point[i];
  }
}

static void find_edges(look *at, int64_t row, int64_t quad, triangle *t) {
  for (int k = 0; k < 2; k++)
    for (int i = 0; i < 3; i++) t->edges[k][i] = t->corners[1 + k][i] - t->corners[0][i];
  t->out[0] = t->out[1] = t->out[2] = 0.0;
  if (at->table->heights_m[quad]) outwards(at, row, t->edges[0], t->edges[1], t->out);
}

// Where a sample of a triangle is.
static inline void sample_of(const hfx_table *table, int64_t sample, const triangle *t, double p[3]) {
  const double *s = table->samples + sample;
  double one = s[0], other = s[table->room], height = s[2 * table->room];
  for (int i = 0; i < 3; i++)
    p[i] = t->edges[0][i] * one + t->corners[0][i] + t->edges[1][i] * other + t->out[i] * height;
}

static inline double share_of(const hfx_table *table, int64_t sample) {
  return table->samples[sample + 3 * table->room];
}

// See narrow.covered: the share of a cell that is inside and falls to one of its units.
static double cover(look *at, side *pair, int64_t unit, int64_t from, int64_t to, int *cell) {
  const hfx_table *table = at->table;
  const hfx_target *target = at->target;
  int64_t place = at->first + unit;
  double bound = gap_bound(at, pair, unit) * table->reaches[place];
  if (!(pair->least[unit] <= bound)) return 0.0;
  const double *vertex = place_of(at, pair, unit);
  double gap = pair->clear[unit];
  if (!(gap <= bound)) return 0.0;
  double at_vertex = weight_of(at, vertex);
  int near = 0;
  if (table->steps[place] > 0) {
    near = gap >= -bound;
    if (target->is_flat) {
      double reach = near ? reach_of(at, pair, unit) : 0.0;
      if (near && gap > reach) return 0.0;
      near = near && gap >= -reach;
    } else {
      int varies = at->steepest * bound > target->amplitude && at_vertex > 0.0;
      near |= varies && -gap < target->share + bound;
      if (near) near = !is_told(at, pair, unit, from, to, cell);
    }
  }
  if (!near) return at_vertex * table->unit_shares[place];
  double sum = at_vertex * table->vertex_shares[place];
  double margin = table->bulge_m[at->number] * at->stretch;
  int64_t count = table->steps[place] * table->steps[place];
  for (int64_t q = table->quad_starts[place]; q < table->quad_starts[place + 1]; q++) {
    triangle t;
    corners_of(at, pair, unit, q, t.corners);
    if (hfx_parted(at->shape, (const double(*)[3])t.corners, 3, margin)) continue;
    if (target->is_flat) {
      double deepest = gap;
      for (int k = 0; k < 2; k++)
        deepest = hfx_larger(deepest, pair->clear[table->around[2 * q + k] - at->first]);
      if (deepest <= -table->heights_m[q] * at->stretch) {
        sum += table->wholes[q];
        continue;
      }
    }
    find_edges(at, pair->row, q, &t);
    for (int64_t s = table->sample_starts[q]; s < table->sample_starts[q] + count; s++) {
      double p[3];
      sample_of(table, s, &t, p);
      sum += weight_of(at, p) * share_of(table, s);
    }
  }
  return sum;
}

static inline double loaded(const hfx_found *found, int64_t at) {
  return found->is_single ? (double)((const float *)found->weights)[at]
                          : ((const double *)found->weights)[at];
}

static inline void store(const hfx_found *found, int64_t at, double weight) {
  if (found->is_single)
    ((float *)found->weights)[at] = (float)weight;
  else
    ((double *)found->weights)[at] = weight;
}

// Where a point is on the way, (steps + 1, 3); see Drift.path.
static void path_of(const hfx_drift *drift, int64_t steps, int kind, int64_t interval,
                    const double before[3], const double after[3], double path[][3]) {
  for (int i = 0; i < 3; i++) path[0][i] = before[i], path[steps][i] = after[i];
  for (int64_t k = 1; k < steps; k++) {
    double share = (double)k / (double)steps;
    const double *one = drift->before[kind] + 16 * (k * drift->intervals + interval);
    const double *other = drift->after[kind] + 16 * (k * drift->intervals + interval);
    for (int i = 0; i < 3; i++)
      path[k][i] = (1.0 - share) * (hfx_dot(one + 4 * i, before) + one[4 * i + 3]) +
                   share * (hfx_dot(other + 4 * i, after) + other[4 * i + 3]);
  }
}

// See swept._along.
static void along(const double (*path)[3], int64_t steps, double share, double p[3]) {
  int64_t step = (int64_t)(share * (double)steps);
  step = step < 0 ? 0 : (step > steps - 1 ? steps - 1 : step);
  for (int i = 0; i < 3; i++)
    p[i] = path[step][i] + (share * (double)steps - (double)step) * (path[step + 1][i] - path[step][i]);
}

// See swept._may_meet: whether a ball on a path may meet the volume. Every shape holds the unit
// ball, so that within a factor 1 + r of it is all that is nearer than r.
static int may_meet(hfx_shape shape, const double (*path)[3], int64_t steps, double reach) {
  double share = 1.0 / (1.0 + reach);
  for (int64_t k = 0; k < steps; k++) {
    double start[3], end[3];
    for (int i = 0; i < 3; i++) start[i] = path[k][i] * share, end[i] = path[k + 1][i] * share;
    hfx_times t = hfx_passage(shape, start, end);
    if (t.first <= t.last) return 1;
  }
  return 0;
}

// See swept._entered: adds when something on a path was inside. The number of events then.
static int64_t enter(const look *at, const double (*path)[3], int64_t steps, double share,
                     event *events, int64_t count) {
  double first = INFINITY, last = -INFINITY;
  for (int64_t k = 0; k < steps; k++) {
    hfx_times t = hfx_passage(at->shape, path[k], path[k + 1]);
    if (!(t.first <= t.last)) continue;
    if (first == INFINITY) first = ((double)k + t.first) / (double)steps;
    last = ((double)k + t.last) / (double)steps;
  }
  if (first == INFINITY) return count;
  double strength = 1.0;
  if (!at->target->is_flat) {
    strength = 0.0;
    for (int k = 0; k < PLACES_ALONG; k++) {
      double p[3];
      along(path, steps, first + (double)k / (PLACES_ALONG - 1) * (last - first), p);
      double here = weight_of(at, p);
      if (here > strength) strength = here;
    }
  }
  events[count].when = first, events[count++].change = share * strength;
  events[count].when = last, events[count++].change = -share * strength;
  return count;
}

// Earlier first; of what is at the same time, what enters.
static inline int is_before(event a, event b) {
  return a.when < b.when || (a.when == b.when && a.change >= 0.0 && b.change < 0.0);
}

static void sift(event *events, int64_t root, int64_t count) {
  event moved = events[root];
  for (int64_t child; (child = 2 * root + 1) < count; root = child) {
    if (child + 1 < count && is_before(events[child], events[child + 1])) child++;
    if (!is_before(moved, events[child])) break;
    events[root] = events[child];
  }
  events[root] = moved;
}

// The most that was inside at one moment; see Crossings.peaks.
static double peak_of(event *events, int64_t count) {
  for (int64_t root = count / 2; root-- > 0;) sift(events, root, count);
  for (int64_t last = count - 1; last > 0; last--) {
    event largest = events[0];
    events[0] = events[last], events[last] = largest;
    sift(events, 0, last);
  }
  double inside = 0.0, peak = 0.0;
  for (int64_t k = 0; k < count; k++) {
    inside += events[k].change;
    if (inside > peak) peak = inside;
  }
  return peak > WHOLE ? 1.0 : peak;
}

// See swept.passing and swept.crossings: what of a unit entered on the way from one pair to the
// next. The number of events then.
static int64_t follow(look *at, side *before, side *now, int64_t unit, int64_t from, int64_t to,
                      int64_t steps, const hfx_drift *drift, int cells[2], event *events,
                      int64_t count) {
  const hfx_table *table = at->table;
  int64_t place = at->first + unit, interval = now->row - 1;
  int kind = 0;
  while (((int64_t)1 << kind) < steps) kind++;
  double path[MOST_STEPS + 1][3];
  // On a straight way of length l between clearances a and b, clearance is nowhere less than
  // (a + b - l) / 2.
  double bound = hfx_larger(gap_bound(at, before, unit), gap_bound(at, now, unit));
  bound *= 2.0 * table->reaches[place];
  int is_straight = steps == 1 && at->is_same;
  if (is_straight) {
    double least = before->least[unit] + now->least[unit];
    if (least - at->moved > bound + SPARE * (fabs(least) + at->moved)) return count;
  }
  const double *one = place_of(at, before, unit), *other = place_of(at, now, unit);
  if (is_straight) {
    double clear = before->clear[unit] + now->clear[unit];
    double way[3] = {other[0] - one[0], other[1] - one[1], other[2] - one[2]};
    double length = sqrt(hfx_dot(way, way)), spare = SPARE * (fabs(clear) + length);
    if (clear - length > bound + spare) return count;
  }
  path_of(drift, steps, kind, interval, one, other, path);
  if (!may_meet(at->shape, (const double(*)[3])path, steps, 0.5 * bound)) return count;
  double reach = hfx_larger(reach_of(at, before, unit), reach_of(at, now, unit));
  if (!may_meet(at->shape, (const double(*)[3])path, steps, reach)) return count;
  int told = is_told(at, now, unit, from, to, &cells[1]) && is_told(at, before, unit, from, to, &cells[0]);
  double share = told ? table->unit_shares[place] : table->vertex_shares[place];
  count = enter(at, (const double(*)[3])path, steps, share, events, count);
  if (told || table->steps[place] == 0) return count;
  int64_t samples = table->steps[place] * table->steps[place];
  for (int64_t q = table->quad_starts[place]; q < table->quad_starts[place + 1]; q++) {
    triangle a, b;
    corners_of(at, before, unit, q, a.corners);
    corners_of(at, now, unit, q, b.corners);
    if (steps == 1) {
      double corners[6][3];
      for (int k = 0; k < 3; k++)
        for (int i = 0; i < 3; i++) corners[k][i] = a.corners[k][i], corners[3 + k][i] = b.corners[k][i];
      double stretch = hfx_larger(at->stretch, hfx_stretch(at->target->to_shape + 16 * interval, 4));
      if (hfx_parted(at->shape, (const double(*)[3])corners, 6, table->bulge_m[at->number] * stretch))
        continue;
    }
    // Samples of the start stand outwards as the skin did there.
    at->has_turns = 0;
    find_edges(at, interval, q, &a);
    at->has_turns = 0;
    find_edges(at, now->row, q, &b);
    for (int64_t s = table->sample_starts[q]; s < table->sample_starts[q] + samples; s++) {
      double start[3], end[3];
      sample_of(table, s, &a, start);
      sample_of(table, s, &b, end);
      path_of(drift, steps, kind, interval, start, end, path);
      count = enter(at, (const double(*)[3])path, steps, share_of(table, s), events, count);
    }
  }
  return count;
}

enum { INSIDE = 1, PASSED = 2 };

// What a cell may be: inside at a pair, or have passed on the way from the one before it. `least`
// is the clearance that no place of the cluster is below at the pair.
static int may_be(const look *at, const side *before, side *now, int64_t from, int64_t to,
                  double least) {
  const double *reaches = at->table->reaches + at->first;
  int may = 0;
  for (int64_t u = from; u < to; u++) {
    double bound = hfx_larger(gap_bound(at, before, u), gap_bound(at, now, u)) * reaches[u];
    double since = before->least[u] - at->moved - SPARE * (fabs(before->least[u]) + at->moved);
    now->least[u] = since > least ? since : least;
    if (!(since > bound)) may |= PASSED;
    if (!(now->least[u] > bound)) may |= INSIDE;
  }
  return may;
}

// Room in a double array: the next `count`, and where what follows begins.
static double *take(double **room, int64_t count) {
  double *taken = *room;
  *room += count;
  return taken;
}

static void make_sides(side sides[2], double *room, int64_t places, int64_t units, int64_t cells,
                       int64_t bones) {
  for (int k = 0; k < 2; k++) sides[k].columns = (hfx_two *)take(&room, 16 * bones);
  for (int k = 0; k < 2; k++) {
    side *each = sides + k;
    each->points = take(&room, 3 * places);
    each->clear = take(&room, places);
    each->exact = take(&room, places);
    each->posed = (int64_t *)take(&room, places);
    each->least = take(&room, units);
    each->weights = take(&room, cells);
    each->row = each->pair = -2;  // before no row
    each->spread.along = each->spread.apart = 0.0;
    for (int64_t p = 0; p < places; p++) each->posed[p] = -1;
    for (int64_t u = 0; u < units; u++) each->least[u] = -INFINITY;
  }
}

// Contact weights of pairs; what is less than what is there already is left out.
//
// `own` poses the vertices of cells where these are not units of the surface; else it is NULL.
// `room` has space for 3 * 16 bones + 2 (6 places + units + cells) + 2 doubles of the largest cluster,
// `events` for twice the most samples of a cell. 
HFX_EXPORT void hfx_look_at_skin(const hfx_pairs *pairs, const hfx_table *table,
                                 const hfx_cluster *clusters, const hfx_cluster *own,
                                 const hfx_bones *bones, const hfx_target *target,
                                 const hfx_drift *drift, hfx_found *found, double *room,
                                 event *events) {
  look at = {.table = table, .target = target, .bones = bones};
  at.steepest = target->is_flat ? 0.0 : (target->is_smooth ? 1.5 : 1.0) / target->share;
  at.limit = target->is_flat ? 0.0 : target->amplitude / at.steepest;
  hfx_two *own_columns = NULL;
  side sides[2], *now = &sides[0], *before = &sides[1];
  int64_t shift = 0;
  for (int64_t p = 0; p < pairs->count; p++) {
    int64_t c = pairs->clusters[p], row = pairs->rows[p], steps = pairs->steps[p];
    int64_t places = table->place_counts[c], units = table->unit_counts[c];
    int64_t first_cell = table->cell_starts[c], cells = table->cell_starts[c + 1] - first_cell;
    if (p == 0 || c != pairs->clusters[p - 1]) {
      at.number = c, at.first = table->starts[c];
      at.cluster = pairs->points ? NULL : clusters + c;
      int64_t of_own = own ? own[c].bone_count : 0;
      own_columns = (hfx_two *)(((uintptr_t)room + 15) & ~(uintptr_t)15);
      make_sides(sides, (double *)own_columns + 16 * of_own, places, units, cells,
                 at.cluster ? at.cluster->bone_count : 0);
    }
    side *swapped = before;
    before = now, now = swapped;
    now->row = row, now->pair = p, now->has_columns = 0;
    at.shape.kind = target->kinds[row], at.shape.half = target->halves[row];
    at.stretch = hfx_stretch(target->to_shape + 16 * row, 4);
    at.has_turns = 0;
    double least = -INFINITY;
    at.moved = INFINITY;
    at.is_same = before->row == row - 1 && at.shape.kind == target->kinds[row - 1] &&
                 at.shape.half == target->halves[row - 1];
    if (at.cluster) {
      now->spread = hfx_spread_of(at.cluster, bones, row);
      double share = hfx_share(at.shape, now->spread.middle), radius = now->spread.radius;
      least = share - 1.0 - radius - SPARE * (share + radius);
      if (at.is_same && steps < 2) at.moved = hfx_moved(at.cluster, bones, row - 1, row);
    } else {
      for (int64_t k = 0; k < places; k++)
        for (int i = 0; i < 3; i++)
          now->points[3 * k + i] = pairs->points[i * pairs->total + shift + k];
    }
    shift += places;
    int64_t to = 0, has_own = 0;
    for (int64_t k = 0; k < cells; k++) {
      int64_t from = to, column = found->column_of[first_cell + k] + row * found->columns;
      while (to < units && table->cell_of[at.first + to] == first_cell + k) to++;
      int may = may_be(&at, before, now, from, to, least);
      double share = 0.0;
      if (pairs->how[p] == HFX_WHOLE) {
        share = 1.0;
      } else if (pairs->how[p] == HFX_BY_VERTEX && own) {
        double vertex[3];
        if (!has_own) hfx_find_columns(own + c, bones, row, own_columns);
        has_own = 1, at.posed++;
        hfx_pose(own + c, own_columns, k, vertex);
        share = weight_of(&at, vertex);
      } else if ((may & INSIDE) && pairs->how[p] == HFX_BY_VERTEX) {
        share = weight_of(&at, place_of(&at, now, k));
      } else if ((may & INSIDE) && pairs->how[p] == HFX_COVERED) {
        int told = -1;
        for (int64_t u = from; u < to; u++) share += cover(&at, now, u, from, to, &told);
        if (share > WHOLE) share = 1.0;
      }
      if (share != 0.0) store(found, column, share);
      now->weights[k] = loaded(found, column);
      if (!(may & PASSED) || !steps || before->weights[k] != 0.0 || !(now->weights[k] < 1.0)) continue;
      int told[2] = {-1, -1};
      int64_t count = 0;
      for (int64_t u = from; u < to; u++)
        count = follow(&at, before, now, u, from, to, steps, drift, told, events, count);
      double peak = count ? peak_of(events, count) : 0.0;
      if (peak > now->weights[k]) store(found, column, peak);
    }
  }
  found->posed += at.posed;
}
