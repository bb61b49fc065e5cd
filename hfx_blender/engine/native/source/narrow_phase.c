// SPDX-License-Identifier: GPL-3.0-or-later
// Narrow phase: the share of each cell of skin inside a volume, and of what passed since the row before.
// Defined in engine/reference.

#include <string.h>

#include "hfx_native.h"
#include "continuous_collision.h"
#include "posed_pair.h"

// Contact weights, the result, and memory to work in.
typedef struct {
  void *weights;              // (rows, columns); what is less than what is there is left out
  const int64_t *column_of;   // of cells
  int64_t columns, is_single;
  int64_t posed;              // number of places posed, counted up
  double *room;               // 26 bones + 2 (6 places + 3 units + cells) + units + 2 of the largest cluster
  event *events;              // twice the most samples of a cell
} hfx_found;

// Source of the positions of skin: matrices of bones, or known places.
typedef struct {
  const hfx_table *table;
  const hfx_cluster *clusters;          // NULL where places are known
  const hfx_cluster *own;               // poses vertices of cells that are no units; or NULL
  const hfx_bones *bones;
  const hfx_surface_places *surface;
} hfx_posing;

// The same share, of the samples at rest and a volume with a formula: two samples at once.
static double sampled_by_formula(const context *ctx, int64_t quad, const triangle *t) {
  const hfx_table *table = ctx->table;
  const double *samples = table->blocks[ctx->number] + table->sample_starts[quad];
  int64_t room = table->rooms[ctx->number], count = table->steps[quad] * table->steps[quad];
  double sum = 0.0;
  for (int64_t k = 0; k < count; k += 2) {
    int64_t next = k + 1 < count ? k + 1 : k;  // no sample comes after the last: its share is 0
    hfx_two points[3], shares = {samples[3 * room + k], next > k ? samples[3 * room + next] : 0.0};
    hfx_two one = {samples[k], samples[next]}, other = {samples[room + k], samples[room + next]};
    hfx_two height = {samples[2 * room + k], samples[2 * room + next]};
    for (int i = 0; i < 3; i++)
      points[i] = t->edges[0][i] * one + t->corners[0][i] + t->edges[1][i] * other + t->normal[i] * height;
    hfx_two weights = weights_of_two(ctx, points) * shares;
    sum += weights[0];
    sum += weights[1];
  }
  return sum;
}

// The weighted share of a cell that samples of a quad make, `steps` both ways.
static double sampled(context *ctx, int64_t quad, int64_t steps, const triangle *t) {
  if (steps == ctx->table->steps[quad] && !ctx->shape.mesh && !ctx->details)
    return sampled_by_formula(ctx, quad, t);
  double points[TOGETHER_AT_ONCE][3], shares[TOGETHER_AT_ONCE], weights[TOGETHER_AT_ONCE], sum = 0.0;
  for (int64_t first = 0; first < steps * steps; first += TOGETHER_AT_ONCE) {
    int64_t count = steps * steps - first;
    if (count > TOGETHER_AT_ONCE) count = TOGETHER_AT_ONCE;
    for (int64_t k = 0; k < count; k++) {
      hfx_sample s = sample_of(ctx, quad, steps, first + k);
      place_sample(&s, t, points[k]);
      shares[k] = s.share;
    }
    weigh(ctx, (const double(*)[3])points, count, weights);
    for (int64_t k = 0; k < count; k++) sum += weights[k] * shares[k];
    for (int64_t k = 0; ctx->details && k < count; k++)
      if (weights[k] > 0.0) record_inside(ctx, points[k]);
  }
  return sum;
}

// Test whether the share of a unit differs over its skin, so that samples have to be taken; -1: the
// unit is outside.
static int needs_samples(context *ctx, posed_pair *pair, int64_t unit, int64_t from, int64_t to,
                         double at_vertex, int is_searched, int *is_even) {
  const hfx_target *target = ctx->target;
  double gap = pair->clearance[unit];
  double bound = ctx->cluster ? pair->gaps[unit] * ctx->table->reaches[ctx->first + unit]
                              : reach_of(ctx, pair, unit);
  int near = gap >= -bound;
  if (target->is_flat) {
    double reach = near ? hfx_smaller(reach_of(ctx, pair, unit), bound) : 0.0;
    if (near && gap > reach) return -1;
    return (near && gap >= -reach) || is_searched;
  }
  // The strength of a volume with falloff changes with depth, unless it is deep enough.
  double most = most_gap(ctx, pair, unit) * ctx->table->reaches[ctx->first + unit];
  if (!ctx->cluster) most = bound;
  int varies = ctx->steepest * most > target->amplitude && at_vertex > 0.0;
  near |= varies && -gap < target->share + most;
  return near && !is_unit_even(ctx, pair, unit, from, to, is_even);
}

// The weighted share of a cell that a quad makes beside its unit's vertex.
static double cover_quad(context *ctx, posed_pair *pair, int64_t unit, int64_t q, int is_searched) {
  triangle t;
  find_corners(ctx, pair, unit, q, &t);
  double deepest = pair->clearance[unit], shallowest = deepest;
  for (int k = 0; k < 2; k++) {
    double clearance = pair->clearance[ctx->table->around[2 * q + k] - ctx->first];
    deepest = hfx_larger(deepest, clearance), shallowest = hfx_smaller(shallowest, clearance);
  }
  // With a corner inside no plane parts triangle and volume. Else a cheap bound of the bulge is
  // tried first, then the bulge itself, which needs normals.
  int may_be_apart = !(shallowest <= 0.0);
  // All corners deeper than the triangle bulges: the quad is inside as a whole.
  int may_be_whole = ctx->target->is_flat && !is_searched && !ctx->shape.mesh;
  double bound = bulge_bound(ctx, pair, unit, &t);
  if (may_be_apart && hfx_parted(ctx->shape, (const double(*)[3])t.corners, 3, bound)) return 0.0;
  if (may_be_whole && deepest <= -bound) return ctx->table->wholes[q];
  find_edges(ctx, pair, &t);
  if (may_be_apart && t.bulge < bound && hfx_parted(ctx->shape, (const double(*)[3])t.corners, 3, t.bulge))
    return 0.0;
  if (may_be_whole && deepest <= -t.bulge) return ctx->table->wholes[q];
  return sampled(ctx, q, steps_of(ctx, pair, q, &t), &t);
}

// The share of a cell that is inside and falls to one of its units.
static double cover(context *ctx, posed_pair *pair, int64_t unit, int64_t from, int64_t to, int *is_even) {
  const hfx_table *table = ctx->table;
  const hfx_target *target = ctx->target;
  int64_t place = ctx->first + unit;
  // Cheap tests first, on bounds: no place is posed for skin that is surely outside or inside.
  double bound = ctx->cluster ? pair->gaps[unit] * table->reaches[place] : reach_of(ctx, pair, unit);
  if (!(pair->least[unit] <= bound)) return 0.0;
  // A contact whose vertex is outside has its place at the deepest of all its samples.
  int is_searched = target->is_flat && ctx->details && ctx->contact >= 0;
  if (target->is_flat && table->is_split && !is_searched && pair->most[unit] < -bound)
    return table->unit_shares[place];
  const double *vertex = place_of(ctx, pair, unit);
  double gap = pair->clearance[unit];
  if (!(gap <= bound)) return 0.0;
  int is_formula = !target->is_flat && !ctx->shape.mesh;  // that falls off with the clearance
  double at_vertex = is_formula ? strength_of(target, -gap) : weight_of(ctx, vertex);
  if (at_vertex > 0.0) record_inside(ctx, vertex);
  int near = table->is_split ? needs_samples(ctx, pair, unit, from, to, at_vertex, is_searched, is_even) : 0;
  if (near < 0) return 0.0;
  if (!near) return at_vertex * table->unit_shares[place];
  gap_of(ctx, pair, unit);  // poses all around it
  double sum = at_vertex * table->vertex_shares[place];
  for (int64_t q = table->quad_starts[place]; q < table->quad_starts[place + 1]; q++)
    sum += cover_quad(ctx, pair, unit, q, is_searched);
  return sum;
}

// Stores a weight; returns it as it is stored.
static inline double store(const hfx_found *found, int64_t at, double weight) {
  if (!found->is_single) return ((double *)found->weights)[at] = weight;
  return ((float *)found->weights)[at] = (float)weight;
}

enum { INSIDE = 1, PASSED = 2 };

// Bounds of the clearances of a pair's units, and the states that each may have: inside at the pair, or
// passed on the way from the one before it. Without a branch, so that several are computed at once.
static void find_states(const context *ctx, const posed_pair *before, posed_pair *now, int64_t units,
                        int is_followed, int64_t *restrict states) {
  const double *restrict reaches = ctx->table->reaches + ctx->first, *restrict gaps = now->gaps;
  const double *restrict earlier_gaps = is_followed ? before->gaps : gaps;
  const double *restrict earlier_least = before->least, *restrict earlier_most = before->most;
  double *restrict least = now->least, *restrict most = now->most;
  double moved = ctx->moved, floor = now->floor, ceiling = now->ceiling;
  int64_t passed = is_followed ? PASSED : 0;
  for (int64_t u = 0; u < units; u++) {
    double bound = hfx_larger(earlier_gaps[u], gaps[u]) * reaches[u];
    double since = earlier_least[u] - moved - SPARE * (fabs(earlier_least[u]) + moved);
    double until = earlier_most[u] + moved + SPARE * (fabs(earlier_most[u]) + moved);
    least[u] = since > floor ? since : floor;
    most[u] = until < ceiling ? until : ceiling;
    states[u] = (since > bound ? 0 : passed) | (least[u] > bound ? 0 : INSIDE);
  }
}

// True if no cell of a cluster can be inside at a pair, nor, if followed, have passed since the one before.
static int is_apart(const context *ctx, const posed_pair *before, const posed_pair *now, int is_followed) {
  if (!ctx->cluster) return 0;
  const double *most = ctx->cluster->farthest;
  double floor = now->floor, along = now->spread.along;
  if (is_followed) {
    along = hfx_larger(along, before->spread.along);
    floor = hfx_smaller(floor, before->floor - ctx->moved - SPARE * (fabs(before->floor) + ctx->moved));
  }
  double reach = along * most[0];
  for (int64_t b = 0; b < ctx->cluster->bone_count; b++) {
    double apart = now->spread.apart[b];
    if (is_followed) apart = hfx_larger(apart, before->spread.apart[b]);
    reach += apart * most[1 + b];
  }
  return floor > reach * SLACK * SLACK;
}

// Resets the state of a cluster's pairs.
static void reset_pairs(const context *ctx, double *room, posed_pair both[2], int64_t **states) {
  const hfx_table *table = ctx->table;
  int64_t c = ctx->number, places = table->place_counts[c], units = table->unit_counts[c];
  int64_t cells = table->cell_starts[c + 1] - table->cell_starts[c];
  int64_t bones = ctx->cluster ? ctx->cluster->bone_count : 0;
  room = (double *)(((uintptr_t)room + 15) & ~(uintptr_t)15);
  for (int k = 0; k < 2; k++) both[k].matrices = (hfx_two *)take(&room, 12 * bones);
  *states = (int64_t *)take(&room, units);
  for (int k = 0; k < 2; k++) {
    posed_pair *each = both + k;
    each->spread.apart = take(&room, bones);
    each->points = take(&room, 3 * places);
    each->clearance = take(&room, places);
    each->exact_gaps = take(&room, places);
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

// Begins the next pair of a cluster.
static void begin_pair(context *ctx, const posed_pair *before, posed_pair *now, int64_t pair,
                       int64_t row, int64_t steps) {
  const hfx_target *target = ctx->target;
  now->row = row, now->pair = pair, now->has_matrices = now->has_gaps = now->has_metric = now->has_turns = 0;
  now->skew = -1.0;
  ctx->is_same = before->row == row - 1 && ctx->shape.kind == target->kinds[row - 1] &&
                ctx->shape.half == target->halves[row - 1] && ctx->shape.mesh == target->meshes[row - 1];
  ctx->moved = INFINITY;
  now->floor = -INFINITY, now->ceiling = INFINITY;
  if (!ctx->cluster) return;
  hfx_find_spread(ctx->cluster, ctx->bones, row, &now->spread);
  double clearance = clearance_of(ctx, ctx->shape, now->spread.middle), radius = now->spread.radius;
  double spare = SPARE * (fabs(clearance) + 1.0 + radius);
  now->floor = clearance - radius - spare, now->ceiling = clearance + radius + spare;
  if (ctx->is_same && steps < 2) ctx->moved = hfx_moved(ctx->cluster, ctx->bones, row - 1, row);
}

// Position of the vertex of a cell of a pair. `own` poses it where it is no unit, else that is NULL.
static void find_vertex(context *ctx, const hfx_cluster *own, posed_pair *now, int64_t row, int64_t cell,
                        double vertex[3]) {
  const hfx_surface_places *surface = ctx->surface;
  if (own) {
    hfx_pose_one(own, ctx->bones, row, cell, vertex);
    ctx->posed++;
  } else if (surface && surface->own) {
    int64_t from = surface->at[row] * surface->cell_count + ctx->table->cell_starts[ctx->number] + cell;
    hfx_moved_by(ctx->target->body_to_shape + 16 * row, surface->own + 3 * from, vertex);
    ctx->posed++;
  } else
    memcpy(vertex, place_of(ctx, now, cell), 3 * sizeof *vertex);
}

// Share of a cell of a pair that is inside. `has_own`: its vertex is no unit.
static double inside(context *ctx, const hfx_cluster *own, int has_own, int64_t row, posed_pair *now,
                     int64_t cell, int64_t from, int64_t to, int how, int64_t possible) {
  if (how == HFX_WHOLE) return 1.0;
  if (how == HFX_NOT || !((how == HFX_BY_VERTEX && has_own) || (possible & INSIDE))) return 0.0;
  if (how == HFX_BY_VERTEX && !has_own) return weight_of(ctx, place_of(ctx, now, cell));
  if (how == HFX_BY_VERTEX) {
    double vertex[3];
    find_vertex(ctx, own, now, row, cell, vertex);
    return weight_of(ctx, vertex);
  }
  double share = 0.0;
  int is_even = -1;
  for (int64_t u = from; u < to; u++) share += cover(ctx, now, u, from, to, &is_even);
  return share > WHOLE ? 1.0 : share;
}

// Details begin with the place of a contact's vertex. Its samples are recorded where that is outside.
static void begin_details(context *ctx, const hfx_cluster *own, posed_pair *now, int64_t row, int64_t cell,
                          int64_t contact) {
  double *vertex = ctx->details->places + 3 * contact;
  find_vertex(ctx, own, now, row, cell, vertex);
  ctx->contact = weight_of(ctx, vertex) > 0.0 ? -1 : contact;
  ctx->began = INFINITY;
}

// Details of its beginning, if anything was entered.
static void end_details(const context *ctx, int64_t contact) {
  const hfx_details *details = ctx->details;
  details->since[contact] = ctx->began;
  memcpy(details->entries + 3 * contact, ctx->entry, sizeof ctx->entry);
  memcpy(details->ways + 3 * contact, ctx->way, sizeof ctx->way);
}

// One call of the narrow phase.
typedef struct {
  context *ctx;
  const hfx_pairs *pairs;
  const hfx_posing *posing;
  const hfx_drift *drift;
  const hfx_found *found;
  posed_pair both[2], *now, *before;
  int64_t *states;  // (units,) of now
  int is_reset;  // both pairs belong to the present cluster
  int has_own;   // vertices of cells are no units
} search_call;

// Task of a pair: the cluster, its row, and the results that are needed.
typedef struct {
  int64_t pair, row, steps, units, first_cell, cells;
  const hfx_cluster *own;
  int how, is_followed;
  int needs_units;  // what is inside, or what passed, is found unit by unit
  int is_kept;      // the next pair, or details, need its positions
} pair_task;

static pair_task task_of(const search_call *call, int64_t p) {
  const hfx_pairs *pairs = call->pairs;
  const hfx_table *table = call->posing->table;
  int64_t c = pairs->clusters[p], next = p + 1;
  pair_task task = {.pair = p, .row = pairs->rows[p], .steps = pairs->steps[p], .how = pairs->how[p]};
  task.units = table->unit_counts[c];
  task.first_cell = table->cell_starts[c], task.cells = table->cell_starts[c + 1] - task.first_cell;
  task.own = call->posing->own ? call->posing->own + c : NULL;
  task.is_followed = task.steps > 0;
  int is_last = next == pairs->count || pairs->clusters[next] != c || !pairs->steps[next];
  task.needs_units = task.how == HFX_COVERED || (task.how == HFX_BY_VERTEX && !call->has_own);
  task.is_kept = task.is_followed || !is_last || call->ctx->details;
  return task;
}

static void begin_cluster(search_call *call, int64_t first) {
  const hfx_pairs *pairs = call->pairs;
  int64_t cluster = pairs->clusters[first];
  const hfx_cluster *clusters = call->posing->clusters;
  call->ctx->number = cluster, call->ctx->first = call->posing->table->starts[cluster];
  call->ctx->cluster = clusters ? clusters + cluster : NULL;
  call->is_reset = 0;
}

// Bounds of the distances of a pair's units; decides whether they have to be looked at one by one.
static void bound_units(search_call *call, pair_task *task) {
  context *ctx = call->ctx;
  if (!call->is_reset) reset_pairs(ctx, call->found->room, call->both, &call->states);
  call->is_reset = 1;
  posed_pair *swapped = call->before;
  call->before = call->now, call->now = swapped;
  posed_pair *before = call->before, *now = call->now;
  begin_pair(ctx, before, now, task->pair, task->row, task->steps);
  if (task->needs_units || task->is_followed)
    task->needs_units = !is_apart(ctx, before, now, task->is_followed);
  for (int64_t u = 0; !task->needs_units && u < task->units; u++)
    now->least[u] = now->floor, now->most[u] = now->ceiling;
  if (task->needs_units) find_gaps(ctx, now);
  if (task->needs_units && task->is_followed) find_gaps(ctx, before);
  if (task->needs_units) find_states(ctx, before, now, task->units, task->is_followed, call->states);
}

// Weights of a pair whose cells are all inside.
static void fill_whole(const search_call *call, const pair_task *task) {
  const hfx_found *found = call->found;
  const int64_t *columns = found->column_of + task->first_cell;
  for (int64_t k = 0; k < task->cells; k++)
    store(found, columns[k] + task->row * found->columns, 1.0);
}

// Raises the weight of a cell that was touched between a pair and the one before it.
static void follow_cell(search_call *call, const pair_task *task, int64_t cell, int64_t from, int64_t to,
                        int64_t column) {
  context *ctx = call->ctx;
  posed_pair *before = call->before, *now = call->now;
  event *events = call->found->events;
  if (before->weights[cell] != 0.0) return;
  if (!ctx->details && !(now->weights[cell] < 1.0)) return;
  if (now->weights[cell] != 0.0) ctx->contact = -1;  // its place is that of now
  int are_even[2] = {-1, -1};
  int64_t count = 0;
  for (int64_t u = from; u < to; u++)
    count = follow(ctx, before, now, u, from, to, task->steps, call->drift, are_even, events, count);
  if (ctx->details && count) end_details(ctx, column);
  double peak = count ? peak_of(events, count) : 0.0;
  if (peak > now->weights[cell]) store(call->found, column, peak);
}

// Weight of a cell of a pair, whose units are `from` to `to`.
static inline void weigh_cell(search_call *call, const pair_task *task, int64_t cell, int64_t from, int64_t to,
                              int64_t possible) {
  context *ctx = call->ctx;
  const hfx_found *found = call->found;
  posed_pair *now = call->now;
  int64_t column = found->column_of[task->first_cell + cell] + task->row * found->columns;
  if (ctx->details) begin_details(ctx, task->own, now, task->row, cell, column);
  double share = inside(ctx, task->own, call->has_own, task->row, now, cell, from, to, task->how, possible);
  if (share != 0.0) share = store(found, column, share);
  if (task->is_kept) now->weights[cell] = share;
  if (possible & PASSED) follow_cell(call, task, cell, from, to, column);
}

// Poses the units of a pair that `cover` needs, all in one loop, which is faster than when they are needed.
static void pose_units(context *ctx, posed_pair *now, int64_t units, const int64_t *states) {
  const double *reaches = ctx->table->reaches + ctx->first;
  int may_be_whole = ctx->target->is_flat && ctx->table->is_split && !ctx->details;
  for (int64_t u = 0; u < units; u++) {
    double bound = now->gaps[u] * reaches[u];
    if (!(states[u] & INSIDE) || !(now->least[u] <= bound) || (may_be_whole && now->most[u] < -bound)) continue;
    place_of(ctx, now, u);
  }
}

// Weights of the cells of a pair, one by one.
static void weigh_cells(search_call *call, const pair_task *task) {
  int64_t first = task->first_cell, units = task->needs_units ? task->units : 0, to = 0;
  const int64_t *cell_of = call->ctx->table->cell_of + call->ctx->first, *states = call->states;
  if (task->how >= HFX_BY_VERTEX) {
    for (int64_t k = 0; k < task->cells; k++) {
      int64_t from = to, possible = 0;
      for (; to < units && cell_of[to] == first + k; to++) possible |= states[to];
      weigh_cell(call, task, k, from, to, possible);
    }
    return;
  }
  if (task->is_kept) memset(call->now->weights, 0, (size_t)task->cells * sizeof *call->now->weights);
  if (task->how == HFX_COVERED && call->ctx->cluster) pose_units(call->ctx, call->now, units, states);
  for (int64_t u = 0; u < units; u = to > u ? to : u + 1) {
    if (!states[u]) continue;
    int64_t cell = cell_of[u], from = u, possible = states[u];
    while (from > 0 && cell_of[from - 1] == cell) from--;
    for (to = u + 1; to < units && cell_of[to] == cell; to++) possible |= states[to];
    weigh_cell(call, task, cell - first, from, to, possible);
  }
}

// Contact weights of pairs. `details` may be NULL.
HFX_EXPORT void hfx_narrow_phase(const hfx_pairs *pairs, const hfx_posing *posing,
                                 const hfx_target *target, const hfx_drift *drift, hfx_found *found,
                                 hfx_details *details) {
  hfx_search search = {.at = 0};
  context ctx = {.table = posing->table, .target = target, .bones = posing->bones,
                 .surface = posing->surface, .on_the_way_of = -1};
  ctx.search = &search;
  ctx.steepest = hfx_steepest(target), ctx.details = details, ctx.contact = -1;
  ctx.limit = target->is_flat ? 0.0 : target->amplitude / ctx.steepest;
  search_call call = {.ctx = &ctx, .pairs = pairs, .posing = posing, .drift = drift, .found = found};
  call.now = &call.both[0], call.before = &call.both[1];
  call.has_own = posing->own || (posing->surface && posing->surface->own);
  for (int64_t p = 0; p < pairs->count; p++) {
    pair_task task = task_of(&call, p);
    if (p == 0 || pairs->clusters[p] != pairs->clusters[p - 1]) begin_cluster(&call, p);
    ctx.shape = hfx_shape_at(target, task.row);
    if (task.needs_units || task.is_kept) bound_units(&call, &task);
    if (task.how == HFX_WHOLE && !task.needs_units && !task.is_kept)
      fill_whole(&call, &task);
    else
      weigh_cells(&call, &task);
  }
  found->posed += ctx.posed;
}
