// SPDX-License-Identifier: GPL-3.0-or-later
// The triangles that are the skin of a model; see engine/skin/skin_mesh.py.

#ifndef HFX_SKIN_MESH_H
#define HFX_SKIN_MESH_H

#include <stdint.h>

typedef struct {
  const float *vertices, *normals;  // (vertices, 3)
  const float *areas_m2;              // (vertices,) square metres
  const int32_t *triangles;         // (triangles, 3)
  const int64_t *corners;           // of triangles, 3 t + k, by their vertex
  const int64_t *starts;            // (vertices + 1,) each vertex's first corner
} hfx_skin_mesh;

// The vertex that comes some steps after a corner, the way round that its triangle goes.
static inline int64_t hfx_next(const hfx_skin_mesh *mesh, int64_t corner, int steps) {
  return mesh->triangles[corner - corner % 3 + (corner + steps) % 3];
}

#endif
