// SPDX-License-Identifier: GPL-3.0-or-later
// Sets of vertices as their changes from one to the next, for a track.

#include <stdint.h>

#include "hfx_native.h"

// Ids that enter or leave at each set, and how much each weight differs from the same vertex's
// weight before. Sets ascend, from no set at first; `last` (one for each vertex) is 0 at first.
// Returns the number of toggles: at most twice as many as vertices.
HFX_EXPORT int64_t hfx_track_changes(int64_t sets, const int64_t *sizes, const int32_t *vertices,
                                     const uint8_t *weights, uint8_t *last, int32_t *counts,
                                     int32_t *gaps, uint8_t *changes) {
  const int32_t *before = vertices;
  int64_t before_size = 0, total = 0;
  for (int64_t s = 0; s < sets; s++) {
    int64_t size = sizes[s], i = 0, j = 0, first = total;
    int32_t id = 0;
    while (i < before_size || j < size) {
      int32_t toggled;
      if (i == before_size || (j < size && vertices[j] < before[i]))
        toggled = vertices[j++];
      else if (j == size || before[i] < vertices[j])
        toggled = before[i++];
      else {
        i++, j++;
        continue;
      }
      gaps[total++] = toggled - id;
      id = toggled;
    }
    counts[s] = (int32_t)(total - first);
    for (int64_t k = 0; k < size; k++) {
      changes[k] = (uint8_t)(weights[k] - last[vertices[k]]);
      last[vertices[k]] = weights[k];
    }
    before = vertices, before_size = size;
    vertices += size, weights += size, changes += size;
  }
  return total;
}

// Tests each set but the first for the vertices and weights of the one before.
HFX_EXPORT void hfx_track_repeats(int64_t sets, const int64_t *offsets, const int32_t *vertices,
                                  const void *weights, int64_t width, uint8_t *repeats) {
  const uint8_t *bytes = weights;
  for (int64_t s = 1; s < sets; s++) {
    int64_t first = offsets[s], before = offsets[s - 1], size = offsets[s + 1] - first;
    int64_t same = size == first - before;
    for (int64_t k = 0; same && k < size; k++) same = vertices[first + k] == vertices[before + k];
    for (int64_t k = 0; same && k < size * width; k++)
      same = bytes[first * width + k] == bytes[before * width + k];
    repeats[s] = (uint8_t)same;
  }
}
