// SPDX-License-Identifier: GPL-3.0-or-later
// Linear blend skinning of clusters, and bounds of what is not posed.

#include <math.h>
#include <string.h>

#include "hfx_native.h"
#include "skin.h"
#include "skin_posing.h"

// See products.py and SkinnedModel.bone_matrices: rest to target space, (rows, count, 3, 4), and
// no less than what each stretches. `bones` of -1 rest.
HFX_EXPORT void hfx_bone_matrices(int64_t rows, int64_t count, int64_t all, const double *posed,
                                  const int64_t *row, const int64_t *bones,
                                  const double *to_target, double *matrices, double *stretches) {
  static const double rest[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
  for (int64_t n = 0; n < rows; n++) {
    const double *target = to_target + 16 * n;
    for (int64_t b = 0; b < count; b++, matrices += 12) {
      const double *bone = bones[b] < 0 ? rest : posed + 12 * (row[n] * all + bones[b]);
      for (int i = 0; i < 3; i++) {
        const double *t = target + 4 * i;
        for (int j = 0; j < 4; j++)
          matrices[4 * i + j] = t[0] * bone[j] + t[1] * bone[4 + j] + t[2] * bone[8 + j];
        matrices[4 * i + 3] += t[3];
      }
      *stretches++ = hfx_stretch(matrices, 4);
    }
  }
}

// See SkinnedModel.cluster_bounds: boxes around clusters, (rows, clusters, 3) each. A pair is a
// cluster and a bone that moves a box of it; `starts` has a cluster's first, and their number.
HFX_EXPORT void hfx_cluster_bounds(int64_t rows, int64_t count, const double *matrices,
                                   int64_t clusters, const int64_t *starts, const int64_t *slots,
                                   const double *centres, const double *halves, double *low,
                                   double *high) {
  for (int64_t n = 0; n < rows; n++, matrices += 12 * count) {
    for (int64_t c = 0; c < clusters; c++, low += 3, high += 3) {
      for (int i = 0; i < 3; i++) low[i] = INFINITY, high[i] = -INFINITY;
      for (int64_t p = starts[c]; p < starts[c + 1]; p++) {
        const double *centre = centres + 3 * p, *half = halves + 3 * p;
        for (int i = 0; i < 3; i++) {
          const double *m = matrices + 12 * slots[p] + 4 * i;
          double middle = m[0] * centre[0] + m[1] * centre[1] + m[2] * centre[2] + m[3];
          double reach = fabs(m[0]) * half[0] + fabs(m[1]) * half[1] + fabs(m[2]) * half[2];
          // Not a number stays: what it may touch is not known.
          low[i] = hfx_smaller(low[i], middle - reach);
          high[i] = hfx_larger(high[i], middle + reach);
        }
      }
    }
  }
}

// See SkinnedModel.cluster_moves: how far clusters can have moved from rows `before` to `after`,
// (intervals, asked). `linear` (intervals, 3, 3) is from the space of the matrices to that of moves.
HFX_EXPORT void hfx_cluster_moves(const hfx_bones *bones, int64_t intervals, const int64_t *before,
                                  const int64_t *after, const double *linear, int64_t asked,
                                  const int64_t *clusters, const int64_t *starts,
                                  const int64_t *pair_bones, const double *centres,
                                  const double *halves, double *moves) {
  for (int64_t n = 0; n < intervals; n++, linear += 9)
    for (int64_t k = 0; k < asked; k++)
      *moves++ = hfx_box_moves(bones, before[n], after[n], linear, 3, starts[clusters[k]],
                               starts[clusters[k] + 1], pair_bones, centres, halves);
}

// See CellSizes.means: no less than the mean distance of any cell's skin from its vertex, at some
// rows of the matrices, (rows, asked).
HFX_EXPORT void hfx_cell_means(const hfx_bones *bones, const hfx_groups *groups, int64_t rows,
                               const int64_t *row, int64_t asked, const int64_t *clusters,
                               double *means) {
  for (int64_t n = 0; n < rows; n++)
    for (int64_t k = 0; k < asked; k++)
      *means++ = hfx_cell_mean(bones, groups + clusters[k], row[n]);
}

// See SkinnedModel.links: of each unit of a cluster the distance to its farthest neighbour at rest,
// and by how much weights differ, the most of any neighbour, all bones together; (units,) each.
// `room` holds 2 numbers for each of the cluster's bones.
HFX_EXPORT void hfx_links(const hfx_table *table, int64_t number, const hfx_cluster *cluster,
                          double *room, double *distances, double *differences) {
  int64_t start = table->starts[number], bones = cluster->bone_count;
  double *apart = room, *most = room + bones;
  for (int64_t u = 0; u < table->unit_counts[number]; u++) {
    double squared = 0.0;
    for (int64_t b = 0; b < bones; b++) most[b] = 0.0;
    for (int64_t q = table->quad_starts[start + u]; q < table->quad_starts[start + u + 1]; q++)
      for (int k = 0; k < 2; k++) {
        double way[3] = {0.0, 0.0, 0.0};
        for (int64_t b = 0; b < bones; b++) apart[b] = 0.0;
        for (int other = 0; other < 2; other++) {
          int64_t place = other ? table->around[2 * q + k] - start : u;
          for (int64_t e = cluster->firsts[place]; e < cluster->firsts[place + 1]; e++) {
            const double *factor = cluster->factors + 4 * e;  // weight times rest position and 1
            double sign = other ? -1.0 : 1.0;
            for (int i = 0; i < 3; i++) way[i] += sign * factor[i];
            apart[cluster->entry_bones[e]] += sign * factor[3];
          }
        }
        double length = way[0] * way[0] + way[1] * way[1] + way[2] * way[2];
        squared = hfx_larger(squared, length);
        for (int64_t b = 0; b < bones; b++) most[b] = hfx_larger(most[b], fabs(apart[b]));
      }
    distances[u] = sqrt(squared);
    differences[u] = 0.0;
    for (int64_t b = 0; b < bones; b++) differences[u] += most[b];
  }
}
