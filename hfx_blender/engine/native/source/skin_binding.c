// SPDX-License-Identifier: GPL-3.0-or-later
// Bones and weights of the clusters of a bound model. See engine/skin/skinned_model.py.

#include <math.h>
#include <string.h>

#include "hfx_native.h"
#include "numbers.h"
#include "skin.h"

// A model's weights, and its clusters.
typedef struct {
  const int64_t *offsets;  // (vertices + 1,) of each vertex's weights
  const int64_t *bones;    // (weights,)
  const double *values;    // (weights,)
  const double *rest;      // (vertices, 4) homogeneous
  const int64_t *starts;   // (clusters + 1,)
  const int32_t *members;  // vertices of all clusters
  int64_t count;           // of clusters
  int64_t bone_count;
} hfx_bound;

// See BoneBoxes: bones of clusters, ascending, and the box of what each moves; of each cluster the
// first of these pairs, (clusters + 1,). Returns how many there are. `is_there` holds a number for
// each bone, `room` six.
HFX_EXPORT int64_t hfx_bone_boxes(const hfx_bound *model, uint8_t *is_there, double *room,
                                  int64_t *pair_starts, int64_t *pair_bones, double *lowest,
                                  double *highest) {
  int64_t pairs = 0;
  for (int64_t c = 0; c < model->count; c++) {
    pair_starts[c] = pairs;
    memset(is_there, 0, (size_t)model->bone_count);
    for (int64_t m = model->starts[c]; m < model->starts[c + 1]; m++) {
      int64_t vertex = model->members[m];
      const double *place = model->rest + 4 * vertex;
      for (int64_t e = model->offsets[vertex]; e < model->offsets[vertex + 1]; e++) {
        double *low = room + 6 * model->bones[e], *high = low + 3;
        uint8_t *is_known = is_there + model->bones[e];
        for (int i = 0; i < 3; i++) {
          low[i] = *is_known ? hfx_smaller(low[i], place[i]) : place[i];
          high[i] = *is_known ? hfx_larger(high[i], place[i]) : place[i];
        }
        *is_known = 1;
      }
    }
    for (int64_t b = 0; b < model->bone_count; b++) {
      if (!is_there[b]) continue;
      pair_bones[pairs] = b;
      for (int i = 0; i < 3; i++) {
        lowest[3 * pairs + i] = room[6 * b + i];
        highest[3 * pairs + i] = room[6 * b + 3 + i];
      }
      pairs++;
    }
  }
  pair_starts[model->count] = pairs;
  return pairs;
}

// See hfx_cluster: its arrays for some clusters, one after the other. `column` holds a number for
// each bone.
HFX_EXPORT void hfx_bind(const hfx_bound *model, const int64_t *pair_starts,
                         const int64_t *pair_bones, int64_t requested, const int64_t *clusters,
                         int64_t *column, int64_t *entry_bones, double *weights, int64_t *firsts,
                         double *rest, double *moved) {
  for (int64_t k = 0; k < requested; k++) {
    int64_t c = clusters[k], first = pair_starts[c], bones = pair_starts[c + 1] - first;
    int64_t start = model->starts[c], places = model->starts[c + 1] - start, entry = 0;
    memset(moved, 0, (size_t)(6 * bones) * sizeof *moved);
    for (int64_t b = 0; b < bones; b++) column[pair_bones[first + b]] = b;
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
    for (int64_t m = 0; m < places; m++) {
      int64_t vertex = model->members[start + m];
      const double *place = model->rest + 4 * vertex;
      for (int i = 0; i < 3; i++) {
        low[i] = hfx_smaller(low[i], place[i]);
        high[i] = hfx_larger(high[i], place[i]);
      }
      *firsts++ = entry;
      for (int i = 0; i < 4; i++) *rest++ = place[i];
      for (int64_t e = model->offsets[vertex]; e < model->offsets[vertex + 1]; e++, entry++) {
        int64_t bone = column[model->bones[e]];
        *entry_bones++ = bone;
        *weights++ = model->values[e];
        moved[6 * bone] += model->values[e];
      }
    }
    *firsts++ = entry;
    double squared = 0.0;
    for (int i = 0; i < 3; i++) squared += (high[i] - low[i]) * (high[i] - low[i]);
    for (int64_t b = 0; b < bones; b++, moved += 6) {
      moved[0] /= (double)places;
      for (int i = 0; i < 3; i++) moved[1 + i] = 0.5 * (low[i] + high[i]);
      moved[4] = 1.0;
      moved[5] = 0.5 * sqrt(squared);
    }
  }
}

// The farthest distance of a unit's skin from its vertex at rest, over its reach: no more than the distance to
// its farthest neighbour. From the vertex, no place of a quad is farther than one of its corners.
static double extent_of(const hfx_table *table, int64_t start, const hfx_cluster *cluster, int64_t unit,
                        double distance) {
  const double *own = cluster->rest + 4 * unit;
  double far = 0.0;
  for (int64_t q = table->quad_starts[start + unit]; q < table->quad_starts[start + unit + 1]; q++) {
    const hfx_quad *quad = table->quads + q;
    const double *one = cluster->rest + 4 * (table->around[2 * q] - start);
    const double *two = cluster->rest + 4 * (table->around[2 * q + 1] - start);
    double squares[3] = {0.0, 0.0, 0.0};
    for (int i = 0; i < 3; i++) {
      double way = quad->edge * (one[i] - own[i]), other = quad->other * (two[i] - own[i]);
      double inner = quad->inner * (one[i] - own[i]) + quad->inner_2 * (two[i] - own[i]);
      squares[0] += way * way, squares[1] += other * other, squares[2] += inner * inner;
    }
    double squared = hfx_larger(hfx_larger(squares[0], squares[1]), squares[2]);
    far = hfx_larger(far, sqrt(squared) + 2.0 * table->heights[q] * distance);
  }
  double extent = far * (1.0 + ROUNDING) / table->reaches[start + unit];
  return extent < distance ? extent : distance;
}

// See SkinnedModel.links: of each unit of a cluster the distance to its farthest neighbour at rest and its
// extent, (units,), by how much the weights of each bone differ, the most of any neighbour, (bones, units), and
// the most of these, (1 + bones,), see hfx_cluster.
static void links_of(const hfx_table *table, int64_t number, const hfx_cluster *cluster,
                     double *room, double *distances, double *differences, double *extents,
                     double *farthest) {
  int64_t start = table->starts[number], bones = cluster->bone_count;
  int64_t units = table->unit_counts[number];
  double *apart = room, *most = room + bones;
  for (int64_t b = 0; b <= bones; b++) farthest[b] = 0.0;
  for (int64_t u = 0; u < units; u++) {
    double squared = 0.0;
    int corners = table->is_ringed[start + u] ? 1 : 2;  // the others would be the same again
    for (int64_t b = 0; b < bones; b++) most[b] = 0.0;
    for (int64_t q = table->quad_starts[start + u]; q < table->quad_starts[start + u + 1]; q++)
      for (int k = 0; k < corners; k++) {
        double way[3] = {0.0, 0.0, 0.0};
        for (int64_t b = 0; b < bones; b++) apart[b] = 0.0;
        for (int other = 0; other < 2; other++) {
          int64_t place = other ? table->around[2 * q + k] - start : u;
          const double *rest = cluster->rest + 4 * place;
          for (int64_t e = cluster->firsts[place]; e < cluster->firsts[place + 1]; e++) {
            double weight = other ? -cluster->weights[e] : cluster->weights[e];
            for (int i = 0; i < 3; i++) way[i] += weight * rest[i];
            apart[cluster->entry_bones[e]] += weight;
          }
        }
        double length = way[0] * way[0] + way[1] * way[1] + way[2] * way[2];
        squared = hfx_larger(squared, length);
        for (int64_t b = 0; b < bones; b++) most[b] = hfx_larger(most[b], fabs(apart[b]));
      }
    distances[u] = sqrt(squared);
    extents[u] = extent_of(table, start, cluster, u, distances[u]);
    double reach = table->reaches[start + u];
    farthest[0] = hfx_larger(farthest[0], extents[u] * reach);
    for (int64_t b = 0; b < bones; b++) {
      differences[b * units + u] = most[b];
      farthest[1 + b] = hfx_larger(farthest[1 + b], most[b] * reach);
    }
  }
}

// The same of some clusters, whose distances and extents begin at the first of `starts` (3, requested + 1), whose
// differences at the second, and whose most at the third. `room` holds 2 numbers for each bone of any of them.
HFX_EXPORT void hfx_find_links(const hfx_table *table, const hfx_cluster *clusters, int64_t requested,
                               const int64_t *numbers, const int64_t *starts, double *room,
                               double *distances, double *differences, double *extents,
                               double *farthest) {
  for (int64_t k = 0; k < requested; k++)
    links_of(table, numbers[k], clusters + numbers[k], room, distances + starts[k],
             differences + starts[requested + 1 + k], extents + starts[k], farthest + starts[2 * (requested + 1) + k]);
}
