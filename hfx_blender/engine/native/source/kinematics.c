// SPDX-License-Identifier: GPL-3.0-or-later
// Bones that follow their channels and their parents.

#include <math.h>
#include <stdint.h>

#include "hfx_native.h"

// Rotation matrices (n, 3, 3) of quaternions (n, 4) w, x, y, z of any length; one of length 0 is
// half a turn about X.
HFX_EXPORT void hfx_from_quaternions(int64_t count, const double *quaternions, double *turned) {
  for (int64_t n = 0; n < count; n++, quaternions += 4, turned += 9) {
    double w = quaternions[0], x = quaternions[1], y = quaternions[2], z = quaternions[3];
    double length = sqrt(((w * w + x * x) + y * y) + z * z);
    if (length > 0)
      w /= length, x /= length, y /= length, z /= length;
    else
      w = 0, x = 1, y = 0, z = 0;
    turned[0] = 1 - 2 * (y * y + z * z);
    turned[1] = 2 * (x * y - w * z);
    turned[2] = 2 * (x * z + w * y);
    turned[3] = 2 * (x * y + w * z);
    turned[4] = 1 - 2 * (x * x + z * z);
    turned[5] = 2 * (y * z - w * x);
    turned[6] = 2 * (x * z - w * y);
    turned[7] = 2 * (y * z + w * x);
    turned[8] = 1 - 2 * (x * x + y * y);
  }
}

// The product of two affine matrices (3, 4).
static void product(const double *first, const double *second, double *found) {
  for (int r = 0; r < 3; r++) {
    const double *row = first + 4 * r;
    for (int c = 0; c < 4; c++)
      found[4 * r + c] = (row[0] * second[c] + row[1] * second[4 + c]) + row[2] * second[8 + c];
    found[4 * r + 3] += row[3];
  }
}

// Skinning matrices (times, bones, 3, 4) of locations and scales (times, bones, 3) and rotations
// (times, bones, 3, 3). `rest` and `inverse` (bones, 3, 4) are of the rest pose. Bones are gone
// through in `order`, in which parents, -1 for none, come first.
HFX_EXPORT void hfx_rig_pose(int64_t times, int64_t bones, const int64_t *order,
                             const int64_t *parents, const double *rest, const double *inverse,
                             const double *locations, const double *turned, const double *scales,
                             double *skinning) {
  for (int64_t t = 0; t < times; t++) {
    for (int64_t k = 0; k < bones; k++) {
      int64_t bone = order[k];
      double channels[12], half[12], moved[12];
      for (int r = 0; r < 3; r++) {
        for (int c = 0; c < 3; c++)
          channels[4 * r + c] = turned[9 * bone + 3 * r + c] * scales[3 * bone + c];
        channels[4 * r + 3] = locations[3 * bone + r];
      }
      product(rest + 12 * bone, channels, half);
      double *own = skinning + 12 * bone;
      if (parents[bone] < 0)
        product(half, inverse + 12 * bone, own);
      else {
        product(half, inverse + 12 * bone, moved);
        product(skinning + 12 * parents[bone], moved, own);
      }
    }
    locations += 3 * bones, turned += 9 * bones, scales += 3 * bones, skinning += 12 * bones;
  }
}
