// SPDX-License-Identifier: GPL-3.0-or-later
// Outlines of clusters, between which their skin lies. See SkinMesh.outlined in engine/skin/skin_table.py.

#include <math.h>
#include <string.h>

#include "hfx_native.h"
#include "skin.h"

static float larger(float a, float b) { return (a >= b || a != a) ? a : b; }

// Largest distance by which skin may bulge beyond the vertices of each cluster, metres; (clusters,)
// zeros at first. No sample of a triangle is higher over it than these bounds.
HFX_EXPORT void hfx_margins(const hfx_skin_mesh *mesh, int64_t triangles, const int64_t *cluster_of,
                            double *margins) {
  for (int64_t f = 0; f < triangles; f++) {
    float bound = 0.0f;
    for (int k = 0; k < 3; k++) {
      int64_t one = mesh->triangles[3 * f + k], other = mesh->triangles[3 * f + (k + 1) % 3];
      float before = 0.0f, after = 0.0f;
      for (int i = 0; i < 3; i++) {
        float edge = mesh->vertices[3 * other + i] - mesh->vertices[3 * one + i];
        before += edge * mesh->normals[3 * one + i];
        after += edge * mesh->normals[3 * other + i];
      }
      bound = larger(bound, (fabsf(before) + fabsf(after)) / 6.0f);
    }
    for (int k = 0; k < 3; k++) {
      double *margin = margins + cluster_of[mesh->triangles[3 * f + k]];
      if (!(*margin >= bound) && *margin == *margin) *margin = bound;
    }
  }
}

static void sort(int32_t *values, int64_t count) {
  int64_t gap = 1;
  while (gap < count / 3) gap = 3 * gap + 1;
  for (; gap > 0; gap /= 3)
    for (int64_t k = gap; k < count; k++) {
      int32_t value = values[k];
      int64_t at = k;
      for (; at >= gap && values[at - gap] > value; at -= gap) values[at] = values[at - gap];
      values[at] = value;
    }
}

// The units of each cluster and then, ascending, the corners around them that are in others: in
// `outlines`, one after the other. `starts` has the first unit of each cluster, `ends` gets the end of
// each outline. `seen` holds a number for each vertex.
HFX_EXPORT void hfx_outlines(const hfx_skin_mesh *mesh, int64_t clusters, const int64_t *starts,
                             const int32_t *units, const int64_t *cluster_of, int64_t vertices,
                             int64_t *seen, int32_t *outlines, int64_t *ends) {
  int64_t end = 0;
  memset(seen, 0, (size_t)vertices * sizeof *seen);
  for (int64_t c = 0; c < clusters; c++) {
    int64_t count = starts[c + 1] - starts[c];
    memcpy(outlines + end, units + starts[c], (size_t)count * sizeof *units);
    int64_t first = end += count;
    for (int64_t u = starts[c]; u < starts[c + 1]; u++)
      for (int64_t k = mesh->starts[units[u]]; k < mesh->starts[units[u] + 1]; k++)
        for (int step = 1; step < 3; step++) {
          int64_t other = hfx_next(mesh, mesh->corners[k], step);
          if (cluster_of[other] == c || seen[other] == c + 1) continue;
          seen[other] = c + 1;
          outlines[end++] = (int32_t)other;
        }
    sort(outlines + first, end - first);
    ends[c] = end;
  }
}
