// SPDX-License-Identifier: GPL-3.0-or-later
// Volumes in their own space: unit shapes with a formula, as engine/volume/analytic.py has them, and
// meshes, of which this file knows the box. What is not a number is outside, and never parted.

#ifndef HFX_ANALYTIC_H
#define HFX_ANALYTIC_H

#include <math.h>
#include <stdint.h>

#include "mesh.h"
#include "numbers.h"
#include "pairs_of_numbers.h"

enum { HFX_CUBOID, HFX_SPHERE, HFX_CYLINDER, HFX_CAPSULE, HFX_MESH };

typedef struct {
  int64_t kind;
  double half;           // of the capsule's segment
  const hfx_mesh *mesh;  // or NULL
} hfx_shape;

static inline double hfx_clip(double value, double low, double high) {
  return value < low ? low : (value > high ? high : value);
}

static inline double hfx_largest(const double p[3]) {
  return hfx_larger(hfx_larger(fabs(p[0]), fabs(p[1])), fabs(p[2]));
}

static inline double hfx_dot(const double *a, const double *b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static inline double hfx_dot2(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1]; }

// Squared distance from the capsule's segment.
static inline double hfx_from_segment(double half, const double p[3]) {
  double beyond = hfx_larger(fabs(p[2]) - half, 0.0);
  return p[0] * p[0] + p[1] * p[1] + beyond * beyond;
}

// Gauge of a place: 1 on the boundary, less inside.
static inline double hfx_share(hfx_shape shape, const double p[3]) {
  switch (shape.kind) {
    case HFX_CUBOID: return hfx_largest(p);
    case HFX_SPHERE: return sqrt(hfx_dot(p, p));
    case HFX_CYLINDER: return hfx_larger(sqrt(hfx_dot2(p, p)), fabs(p[2]));
    default: return sqrt(hfx_from_segment(shape.half, p));
  }
}

// Gauges of two places, x, y and z of both; `is_sign_enough`: only whether they are above 1 has to be
// right, so that squares may stand for them.
static inline hfx_two hfx_gauges(hfx_shape shape, const hfx_two p[3], int64_t is_sign_enough) {
  hfx_two high = hfx_sizes(p[2]), squared = p[0] * p[0] + p[1] * p[1];
  switch (shape.kind) {
    case HFX_CUBOID: return hfx_larger_two(hfx_larger_two(hfx_sizes(p[0]), hfx_sizes(p[1])), high);
    case HFX_SPHERE: squared += p[2] * p[2]; break;
    case HFX_CYLINDER: return hfx_larger_two(is_sign_enough ? squared : hfx_roots(squared), high);
    default: {
      hfx_two beyond = hfx_larger_two(high - shape.half, (hfx_two){0.0, 0.0});
      squared += beyond * beyond;
    }
  }
  return is_sign_enough ? squared : hfx_roots(squared);
}

static inline int hfx_contains(hfx_shape shape, const double p[3]) {
  switch (shape.kind) {
    case HFX_CUBOID: return hfx_largest(p) <= 1.0;
    case HFX_SPHERE: return hfx_dot(p, p) <= 1.0;
    case HFX_CYLINDER: return hfx_dot2(p, p) <= 1.0 && fabs(p[2]) <= 1.0;
    default: return hfx_from_segment(shape.half, p) <= 1.0;
  }
}

// Time inside of something that moves straight: from 0 at the start to 1 at the end.
typedef struct {
  double first, last;
} hfx_times;

static const hfx_times HFX_NEVER = {INFINITY, -INFINITY};

static inline hfx_times hfx_unless_empty(hfx_times t) { return t.first <= t.last ? t : HFX_NEVER; }

static inline hfx_times hfx_both(hfx_times a, hfx_times b) {
  hfx_times both = {hfx_larger(a.first, b.first), hfx_smaller(a.last, b.last)};
  return both;
}

static inline hfx_times hfx_within_planes(double start, double way, double half) {
  hfx_times t;
  if (way == 0.0) {
    int outside = fabs(start) > half;
    t.first = outside ? INFINITY : -INFINITY;
    t.last = -t.first;
    return t;
  }
  double one = (-half - start) / way, other = (half - start) / way;
  t.first = hfx_smaller(one, other);
  t.last = hfx_larger(one, other);
  return t;
}

static inline hfx_times hfx_within_ball(const double *start, const double *way, int dimensions) {
  double squared = 0.0, along = 0.0, aside = 0.0;
  for (int i = 0; i < dimensions; i++) squared += way[i] * way[i];
  double speed = sqrt(squared);
  int still = speed == 0.0;
  double direction[3];
  for (int i = 0; i < dimensions; i++) {
    direction[i] = way[i] / (still ? 1.0 : speed);
    along += start[i] * direction[i];
  }
  for (int i = 0; i < dimensions; i++) {
    double each = start[i] - along * direction[i];
    aside += each * each;
  }
  double left = 1.0 - aside;
  if (!(left >= 0.0)) return HFX_NEVER;
  hfx_times t = {-INFINITY, INFINITY};
  if (still) return t;
  double half = sqrt(left);
  t.first = (-along - half) / speed;
  t.last = (-along + half) / speed;
  return t;
}

static inline hfx_times hfx_passage(hfx_shape shape, const double start[3], const double end[3]) {
  double way[3] = {end[0] - start[0], end[1] - start[1], end[2] - start[2]};
  hfx_times t;
  switch (shape.kind) {
    case HFX_CUBOID:
      t = hfx_within_planes(start[0], way[0], 1.0);
      t = hfx_both(t, hfx_within_planes(start[1], way[1], 1.0));
      t = hfx_both(t, hfx_within_planes(start[2], way[2], 1.0));
      break;
    case HFX_SPHERE: t = hfx_within_ball(start, way, 3); break;
    case HFX_CYLINDER:
      t = hfx_both(hfx_within_ball(start, way, 2), hfx_within_planes(start[2], way[2], 1.0));
      break;
    default: {
      double half = shape.half;
      t = hfx_both(hfx_within_ball(start, way, 2), hfx_within_planes(start[2], way[2], half));
      t = hfx_unless_empty(t);
      for (int end_of = 0; end_of < 2; end_of++) {
        double from[3] = {start[0], start[1], start[2] - (end_of ? -half : half)};
        hfx_times ball = hfx_unless_empty(hfx_within_ball(from, way, 3));
        t.first = hfx_smaller(t.first, ball.first);
        t.last = hfx_larger(t.last, ball.last);
      }
    }
  }
  t.first = hfx_larger(t.first, 0.0);
  t.last = hfx_smaller(t.last, 1.0);
  return hfx_unless_empty(t);
}

// Vector from the nearest place of the volume to a point, of any length; 0 inside.
static inline void hfx_away(hfx_shape shape, const double p[3], double away[3]) {
  switch (shape.kind) {
    case HFX_SPHERE:
      for (int i = 0; i < 3; i++) away[i] = p[i];
      return;
    case HFX_CAPSULE:
      away[0] = p[0], away[1] = p[1];
      away[2] = p[2] - hfx_clip(p[2], -shape.half, shape.half);
      return;
    case HFX_CYLINDER: {
      double around = sqrt(hfx_dot2(p, p)), part = hfx_larger(1.0 - 1.0 / around, 0.0);
      away[0] = p[0] * part, away[1] = p[1] * part;
      away[2] = p[2] - hfx_clip(p[2], -1.0, 1.0);
      return;
    }
    case HFX_MESH:
      for (int i = 0; i < 3; i++)
        away[i] = p[i] - hfx_clip(p[i], shape.mesh->grid->box[i], shape.mesh->grid->box[3 + i]);
      return;
    default:
      for (int i = 0; i < 3; i++) away[i] = p[i] - hfx_clip(p[i], -1.0, 1.0);
  }
}

// The most of a direction that any place of the volume has.
static inline double hfx_farthest(hfx_shape shape, const double d[3]) {
  switch (shape.kind) {
    case HFX_SPHERE: return sqrt(hfx_dot(d, d));
    case HFX_CAPSULE: return sqrt(hfx_dot(d, d)) + shape.half * fabs(d[2]);
    case HFX_CYLINDER: return sqrt(hfx_dot2(d, d)) + fabs(d[2]);
    case HFX_MESH: {
      double sum = 0.0;
      for (int i = 0; i < 3; i++)
        sum += hfx_larger(d[i] * shape.mesh->grid->box[i], d[i] * shape.mesh->grid->box[3 + i]);
      return sum;
    }
    default: return fabs(d[0]) + fabs(d[1]) + fabs(d[2]);
  }
}

// True if a plane surely parts the hull of some corners from the volume.
static inline int hfx_parted(hfx_shape shape, const double (*corners)[3], int count, double margin) {
  double middle[3], away[3], share = 1.0 / count;
  for (int i = 0; i < 3; i++) {
    middle[i] = corners[0][i];
    for (int k = 1; k < count; k++) middle[i] += corners[k][i];
    middle[i] *= share;
  }
  hfx_away(shape, middle, away);
  double nearest = hfx_dot(away, corners[0]);
  for (int k = 1; k < count; k++) nearest = hfx_smaller(nearest, hfx_dot(away, corners[k]));
  double limit = hfx_farthest(shape, away) + margin * sqrt(hfx_dot(away, away));
  return nearest - limit > 1e-12 * (fabs(nearest) + fabs(limit));
}

#endif
