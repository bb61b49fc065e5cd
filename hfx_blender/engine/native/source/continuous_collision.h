// SPDX-License-Identifier: GPL-3.0-or-later
// Continuous collision detection between a row and the next: samples of skin move straight in the
// space of a volume, in as many steps as its turning asks for, and each step is tested exactly.

#ifndef HFX_PASSING_H
#define HFX_PASSING_H

#include "posed_pair.h"

#define STEP_KINDS 7  // powers of two up to MOST_STEPS
#define PLACES_ALONG 5

// Motion of points that rest in a body's frame, in 2^k steps of each interval; see drift_of in
// engine/contact/narrow_phase.py.
typedef struct {
  const double *before[STEP_KINDS];  // (steps + 1, rows - 1, 4, 4)
  const double *after[STEP_KINDS];
  int64_t intervals;
} hfx_drift;

typedef struct {
  double when, change;  // of how much is inside
} event;

#define EVERY_STEP (~(uint64_t)0)

// Positions of a point after each of some steps of an interval, (steps + 1, 3): at both ends, and around
// the first to the last of the `open` steps, which has a bit for each. One step asks for no drift.
static inline void path_of(const hfx_drift *drift, int64_t steps, int kind, int64_t interval,
                           uint64_t open, const double before[3], const double after[3],
                           double path[][3]) {
  int64_t low = 0, high = steps - 1;
  while (low < high && !(open >> low & 1)) low++;
  while (low < high && !(open >> high & 1)) high--;
  for (int i = 0; i < 3; i++) path[0][i] = before[i], path[steps][i] = after[i];
  for (int64_t k = low > 1 ? low : 1; k < steps && k <= high + 1; k++) {
    double share = (double)k / (double)steps;
    const double *one = drift->before[kind] + 16 * (k * drift->intervals + interval);
    const double *other = drift->after[kind] + 16 * (k * drift->intervals + interval);
    for (int i = 0; i < 3; i++)
      path[k][i] = (1.0 - share) * (hfx_dot(one + 4 * i, before) + one[4 * i + 3]) +
                   share * (hfx_dot(other + 4 * i, after) + other[4 * i + 3]);
  }
}

// The step of a way at a share of its time.
static inline int64_t step_at(int64_t steps, double share) {
  int64_t step = (int64_t)(share * (double)steps);
  return step < 0 ? 0 : (step > steps - 1 ? steps - 1 : step);
}

// Position on a path at a share of its time.
static inline void along(const double (*path)[3], int64_t steps, double share, double p[3]) {
  int64_t step = step_at(steps, share);
  for (int i = 0; i < 3; i++)
    p[i] = path[step][i] + (share * (double)steps - (double)step) * (path[step + 1][i] - path[step][i]);
}

// Tests if a ball on a path may meet the volume. Every shape holds the unit
// ball, so that within a factor 1 + r of it is all that is nearer than r.
static inline int may_meet(hfx_shape shape, const double (*path)[3], int64_t steps, double reach) {
  if (shape.mesh) return hfx_mesh_nears(shape.mesh, path, steps, reach);
  double share = 1.0 / (1.0 + reach);
  for (int64_t k = 0; k < steps; k++) {
    double start[3], end[3];
    for (int i = 0; i < 3; i++) start[i] = path[k][i] * share, end[i] = path[k + 1][i] * share;
    hfx_times t = hfx_passage(shape, start, end);
    if (t.first <= t.last) return 1;
  }
  return 0;
}

// First and last time at which a point on a path is inside a formula's volume, in `open` steps, a bit each.
static inline void pass(hfx_shape shape, const double (*path)[3], int64_t steps, uint64_t open,
                        double times[2]) {
  int64_t begin = 0;
  for (; begin < steps && times[0] == INFINITY; begin++) {
    if (!(open >> begin & 1)) continue;
    hfx_times t = hfx_passage(shape, path[begin], path[begin + 1]);
    if (!(t.first <= t.last)) continue;
    times[0] = ((double)begin + t.first) / (double)steps;
    times[1] = ((double)begin + t.last) / (double)steps;
  }
  for (int64_t k = steps - 1; k >= begin; k--) {  // from the end: what is between does not matter
    if (!(open >> k & 1)) continue;
    hfx_times t = hfx_passage(shape, path[k], path[k + 1]);
    if (!(t.first <= t.last)) continue;
    times[1] = ((double)k + t.last) / (double)steps;
    break;
  }
}

// Adds when something on a path was inside. The number of events then.
static inline int64_t enter(context *ctx, const double (*path)[3], int64_t steps, uint64_t open,
                     double share, event *events, int64_t count) {
  double times[2] = {INFINITY, -INFINITY};
  if (ctx->shape.mesh)
    hfx_mesh_passage(ctx->shape.mesh, path, steps, open, times);
  else
    pass(ctx->shape, path, steps, open, times);
  double first = times[0], last = times[1], strength = 1.0;
  if (first == INFINITY) return count;
  if (!ctx->target->is_flat) {
    strength = 0.0;
    for (int k = 0; k < PLACES_ALONG; k++) {
      double p[3];
      along(path, steps, first + (double)k / (PLACES_ALONG - 1) * (last - first), p);
      double here = weight_of(ctx, p);
      if (here > strength) strength = here;
    }
  }
  if (ctx->details) {
    double middle[3];
    along(path, steps, 0.5 * (first + last), middle);
    record_inside(ctx, middle);
    if (first < ctx->began) {
      int64_t step = step_at(steps, first);
      ctx->began = first;
      along(path, steps, first, ctx->entry);
      for (int i = 0; i < 3; i++) ctx->way[i] = (path[step + 1][i] - path[step][i]) * (double)steps;
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

static inline void sift(event *events, int64_t root, int64_t count) {
  event moved = events[root];
  for (int64_t child; (child = 2 * root + 1) < count; root = child) {
    if (child + 1 < count && is_before(events[child], events[child + 1])) child++;
    if (!is_before(moved, events[child])) break;
    events[root] = events[child];
  }
  events[root] = moved;
}

// The most that was inside at one moment. Events come in pairs: in, and out.
static inline double peak_of(event *events, int64_t count) {
  double latest = -INFINITY, earliest = INFINITY, all = 0.0;
  for (int64_t k = 0; k < count; k += 2) {
    latest = hfx_larger(latest, events[k].when), earliest = hfx_smaller(earliest, events[k + 1].when);
    all += events[k].change;
  }
  if (latest <= earliest) return all > WHOLE ? 1.0 : all;  // all are inside at once
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

// Upper bounds of the stretch of points on the way to each end of a step, (steps + 1,).
static inline const double *stretches_of(context *ctx, const hfx_drift *drift, int64_t steps, int kind,
                                         int64_t interval) {
  double *stretches = ctx->on_the_way;
  if (ctx->on_the_way_of == interval * STEP_KINDS + kind) return stretches;
  ctx->on_the_way_of = interval * STEP_KINDS + kind;
  for (int64_t k = 0; k <= steps; k++) {
    int64_t matrix = 16 * (k * drift->intervals + interval);
    stretches[k] = hfx_larger(hfx_stretch(drift->before[kind] + matrix, 4),
                              hfx_stretch(drift->after[kind] + matrix, 4));
  }
  return stretches;
}

// Steps, one bit each, in which skin of a quad may meet the volume, between its triangles `a` and `b`
// at both rows. At the end of a step each flat place of it is in the triangle of its corners there: a
// plane beside the volume that parts the corners of both ends from it, parts all of the step. Skin
// bulges no farther than its height, stretched as the corners are.
static inline uint64_t open_steps(context *ctx, const hfx_drift *drift, int64_t steps, int kind,
                                  int64_t interval, const triangle *a, const triangle *b) {
  double path[3][MOST_STEPS + 1][3], margins[MOST_STEPS + 1];
  for (int c = 0; c < 3; c++)
    path_of(drift, steps, kind, interval, EVERY_STEP, a->corners[c], b->corners[c], path[c]);
  double height = hfx_larger(a->bulge, b->bulge);
  const double *stretches = height > 0.0 ? stretches_of(ctx, drift, steps, kind, interval) : NULL;
  for (int64_t k = 0; k <= steps; k++) margins[k] = stretches ? height * stretches[k] : 0.0;
  uint64_t open = 0;
  for (int64_t k = 0; k < steps; k++) {
    double ends[6][3];
    for (int c = 0; c < 6; c++)
      for (int i = 0; i < 3; i++) ends[c][i] = path[c % 3][k + c / 3][i];
    double margin = hfx_larger(margins[k], margins[k + 1]);
    if (!hfx_parted(ctx->shape, (const double(*)[3])ends, 6, margin)) open |= (uint64_t)1 << k;
  }
  return open;
}

// True if a quad's skin, which bulges so far, surely stays outside on a straight way. Nothing parts them if
// a corner is inside.
static inline int stays_outside(const context *ctx, const posed_pair *before, const posed_pair *now,
                                int64_t unit, int64_t quad, const triangle *a, const triangle *b,
                                double bulge) {
  const hfx_table *table = ctx->table;
  double shallowest = hfx_smaller(before->clearance[unit], now->clearance[unit]), corners[6][3];
  for (int k = 0; k < 2; k++) {
    int64_t corner = table->around[2 * quad + k] - ctx->first;
    shallowest = hfx_smaller(shallowest, hfx_smaller(before->clearance[corner], now->clearance[corner]));
  }
  if (shallowest <= 0.0) return 0;
  for (int k = 0; k < 3; k++)
    for (int i = 0; i < 3; i++) corners[k][i] = a->corners[k][i], corners[3 + k][i] = b->corners[k][i];
  return hfx_parted(ctx->shape, (const double(*)[3])corners, 6, bulge);
}

// Adds the entries of a quad of a unit between a pair and the next; returns the number of events.
static inline int64_t follow_quad(context *ctx, posed_pair *before, posed_pair *now, int64_t unit, int64_t quad,
                                  int64_t steps, int kind, const hfx_drift *drift, event *events,
                                  int64_t count) {
  int64_t interval = now->row - 1;
  uint64_t open = EVERY_STEP;
  triangle a, b;
  find_corners(ctx, before, unit, quad, &a);
  find_corners(ctx, now, unit, quad, &b);
  double bound = hfx_larger(bulge_bound(ctx, before, unit, &a), bulge_bound(ctx, now, unit, &b));
  if (steps == 1 && stays_outside(ctx, before, now, unit, quad, &a, &b, bound)) return count;
  // Samples of the start stand outwards as the skin did there.
  find_edges(ctx, before, &a);
  find_edges(ctx, now, &b);
  double bulge = hfx_larger(a.bulge, b.bulge);
  if (steps == 1 && bulge < bound && stays_outside(ctx, before, now, unit, quad, &a, &b, bulge)) return count;
  if (steps > 1) open = open_steps(ctx, drift, steps, kind, interval, &a, &b);
  if (!open) return count;
  int64_t number = steps_of(ctx, before, quad, &a), later = steps_of(ctx, now, quad, &b);
  number = number > later ? number : later;
  for (int64_t k = 0; k < number * number; k++) {
    hfx_sample s = sample_of(ctx, quad, number, k);
    double start[3], end[3], path[MOST_STEPS + 1][3];
    place_sample(&s, &a, start);
    place_sample(&s, &b, end);
    path_of(drift, steps, kind, interval, ctx->details ? EVERY_STEP : open, start, end, path);
    count = enter(ctx, (const double(*)[3])path, steps, open, s.share, events, count);
  }
  return count;
}

// Adds the entries of a unit between a pair and the next; returns the number of events.
static int64_t follow(context *ctx, posed_pair *before, posed_pair *now, int64_t unit, int64_t from, int64_t to,
                      int64_t steps, const hfx_drift *drift, int are_even[2], event *events,
                      int64_t count) {
  const hfx_table *table = ctx->table;
  int64_t place = ctx->first + unit, interval = now->row - 1;
  int kind = 0;
  while (((int64_t)1 << kind) < steps) kind++;
  double path[MOST_STEPS + 1][3];
  // On a straight way of length l between clearances a and b, clearance is nowhere less than
  // (a + b - l) / 2.
  double bound = hfx_larger(before->gaps[unit], now->gaps[unit]);
  bound *= 2.0 * table->reaches[place];
  if (!ctx->cluster) bound = 2.0 * hfx_larger(reach_of(ctx, before, unit), reach_of(ctx, now, unit));
  int is_straight = steps == 1 && ctx->is_same;
  if (is_straight) {
    double least = before->least[unit] + now->least[unit];
    if (least - ctx->moved > bound + SPARE * (fabs(least) + ctx->moved)) return count;
  }
  const double *one = place_of(ctx, before, unit), *other = place_of(ctx, now, unit);
  if (is_straight) {
    double clearance = before->clearance[unit] + now->clearance[unit];
    double way[3] = {other[0] - one[0], other[1] - one[1], other[2] - one[2]};
    double length = sqrt(hfx_dot(way, way)), spare = SPARE * (fabs(clearance) + length);
    if (clearance - length > bound + spare) return count;
  }
  path_of(drift, steps, kind, interval, EVERY_STEP, one, other, path);
  if (!may_meet(ctx->shape, (const double(*)[3])path, steps, 0.5 * bound)) return count;
  double reach = hfx_larger(reach_of(ctx, before, unit), reach_of(ctx, now, unit));
  if (reach < 0.5 * bound && !may_meet(ctx->shape, (const double(*)[3])path, steps, reach)) return count;
  int is_even = is_unit_even(ctx, now, unit, from, to, &are_even[1]) &&
                is_unit_even(ctx, before, unit, from, to, &are_even[0]);
  double share = is_even ? table->unit_shares[place] : table->vertex_shares[place];
  count = enter(ctx, (const double(*)[3])path, steps, EVERY_STEP, share, events, count);
  if (is_even || !table->is_split) return count;
  for (int64_t q = table->quad_starts[place]; q < table->quad_starts[place + 1]; q++)
    count = follow_quad(ctx, before, now, unit, q, steps, kind, drift, events, count);
  return count;
}

#endif
