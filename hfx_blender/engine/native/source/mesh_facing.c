// SPDX-License-Identifier: GPL-3.0-or-later
// Nearest triangles that face points: TargetSurface of retargeting/surface.py.

#include <math.h>

#include "mesh_tree.h"

static void between(const double *from, const double *to, double *way) {
  for (int k = 0; k < 3; ++k) way[k] = to[k] - from[k];
}

// Barycentric coordinates of the nearest place of a triangle (3, 3), as barycentric of
// volume/mesh_distance.py: a degenerate triangle counts as edges.
static void nearest_weights(const double *point, const double *corners, double *weights) {
  double edge_1[3], edge_2[3], offset[3], across[3], least = INFINITY;
  between(corners, corners + 3, edge_1);
  between(corners, corners + 6, edge_2);
  between(corners, point, offset);
  const double d00 = dot(edge_1, edge_1), d01 = dot(edge_1, edge_2), d11 = dot(edge_2, edge_2);
  const double d20 = dot(offset, edge_1), d21 = dot(offset, edge_2);
  const double scale = greater(d00 * d11 - d01 * d01, 1e-40);
  weights[1] = (d11 * d20 - d01 * d21) / scale;
  weights[2] = (d00 * d21 - d01 * d20) / scale;
  weights[0] = 1.0 - weights[1] - weights[2];
  cross(edge_1, edge_2, across);
  if (weights[0] >= 0.0 && weights[1] >= 0.0 && weights[2] >= 0.0 && dot(across, across) > 0.0) return;
  for (int start = 0; start < 3; ++start) {
    const int end = (start + 1) % 3;
    double edge[3], gap[3];
    between(corners + 3 * start, corners + 3 * end, edge);
    between(corners + 3 * start, point, offset);
    const double share = dot(offset, edge) / greater(dot(edge, edge), 1e-30);
    const double clipped = lesser(greater(share, 0.0), 1.0);
    for (int k = 0; k < 3; ++k) gap[k] = offset[k] - clipped * edge[k];
    const double squared = dot(gap, gap);
    if (!(squared < least)) continue;
    least = squared;
    weights[0] = weights[1] = weights[2] = 0.0;
    weights[start] = 1.0 - clipped;
    weights[end] = clipped;
  }
}

// Enters triangles nearest[point[n]] = triangle[n] that are nearer than distances[point[n]] and whose
// normal there has a product of `facing` at least with that of the point; is_entered (count) says which.
// corners, corner_normals (F, 3, 3); points, normals (P, 3).
HFX_EXPORT void hfx_mesh_nearest_facing(const double *corners, const double *corner_normals, int64_t count,
                                        const int64_t *point, const int64_t *triangle,
                                        const double *points, const double *normals, double facing,
                                        double *distances, int64_t *nearest, uint8_t *is_entered) {
  for (int64_t n = 0; n < count; ++n) {
    const double *at = points + 3 * point[n], *own = corners + 9 * triangle[n];
    const double *normal = corner_normals + 9 * triangle[n];
    double weights[3], gap[3], there[3];
    nearest_weights(at, own, weights);
    for (int k = 0; k < 3; ++k) {
      gap[k] = weights[0] * own[k] + weights[1] * own[3 + k] + weights[2] * own[6 + k] - at[k];
      there[k] = weights[0] * normal[k] + weights[1] * normal[3 + k] + weights[2] * normal[6 + k];
    }
    const double distance = sqrt(dot(gap, gap));
    is_entered[n] =
        distance < distances[point[n]] && dot(there, normals + 3 * point[n]) >= facing;
    if (!is_entered[n]) continue;
    distances[point[n]] = distance;
    nearest[point[n]] = triangle[n];
  }
}
