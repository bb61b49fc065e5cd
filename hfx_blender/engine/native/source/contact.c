// SPDX-License-Identifier: GPL-3.0-or-later
// Narrow phase: the share of each cell of skin inside a volume, and of what passed since the row before.
// Defined in engine/reference.

#include <string.h>

#include "hfx_native.h"
#include "passing.h"
#include "posed_pair.h"

// Contact weights, the result.
typedef struct {
  void *weights;  // (rows, columns)
  const int64_t *column_of;  // of cells
  int64_t columns, is_single, posed;  // `posed` is counted up: how many places were
} hfx_found;

// The weighted share of a cell that samples of a quad make, `steps` both ways.
static double sampled(look *at, int64_t quad, int64_t steps, const triangle *t) {
  double points[TOGETHER_AT_ONCE][3], shares[TOGETHER_AT_ONCE], weights[TOGETHER_AT_ONCE], sum = 0.0;
  for (int64_t first = 0; first < steps * steps; first += TOGETHER_AT_ONCE) {
    int64_t count = steps * steps - first;
    if (count > TOGETHER_AT_ONCE) count = TOGETHER_AT_ONCE;
    for (int64_t k = 0; k < count; k++) {
      hfx_sample s = sample_of(at->table, quad, steps, first + k);
      place_sample(&s, t, points[k]);
      shares[k] = s.share;
    }
    weigh(at, (const double(*)[3])points, count, weights);
    for (int64_t k = 0; k < count; k++) sum += weights[k] * shares[k];
    for (int64_t k = 0; at->details && k < count; k++)
      if (weights[k] > 0.0) tell_inside(at, points[k]);
  }
  return sum;
}

// The share of a cell that is inside and falls to one of its units.
static double cover(look *at, side *pair, int64_t unit, int64_t from, int64_t to, int *cell) {
  const hfx_table *table = at->table;
  const hfx_target *target = at->target;
  int64_t place = at->first + unit;
  double bound = at->cluster ? pair->gaps[unit] * table->reaches[place] : reach_of(at, pair, unit);
  if (!(pair->least[unit] <= bound)) return 0.0;
  // A contact whose vertex is outside has its place at the deepest of all its samples.
  int is_searched = target->is_flat && at->details && at->contact >= 0;
  if (target->is_flat && table->is_split && !is_searched && pair->most[unit] < -bound)
    return table->unit_shares[place];
  const double *vertex = place_of(at, pair, unit);
  double gap = pair->clear[unit];
  if (!(gap <= bound)) return 0.0;
  int is_formula = !target->is_flat && !at->shape.mesh;  // that falls off with the clearance
  double at_vertex = is_formula ? strength_of(target, -gap) : weight_of(at, vertex);
  if (at_vertex > 0.0) tell_inside(at, vertex);
  int near = 0;
  if (table->is_split) {
    near = gap >= -bound;
    if (target->is_flat) {
      double reach = near ? reach_of(at, pair, unit) : 0.0;
      if (near && gap > reach) return 0.0;
      near = (near && gap >= -reach) || is_searched;
    } else {
      int varies = at->steepest * bound > target->amplitude && at_vertex > 0.0;
      near |= varies && -gap < target->share + bound;
      if (near) near = !is_told(at, pair, unit, from, to, cell);
    }
  }
  if (!near) return at_vertex * table->unit_shares[place];
  gap_of(at, pair, unit);  // poses all around it
  double sum = at_vertex * table->vertex_shares[place];
  double margin = table->bulge_m[at->number] * at->stretch;
  for (int64_t q = table->quad_starts[place]; q < table->quad_starts[place + 1]; q++) {
    triangle t;
    corners_of(at, pair, unit, q, t.corners);
    double deepest = gap, shallowest = gap;
    for (int k = 0; k < 2; k++) {
      double clear = pair->clear[table->around[2 * q + k] - at->first];
      deepest = hfx_larger(deepest, clear), shallowest = hfx_smaller(shallowest, clear);
    }
    // A corner inside: no plane parts them.
    if (!(shallowest <= 0.0) && hfx_parted(at->shape, (const double(*)[3])t.corners, 3, margin))
      continue;
    if (target->is_flat && !is_searched && !at->shape.mesh && deepest <= -table->heights_m[q] * at->stretch) {
      sum += table->wholes[q];
      continue;
    }
    find_edges(at, pair->row, q, &t);
    sum += sampled(at, q, steps_of(at, pair, q, &t), &t);
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

// State that a cell may have: inside at a pair, or passed on the way from the one before it.
static int may_be(const look *at, const side *before, side *now, int64_t from, int64_t to,
                  int is_followed) {
  const double *reaches = at->table->reaches + at->first;
  int may = 0;
  for (int64_t u = from; u < to; u++) {
    double bound = now->gaps[u];
    if (is_followed) bound = hfx_larger(before->gaps[u], bound);
    bound *= reaches[u];
    double since = before->least[u] - at->moved - SPARE * (fabs(before->least[u]) + at->moved);
    now->least[u] = since > now->floor ? since : now->floor;
    double until = before->most[u] + at->moved + SPARE * (fabs(before->most[u]) + at->moved);
    now->most[u] = until < now->ceiling ? until : now->ceiling;
    if (is_followed && !(since > bound)) may |= PASSED;
    if (!(now->least[u] > bound)) may |= INSIDE;
  }
  return may;
}

// The most of what find_gaps takes of any unit of a cluster, times how far its skin reaches.
typedef struct {
  double along, *apart;  // of the distance; of each bone's differences
} widest;

static void find_widest(const look *at, int64_t units, widest *most) {
  const double *reaches = at->table->reaches + at->first;
  most->along = 0.0;
  if (!at->cluster) return;
  const double *differences = at->cluster->differences;
  for (int64_t u = 0; u < units; u++)
    most->along = hfx_larger(most->along, at->cluster->distances[u] * reaches[u]);
  for (int64_t b = 0; b < at->cluster->bone_count; b++, differences += units) {
    most->apart[b] = 0.0;
    for (int64_t u = 0; u < units; u++)
      most->apart[b] = hfx_larger(most->apart[b], differences[u] * reaches[u]);
  }
}

// True if no cell of a cluster can be inside at a pair, nor, if it is followed, have passed since
// the one before it.
static int is_apart(const look *at, const side *before, const side *now, const widest *most,
                    int is_followed) {
  if (!at->cluster) return 0;
  double floor = now->floor, along = now->spread.along;
  if (is_followed) {
    along = hfx_larger(along, before->spread.along);
    floor = hfx_smaller(floor, before->floor - at->moved - SPARE * (fabs(before->floor) + at->moved));
  }
  double reach = along * most->along;
  for (int64_t b = 0; b < at->cluster->bone_count; b++) {
    double apart = now->spread.apart[b];
    if (is_followed) apart = hfx_larger(apart, before->spread.apart[b]);
    reach += apart * most->apart[b];
  }
  return floor > reach * SLACK * SLACK;
}

// Resets the state of a cluster's pairs.
static void make_sides(const look *at, double *room, side sides[2], widest *most) {
  const hfx_table *table = at->table;
  int64_t c = at->number, places = table->place_counts[c], units = table->unit_counts[c];
  int64_t cells = table->cell_starts[c + 1] - table->cell_starts[c];
  int64_t bones = at->cluster ? at->cluster->bone_count : 0;
  room = (double *)(((uintptr_t)room + 15) & ~(uintptr_t)15);
  for (int k = 0; k < 2; k++) sides[k].matrices = (hfx_two *)take(&room, 12 * bones);
  most->apart = take(&room, bones);
  for (int k = 0; k < 2; k++) {
    side *each = sides + k;
    each->spread.apart = take(&room, bones);
    each->points = take(&room, 3 * places);
    each->clear = take(&room, places);
    each->exact = take(&room, places);
    each->posed = (int64_t *)take(&room, places);
    each->least = take(&room, units);
    each->most = take(&room, units);
    each->gaps = take(&room, units);
    each->weights = take(&room, cells);
    each->row = each->pair = -2;  // before no row
    each->spread.along = 0.0;
    for (int64_t b = 0; b < bones; b++) each->spread.apart[b] = 0.0;
    each->floor = -INFINITY, each->ceiling = INFINITY;
    for (int64_t p = 0; p < places; p++) each->posed[p] = -1;
    for (int64_t u = 0; u < units; u++) each->least[u] = -INFINITY, each->most[u] = INFINITY;
  }
}

// Goes on from a pair to the next one of its cluster.
static void turn_to_pair(look *at, const side *before, side *now, int64_t pair, int64_t row,
                         int64_t steps) {
  const hfx_target *target = at->target;
  now->row = row, now->pair = pair, now->has_matrices = now->has_gaps = now->has_metric = 0;
  at->stretch = hfx_stretch(target->to_shape + 16 * row, 4);
  at->has_turns = 0;
  at->is_same = before->row == row - 1 && at->shape.kind == target->kinds[row - 1] &&
                at->shape.half == target->halves[row - 1] && at->shape.mesh == target->meshes[row - 1];
  at->moved = INFINITY;
  now->floor = -INFINITY, now->ceiling = INFINITY;
  if (!at->cluster) return;
  hfx_find_spread(at->cluster, at->bones, row, &now->spread);
  double clear = clear_of(at, at->shape, now->spread.middle), radius = now->spread.radius;
  double spare = SPARE * (fabs(clear) + 1.0 + radius);
  now->floor = clear - radius - spare, now->ceiling = clear + radius + spare;
  if (at->is_same && steps < 2) at->moved = hfx_moved(at->cluster, at->bones, row - 1, row);
}

// Position of the vertex of a cell of a pair. `own` poses it where it is no unit, else that is NULL.
static void find_vertex(look *at, const hfx_cluster *own, side *now, int64_t row, int64_t cell,
                        double vertex[3]) {
  const hfx_surface_places *given = at->given;
  if (own) {
    hfx_pose_one(own, at->bones, row, cell, vertex);
    at->posed++;
  } else if (given && given->own) {
    int64_t from = given->at[row] * given->cell_count + at->table->cell_starts[at->number] + cell;
    hfx_moved_by(at->target->body_to_shape + 16 * row, given->own + 3 * from, vertex);
    at->posed++;
  } else
    memcpy(vertex, place_of(at, now, cell), 3 * sizeof *vertex);
}

// Share of a cell of a pair that is inside. `has_own`: its vertex is no unit.
static double inside(look *at, const hfx_cluster *own, int has_own, int64_t row, side *now, int64_t cell,
                     int64_t from, int64_t to, int how, int may) {
  if (how == HFX_WHOLE) return 1.0;
  if (how == HFX_NOT || !((how == HFX_BY_VERTEX && has_own) || (may & INSIDE))) return 0.0;
  if (how == HFX_BY_VERTEX && !has_own) return weight_of(at, place_of(at, now, cell));
  if (how == HFX_BY_VERTEX) {
    double vertex[3];
    find_vertex(at, own, now, row, cell, vertex);
    return weight_of(at, vertex);
  }
  double share = 0.0;
  int told = -1;
  for (int64_t u = from; u < to; u++) share += cover(at, now, u, from, to, &told);
  return share > WHOLE ? 1.0 : share;
}

// Details of a contact begin with the place of its vertex. Its samples are asked for where that is
// outside.
static void begin_details(look *at, const hfx_cluster *own, side *now, int64_t row, int64_t cell,
                          int64_t contact) {
  double *vertex = at->details->places + 3 * contact;
  find_vertex(at, own, now, row, cell, vertex);
  at->contact = weight_of(at, vertex) > 0.0 ? -1 : contact;
  at->began = INFINITY;
}

// Details of its beginning, if anything was entered.
static void end_details(const look *at, int64_t contact) {
  const hfx_details *details = at->details;
  details->since[contact] = at->began;
  memcpy(details->entries + 3 * contact, at->entry, sizeof at->entry);
  memcpy(details->ways + 3 * contact, at->way, sizeof at->way);
}

// Contact weights of pairs; what is less than what is there already is left out.
//
// `own` poses the vertices of cells where these are not units of the surface; else it is NULL.
// `room` has space for 27 bones + 2 (6 places + 3 units + cells) + 2 doubles of the largest cluster,
// `events` for twice the most samples of a cell.
HFX_EXPORT void hfx_narrow_phase(const hfx_pairs *pairs, const hfx_table *table,
                                 const hfx_cluster *clusters, const hfx_cluster *own,
                                 const hfx_bones *bones, const hfx_surface_places *given,
                                 const hfx_target *target, const hfx_drift *drift, hfx_found *found,
                                 hfx_details *details, double *room, event *events) {
  hfx_search search = {.at = 0};
  look at = {.table = table, .target = target, .bones = bones, .given = given, .on_the_way_of = -1};
  at.search = &search;
  at.steepest = hfx_steepest(target), at.details = details, at.contact = -1;
  at.limit = target->is_flat ? 0.0 : target->amplitude / at.steepest;
  side sides[2], *now = &sides[0], *before = &sides[1];
  widest most;
  int64_t has_sides = 0;
  int has_own = own || (given && given->own);
  for (int64_t p = 0; p < pairs->count; p++) {
    int64_t c = pairs->clusters[p], row = pairs->rows[p], steps = pairs->steps[p];
    int64_t units = table->unit_counts[c];
    int64_t first_cell = table->cell_starts[c], cells = table->cell_starts[c + 1] - first_cell;
    int how = pairs->how[p], is_followed = steps > 0;
    int is_last = p + 1 == pairs->count || pairs->clusters[p + 1] != c || !pairs->steps[p + 1];
    if (p == 0 || c != pairs->clusters[p - 1]) {
      at.number = c, at.first = table->starts[c];
      at.cluster = clusters ? clusters + c : NULL;
      has_sides = 0;
    }
    at.shape = hfx_shape_at(target, row);
    // True if what is inside, or what passed, asks for units.
    int asks = how == HFX_COVERED || (how == HFX_BY_VERTEX && !has_own);
    int is_kept = is_followed || !is_last || details;
    if (asks || is_kept) {
      if (!has_sides) make_sides(&at, room, sides, &most), find_widest(&at, units, &most);
      has_sides = 1;
      side *swapped = before;
      before = now, now = swapped;
      turn_to_pair(&at, before, now, p, row, steps);
      if (asks || is_followed) asks = !is_apart(&at, before, now, &most, is_followed);
      for (int64_t u = 0; !asks && u < units; u++) now->least[u] = now->floor, now->most[u] = now->ceiling;
      if (asks) find_gaps(&at, now);
      if (asks && is_followed) find_gaps(&at, before);
    }
    if (how == HFX_WHOLE && !asks && !is_kept) {
      const int64_t *columns = found->column_of + first_cell;
      for (int64_t k = 0; k < cells; k++) store(found, columns[k] + row * found->columns, 1.0);
      continue;
    }
    int64_t to = 0;
    for (int64_t k = 0; k < cells; k++) {
      int64_t from = to, column = found->column_of[first_cell + k] + row * found->columns;
      while (asks && to < units && table->cell_of[at.first + to] == first_cell + k) to++;
      int may = asks ? may_be(&at, before, now, from, to, is_followed) : 0;
      if (details && (may || how >= HFX_BY_VERTEX))
        begin_details(&at, own ? own + c : NULL, now, row, k, column);
      double share = inside(&at, own ? own + c : NULL, has_own, row, now, k, from, to, how, may);
      if (share != 0.0) store(found, column, share);
      if (asks || is_kept) now->weights[k] = loaded(found, column);
      if (!(may & PASSED) || before->weights[k] != 0.0) continue;
      if (!details && !(now->weights[k] < 1.0)) continue;
      if (now->weights[k] != 0.0) at.contact = -1;  // its place is that of now
      int told[2] = {-1, -1};
      int64_t count = 0;
      for (int64_t u = from; u < to; u++)
        count = follow(&at, before, now, u, from, to, steps, drift, told, events, count);
      if (details && count) end_details(&at, column);
      double peak = count ? peak_of(events, count) : 0.0;
      if (peak > now->weights[k]) store(found, column, peak);
    }
  }
  found->posed += at.posed;
}
