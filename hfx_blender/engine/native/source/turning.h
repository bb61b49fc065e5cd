// SPDX-License-Identifier: GPL-3.0-or-later
// Stretch and rotation of directions by a matrix. See
// engine/kinematics/placement_motion.py.

#ifndef HFX_TURNING_H
#define HFX_TURNING_H

#include <math.h>

#include "analytic.h"

#define HFX_JACOBI_TURNS 30  // it arrives after five or so
#define HFX_STILL 1e-9       // radians; less is rounding
#define HFX_FLAT 1e-12       // of the largest stretch: less is rounding

// Jacobi's one-sided method: turns the columns of a matrix, `a`, among each other until they are at
// right angles, and `v` with them if it is there: then a_k = M v_k.
static inline void hfx_square_up(double a[3][3], double v[3][3]) {
  for (int turn = 0; turn < HFX_JACOBI_TURNS; turn++) {
    int is_done = 1;
    for (int p = 0; p < 2; p++)
      for (int q = p + 1; q < 3; q++) {
        double pp = hfx_dot(a[p], a[p]), qq = hfx_dot(a[q], a[q]), pq = hfx_dot(a[p], a[q]);
        if (!(fabs(pq) > 1e-15 * sqrt(pp * qq))) continue;
        is_done = 0;
        double ratio = (qq - pp) / (2.0 * pq);
        double t = (ratio >= 0.0 ? 1.0 : -1.0) / (fabs(ratio) + sqrt(1.0 + ratio * ratio));
        double c = 1.0 / sqrt(1.0 + t * t), s = c * t;
        for (int i = 0; i < 3; i++) {
          double one = a[p][i], other = a[q][i];
          a[p][i] = c * one - s * other, a[q][i] = s * one + c * other;
          if (!v) continue;
          one = v[p][i], other = v[q][i];
          v[p][i] = c * one - s * other, v[q][i] = s * one + c * other;
        }
      }
    if (is_done) break;
  }
}

static inline void hfx_cross(const double a[3], const double b[3], double found[3]) {
  for (int i = 0; i < 3; i++)
    found[i] = a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3];
}

// Any unit vector that is perpendicular to a unit vector.
static inline void hfx_find_perpendicular(const double vector[3], double found[3]) {
  double axis[3] = {0.0, 0.0, 0.0};
  axis[fabs(vector[0]) < 0.6 ? 0 : 1] = 1.0;
  hfx_cross(vector, axis, found);
  double size = sqrt(hfx_dot(found, found));
  for (int i = 0; i < 3; i++) found[i] /= size;
}

// See motion._polar: how a placement (4, 4) turns; a mirroring is left out. Where it flattens to
// less than a plane, any of the ways that do the same.
static inline void hfx_rotation_of(const double *matrix, double found[3][3]) {
  double a[3][3], v[3][3] = {{1.0, 0.0, 0.0}, {0.0, 1.0, 0.0}, {0.0, 0.0, 1.0}}, sizes[3], scale = 0.0;
  for (int i = 0; i < 12; i++)
    if (i % 4 < 3) scale = fmax(scale, fabs(matrix[i]));
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < 3; j++) a[j][i] = scale > 0.0 ? matrix[4 * i + j] / scale : 0.0;
  hfx_square_up(a, v);
  int longest = 0, shortest = 0;
  for (int k = 0; k < 3; k++) {
    sizes[k] = sqrt(hfx_dot(a[k], a[k]));
    if (sizes[k] > sizes[longest]) longest = k;
  }
  shortest = (longest + 1) % 3;
  if (sizes[(longest + 2) % 3] < sizes[shortest]) shortest = (longest + 2) % 3;
  int middle = 3 - longest - shortest;
  for (int k = 0; k < 3; k++)
    for (int i = 0; i < 3; i++) a[k][i] = sizes[k] > 0.0 ? a[k][i] / sizes[k] : 0.0;
  double least = HFX_FLAT * sizes[longest];
  if (!(sizes[longest] > 0.0)) a[longest][0] = 1.0;
  if (!(sizes[middle] > least)) hfx_find_perpendicular(a[longest], a[middle]);
  int is_flat = !(sizes[shortest] > least);
  if (is_flat) hfx_cross(a[longest], a[middle], a[shortest]);
  double across[3];
  hfx_cross(a[0], a[1], across);
  double handed = hfx_dot(across, a[2]);
  hfx_cross(v[0], v[1], across);
  double sign = handed * hfx_dot(across, v[2]) < 0.0 ? -1.0 : 1.0;
  if (is_flat) {  // has no side that could be mirrored
    for (int i = 0; i < 3; i++) a[shortest][i] *= sign;
    sign = 1.0;
  }
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < 3; j++)
      found[i][j] = sign * (a[0][i] * v[0][j] + a[1][i] * v[1][j] + a[2][i] * v[2][j]);
}

// See motion.turned_by: by how much a placement (4, 4) turns to become another, radians; exactly 0
// where it does not.
static inline double hfx_turned_by(const double *before, const double *after) {
  int is_still = 1;
  for (int i = 0; i < 12; i++) is_still &= i % 4 == 3 || before[i] == after[i];
  if (is_still) return 0.0;
  double one[3][3], other[3][3], turn[3][3];
  hfx_rotation_of(before, one), hfx_rotation_of(after, other);
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < 3; j++) turn[i][j] = hfx_dot(other[i], one[j]);
  double skew[3] = {turn[2][1] - turn[1][2], turn[0][2] - turn[2][0], turn[1][0] - turn[0][1]};
  double cosine = 0.5 * (turn[0][0] + turn[1][1] + turn[2][2] - 1.0);
  double angle = atan2(0.5 * sqrt(hfx_dot(skew, skew)), cosine);
  return angle > HFX_STILL ? angle : 0.0;
}

#endif
