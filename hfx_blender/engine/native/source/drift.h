// SPDX-License-Identifier: GPL-3.0-or-later
// Motion of points that rest in a body's frame, in a volume's space from one row to the next. See
// drift_of in engine/contact/continuous_collision.py.

#ifndef HFX_DRIFT_H
#define HFX_DRIFT_H

#include "analytic.h"
#include "broad.h"

// Positions of a point after each of some steps of an interval, (steps + 1, 3): at both ends, and
// from place `low` to `high`. `from_before` and `from_after` are (steps + 1, intervals, 4, 4); a straight way, of
// one step, asks for none.
static inline void hfx_path(const double *from_before, const double *from_after, int64_t intervals,
                            int64_t interval, int64_t steps, int64_t low, int64_t high,
                            const double before[3], const double after[3], double path[][3]) {
  for (int i = 0; i < 3; i++) path[0][i] = before[i], path[steps][i] = after[i];
  for (int64_t k = low > 1 ? low : 1; k < steps && k <= high; k++) {
    double share = (double)k / (double)steps;
    const double *one = from_before + 16 * (k * intervals + interval);
    const double *other = from_after + 16 * (k * intervals + interval);
    for (int i = 0; i < 3; i++)
      path[k][i] = (1.0 - share) * (hfx_dot(one + 4 * i, before) + one[4 * i + 3]) +
                   share * (hfx_dot(other + 4 * i, after) + other[4 * i + 3]);
  }
}

#endif
