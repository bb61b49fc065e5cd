// SPDX-License-Identifier: GPL-3.0-or-later
// A quad of skin, and where its samples are; see engine/skin/skin_table.py.

#ifndef HFX_SKIN_QUAD_H
#define HFX_SKIN_QUAD_H

#include <math.h>
#include <stdint.h>

#include "numbers.h"

#define MOST_DIVIDED 256.0
#define ROUNDING 1e-9

// Coefficients that place samples in a quad; see Quads.
typedef struct {
  double edge, other, inner, inner_2;
  double area, by_s, by_t;         // of a sample, as shares of the cell
  double to_one, to_two, between;  // bulges, none where it does not count
} hfx_quad;

// A sample: shares of the ways to both other corners, height, share of the cell's area.
typedef struct {
  double one, other, height, share;
} hfx_sample;

static inline hfx_sample hfx_sample_at(const hfx_quad *quad, double s, double t) {
  hfx_sample at;
  at.one = s * (1.0 - t) * quad->edge + s * t * quad->inner;
  at.other = (1.0 - s) * t * quad->other + s * t * quad->inner_2;
  at.height = (1.0 - at.one - at.other) * (at.one * quad->to_one + at.other * quad->to_two) +
              at.one * at.other * quad->between;
  at.share = quad->area + s * quad->by_s + t * quad->by_t;
  return at;
}

// The highest place of the triangle of a quad, as a share of its normal: a third of the largest bulge, as all
// three edges meet in the middle.
static inline double hfx_height(const hfx_quad *quad) {
  return hfx_larger(hfx_larger(fabs(quad->to_one), fabs(quad->to_two)), fabs(quad->between)) / 3.0;
}

// Diagonals of the parts of a quad at its corners, times the steps, as shares of its triangle's edges.
static inline void hfx_diagonals(const hfx_quad *quad, double steps, double ways[4][2]) {
  double most = 1.0 - 0.5 / steps, less = 1.0 - most, more = 1.0 + most;
  double edge = quad->edge, other = quad->other, inner = quad->inner, inner_2 = quad->inner_2;
  double all[4][2] = {{edge * most + inner * less, other * most + inner_2 * less},
                      {inner * more - edge * most, inner_2 * more - other * most},
                      {edge * less + inner * most, inner_2 * most - other * more},
                      {edge * more - inner * most, -other * less - inner_2 * most}};
  for (int k = 0; k < 8; k++) ways[k / 2][k % 2] = all[k / 2][k % 2];
}

// No less than hfx_diagonal over the square of the triangle's longest edge. Shares of both edges that have one
// sign add up; else they are a share of the third edge, and what is left of one.
static inline double hfx_longest(const hfx_quad *quad, double steps) {
  double ways[4][2], longest = 0.0;
  hfx_diagonals(quad, steps, ways);
  for (int k = 0; k < 4; k++) {
    double one = ways[k][0], two = ways[k][1];
    double share = one * two > 0.0 ? fabs(one + two) : hfx_larger(fabs(one), fabs(two));
    longest = hfx_larger(longest, share * share);
  }
  return longest * (1.0 + ROUNDING);
}

// The longest diagonal of any part of a quad divided so, times the steps, squared. `squares` are the squared
// lengths of its triangle's edges and, between, their product. The place for (s, t) is linear in either, so
// that the way from a part's sample to its corner is half a step times the sum, or the difference, of both
// derivatives halfway there. Over the quad these are longest at its corners; halfway is a quarter of a step
// inside.
static inline double hfx_diagonal(const hfx_quad *quad, const double squares[3], double steps) {
  double ways[4][2], longest = 0.0;
  hfx_diagonals(quad, steps, ways);
  for (int k = 0; k < 4; k++) {
    double one = ways[k][0], two = ways[k][1];
    double squared = one * one * squares[0] + 2.0 * one * two * squares[1] + two * two * squares[2];
    longest = hfx_larger(longest, squared);
  }
  return longest;
}

// Parts along each side of a quad, so that no place of a part is farther than the distance from the sample
// in its middle; no more than MOST_DIVIDED. Parts are skewed where a pose stretches the triangle; it does so
// by one matrix, so that the squares tell all. `longest` is the diagonal for steps without end.
static inline double hfx_steps_within(const hfx_quad *quad, const double squares[3], double longest,
                                      double distance) {
  double steps = 1.0;
  for (int k = 0; k < 2; k++) {
    double diagonal = k ? hfx_diagonal(quad, squares, steps) : longest;
    steps = ceil(sqrt(diagonal) / (2.0 * distance) - ROUNDING);
    steps = steps > 1.0 ? steps : 1.0;
  }
  return steps < MOST_DIVIDED ? steps : MOST_DIVIDED;
}

#endif
