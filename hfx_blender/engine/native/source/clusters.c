// SPDX-License-Identifier: GPL-3.0-or-later
// Splits the vertices of a model into compact clusters. See engine/native/cluster_bounds.py.

#include <string.h>

#include "hfx_native.h"

// Sorts by the upper half, and else keeps the order.
static void sort(int64_t count, uint64_t *values, uint64_t *room) {
  int64_t ends[4][256] = {{0}};
  for (int64_t k = 0; k < count; k++)
    for (int byte = 0; byte < 4; byte++) ends[byte][values[k] >> (32 + 8 * byte) & 255]++;
  uint64_t *from = values, *to = room;
  for (int byte = 0; byte < 4; byte++) {
    int shift = 32 + 8 * byte;
    if (ends[byte][from[0] >> shift & 255] == count) continue;  // all have the same
    for (int64_t k = 0, total = 0; k < 256; k++) {
      int64_t first = total;
      total += ends[byte][k];
      ends[byte][k] = first;
    }
    for (int64_t k = 0; k < count; k++) to[ends[byte][from[k] >> shift & 255]++] = from[k];
    uint64_t *sorted = to;
    to = from;
    from = sorted;
  }
  if (from != values) memcpy(values, from, (size_t)count * sizeof *values);
}

// A number that is larger where a value is; both zeros have the same.
static uint64_t rank(float value) {
  uint32_t bits;
  value += 0.0f;
  memcpy(&bits, &value, sizeof bits);
  return bits >> 31 ? ~bits : bits | UINT32_C(1) << 31;
}

static int longest_axis(const float *vertices, const int32_t *ids, int64_t count) {
  float low[3], high[3];
  for (int i = 0; i < 3; i++) low[i] = high[i] = vertices[3 * ids[0] + i];
  for (int64_t k = 1; k < count; k++)
    for (int i = 0; i < 3; i++) {
      float value = vertices[3 * (int64_t)ids[k] + i];
      if (value < low[i]) low[i] = value;
      if (value > high[i]) high[i] = value;
    }
  int axis = 0;
  for (int i = 1; i < 3; i++)
    if (high[i] - low[i] > high[axis] - low[axis]) axis = i;
  return axis;
}

// Halves pieces of `ids` at the median of their longest axis until each is small enough, and sorts
// them. `todo` has the ends of the pieces, the first last, and room for 64 more; `load` may be null:
// each vertex is 1. Writes the ends of all pieces and returns how many there are. `room` holds two
// numbers for each id.
HFX_EXPORT int64_t hfx_split(int64_t pieces, int64_t *todo, int32_t *ids, const float *vertices,
                             const int64_t *load, int64_t leaf_size, int64_t *ends, uint64_t *room) {
  int64_t first = 0, found = 0, size = pieces ? todo[0] : 0;
  while (pieces) {
    int64_t count = todo[pieces - 1] - first, total = load ? 0 : count;
    int32_t *some = ids + first;
    for (int64_t k = 0; load && k < count; k++) total += load[some[k]];
    int is_leaf = count <= 1 || total <= leaf_size;
    int axis = is_leaf ? 0 : longest_axis(vertices, some, count);
    for (int64_t k = 0; k < count; k++) {
      uint64_t key = is_leaf ? (uint64_t)some[k] : rank(vertices[3 * (int64_t)some[k] + axis]);
      room[k] = key << 32 | (uint32_t)some[k];
    }
    if (count > 1) sort(count, room, room + size);
    for (int64_t k = 0; k < count; k++) some[k] = (int32_t)(uint32_t)room[k];
    if (is_leaf) {
      first = ends[found++] = todo[--pieces];
    } else {
      todo[pieces++] = first + count / 2;
    }
  }
  return found;
}
