// SPDX-License-Identifier: GPL-3.0-or-later
// A closed mesh as a volume; see engine/volume/mesh.py.

#ifndef HFX_MESH_H
#define HFX_MESH_H

#include <stdint.h>

#include "hfx_native.h"

// Voxels, and runs of triangles; see volume/mesh_inside.py.
typedef struct {
  const double *box;     // (2, 3) lowest and highest corner
  const int64_t *axes;   // (3,) coordinates of points that are x, y, z of the cells
  const double *scale;   // (3,) cells per length
  const int64_t *cells;  // (3,) how many there are
  const int64_t *codes;  // (cells,) a run, -1 outside, -2 inside
  const int64_t *offsets, *beyond;  // (runs + 1,), (runs,)
  const int64_t *listed, *bounds;   // triangles, by run
  const double *spans;              // (triangles, 16)
} hfx_grid;

// Triangles and the boxes over them, about the middle of the mesh; see volume/mesh_distance.py.
typedef struct {
  const double *boxes;    // (2 size, 6)
  const int64_t *order;   // (size,)
  const double *corners;  // (triangles, 3, 3)
  const double *frames;   // (size, 16)
  int64_t size;
} hfx_tree;

typedef struct {
  const hfx_grid *grid;
  const hfx_tree *tree;
  const double *middle;  // (3,)
  double slack;          // how much the tree's boxes are too small
  double depth;          // radius of the largest ball inside; 0: not asked for, or there is none
} hfx_mesh;

// The search before, in which mesh: of neighbours it often tells enough.
typedef struct {
  const hfx_mesh *mesh;
  double known[3], least, most;
  int64_t at, is_known;
} hfx_search;

HFX_EXPORT void hfx_mesh_inside(const hfx_grid *grid, const double *points, int64_t count,
                                uint8_t *inside);

// True if a point is inside.
static inline int hfx_mesh_holds(const hfx_mesh *mesh, const double p[3]) {
  uint8_t inside;
  hfx_mesh_inside(mesh->grid, p, 1, &inside);
  return inside;
}

// Distance to the surface.
double hfx_mesh_distance(const hfx_mesh *mesh, const double p[3], hfx_search *search);

// See MeshVolume.clearance: within less than its absolute value all is on one side of the boundary.
double hfx_mesh_clearance(const hfx_mesh *mesh, const double p[3], hfx_search *search);

// First and last time inside on a way through places (steps + 1, 3), from 0 at its start to 1 at its
// end; the surface is looked for in `open` steps, which has a bit for each. Infinite, and minus
// infinity, where it is never inside or not a number.
void hfx_mesh_passage(const hfx_mesh *mesh, const double (*path)[3], int64_t steps, uint64_t open,
                      double times[2]);

// True if such a way may come within `reach` of the volume.
int hfx_mesh_nears(const hfx_mesh *mesh, const double (*path)[3], int64_t steps, double reach);

#endif
