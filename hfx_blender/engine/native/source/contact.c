// SPDX-License-Identifier: GPL-3.0-or-later
// Contact of skin with a volume that has a formula: how much of each cell is inside, and what
// passed since the row before. See engine/{narrow,swept}.py, whose terms these are.

#include "hfx_native.h"
#include "passing.h"
#include "posed_pair.h"

// Where weights go.
typedef struct {
  void *weights;  // (rows, columns)
  const int64_t *column_of;  // of cells
  int64_t columns, is_single, posed;  // `posed` is counted up: how many places were
} hfx_found;

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
  at.steepest = hfx_steepest(target);
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
