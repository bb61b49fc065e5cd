// SPDX-License-Identifier: GPL-3.0-or-later
// Rotation angles between placements.

#include "turning.h"

#include "hfx_native.h"

// By how much each of some placements (count, 4, 4) turns to become another, (count,).
HFX_EXPORT void hfx_turns(int64_t count, const double *before, const double *after, double *angles) {
  for (int64_t n = 0; n < count; n++) angles[n] = hfx_turned_by(before + 16 * n, after + 16 * n);
}
