// SPDX-License-Identifier: GPL-3.0-or-later
// From pairs to contacts: which vertices have weights, and their lists row by row.

#include <stdint.h>
#include <string.h>

#include "hfx_native.h"

// Vertices of the clusters that occur in pairs, ascending, and where each cell's is among them.
// The number of them. `is_needed` (clusters,) and `place` (vertices,) are room.
HFX_EXPORT int64_t hfx_columns(int64_t pairs, const int64_t *clusters, int64_t cluster_count,
                               const int64_t *cell_starts, int64_t cell_count,
                               const int32_t *vertex_of, uint8_t *is_needed, int64_t *place,
                               int32_t *columns, int64_t *column_of) {
  for (int64_t c = 0; c < cluster_count; c++) is_needed[c] = 0;
  for (int64_t v = 0; v < cell_count; v++) place[v] = -1;
  for (int64_t p = 0; p < pairs; p++) is_needed[clusters[p]] = 1;
  for (int64_t c = 0; c < cluster_count; c++)
    for (int64_t k = cell_starts[c]; is_needed[c] && k < cell_starts[c + 1]; k++)
      place[vertex_of[k]] = 0;
  int64_t count = 0;
  for (int64_t v = 0; v < cell_count; v++)
    if (place[v] == 0) place[v] = count, columns[count++] = (int32_t)v;
  for (int64_t c = 0; c < cluster_count; c++)
    for (int64_t k = cell_starts[c]; is_needed[c] && k < cell_starts[c + 1]; k++)
      column_of[k] = place[vertex_of[k]];
  return count;
}

#define TOGETHER 64  // columns: where all are 0, none is looked at one by one, and no memory is written

static inline int64_t end_of(int64_t from, int64_t columns) {
  return columns - from < TOGETHER ? columns : from + TOGETHER;
}

// `whole` is an integer as large as a weight.
#define GATHERING(name, real, whole)                                                               \
  static int any_##name(const real *weights, int64_t from, int64_t to) {                           \
    whole any = 0;                                                                                 \
    for (int64_t k = from; k < to; k++) any |= weights[k] != 0;                                    \
    return any != 0;                                                                               \
  }                                                                                                \
  static int differ_##name(const real *weights, const real *before, int64_t from, int64_t to) {    \
    whole any = 0;                                                                                 \
    for (int64_t k = from; k < to; k++) any |= weights[k] != before[k];                            \
    return any != 0;                                                                               \
  }                                                                                                \
  static void clear_##name(real *weights, int64_t columns) {                                       \
    for (int64_t k = 0; weights && k < columns; k += TOGETHER)                                     \
      if (any_##name(weights, k, end_of(k, columns)))                                              \
        memset(weights + k, 0, (size_t)(end_of(k, columns) - k) * sizeof(real));                   \
  }                                                                                                \
  static void gather_##name(int64_t rows, int64_t columns, real *weights, const uint8_t *reported, \
                            const int32_t *vertices, int64_t own_sets, int64_t *at, int64_t *sets, \
                            int64_t *offsets, int32_t *found, real *values, int64_t *counts) {     \
    real *before = 0;                                                                              \
    int64_t felt = 0, set = 0, total = 0;                                                          \
    offsets[0] = 0;                                                                                \
    for (int64_t n = 0; n < rows; n++, weights += columns) {                                       \
      int64_t first = 0;                                                                           \
      while (first < columns && !any_##name(weights, first, end_of(first, columns)))               \
        first += TOGETHER;                                                                         \
      if (first >= columns) continue;                                                              \
      if (!reported[n]) {                                                                          \
        clear_##name(weights, columns);                                                            \
        continue;                                                                                  \
      }                                                                                            \
      int changed = !before || own_sets;                                                           \
      for (int64_t k = 0; !changed && k < columns; k += TOGETHER)                                  \
        changed = differ_##name(weights, before, k, end_of(k, columns));                           \
      clear_##name(before, columns);                                                               \
      before = weights;                                                                            \
      for (int64_t from = first; changed && from < columns; from += TOGETHER) {                    \
        if (!any_##name(weights, from, end_of(from, columns))) continue;                           \
        for (int64_t k = from; k < end_of(from, columns); k++) {                                   \
          found[total] = vertices[k], values[total] = weights[k];                                  \
          total += weights[k] != 0; /* without a branch: there is room for all */                  \
        }                                                                                          \
      }                                                                                            \
      if (changed) offsets[++set] = total;                                                         \
      at[felt] = n, sets[felt++] = set - 1;                                                        \
    }                                                                                              \
    clear_##name(before, columns);                                                                 \
    counts[0] = felt, counts[1] = set, counts[2] = total;                                          \
  }

GATHERING(single, float, int32_t)
GATHERING(double, double, int64_t)

// Rows with any weight, ascending, and which set of vertices each has: a new one where it differs
// from that of the row before, or `own_sets` says so. `offsets` (rows + 1,) are where sets begin among
// the vertices found and their values, (rows * columns,). How many rows, sets and vertices there are.
// Weights are all 0 then.
HFX_EXPORT void hfx_gather(int64_t rows, int64_t columns, void *weights, int64_t is_single,
                           const uint8_t *reported, const int32_t *vertices, int64_t own_sets,
                           int64_t *at, int64_t *sets, int64_t *offsets, int32_t *found,
                           void *values, int64_t *counts) {
  if (is_single)
    gather_single(rows, columns, weights, reported, vertices, own_sets, at, sets, offsets, found,
                  values, counts);
  else
    gather_double(rows, columns, weights, reported, vertices, own_sets, at, sets, offsets, found,
                  values, counts);
}
