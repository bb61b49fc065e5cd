// SPDX-License-Identifier: GPL-3.0-or-later
// Skin of clusters: where its places are in a pose, and how far its units reach.
// The arrays are those of engine/skin/skin_table.py and engine/skin/skinned_model.py.

#ifndef HFX_SKIN_H
#define HFX_SKIN_H

#include <stdint.h>

#include "skin_quad.h"

// Triangles of the skin of a model; see SkinMesh of engine/skin/skin_table.py.
typedef struct {
  const float *vertices, *normals;  // (vertices, 3)
  const float *areas_m2;            // (vertices,) square metres
  const int32_t *triangles;         // (triangles, 3)
  const int64_t *corners;           // of triangles, 3 t + k, by their vertex
  const int64_t *starts;            // (vertices + 1,) each vertex's first corner
} hfx_skin_mesh;

// The vertex that comes some steps after a corner, the way round that its triangle goes.
static inline int64_t hfx_next(const hfx_skin_mesh *mesh, int64_t corner, int steps) {
  return mesh->triangles[corner - corner % 3 + (corner + steps) % 3];
}

// SkinTable. Places, units, quads, cells and samples are counted through all clusters.
typedef struct {
  const int64_t *starts, *place_counts, *unit_counts, *cell_starts;  // of clusters
  const int32_t *vertices;                                           // of places
  const int64_t *cell_of, *quad_starts;                              // of places
  // Filled in by skin_filling.c.
  double *unit_shares, *vertex_shares, *reaches, *means;             // of places
  uint8_t *is_ringed;                                                // of places
  int32_t *around, *steps, *finest;                                  // of quads; around: (quads, 2)
  int64_t *unit_of, *sample_starts;                                  // of quads
  double *wholes, *heights, *diagonals;                              // of quads
  hfx_quad *quads;
  int64_t *most_samples;                                             // of clusters
  const double **blocks;                                             // of clusters: (4, rooms) samples
  int64_t *rooms;                                                    // of clusters
  int64_t is_simple, is_split;
  double spacing_share, distance_m;  // how far skin may be from its samples; see engine/tolerance.py
} hfx_table;

// Bones and weights of a cluster, and distances of its units to their neighbours at rest.
typedef struct {
  const int64_t *entry_bones;  // (E,) which of the cluster's bones
  const double *weights;       // (E,)
  const int64_t *firsts;       // (places + 1,) each place's first of these
  const double *rest;          // (places, 4) homogeneous
  const int64_t *bones;        // (B,)
  const double *moved;         // (B, 6) mean weight; box's centre, homogeneous, and radius
  const double *distances;     // (units,) to the farthest neighbour
  const double *differences;   // (B, units) of weights, to the neighbour that differs most
  const double *extents;       // (units,) farthest distance of skin over the reach; no more than distances
  const double *farthest;      // (1 + B,) extents, and differences, times the reach: the most of any unit
  int64_t bone_count;
} hfx_cluster;

// Groups of a cluster's cells, at rest; see engine/skin/bound_clusters.py.
typedef struct {
  const int64_t *starts;                   // (groups + 1,) pairs of a group and a bone
  const double *distances;                 // (groups,)
  const double *boxes;                     // (groups, 2, 3) middle and half edges
  const int64_t *bones;                    // (pairs,)
  const double *shares, *changes;          // (pairs,)
  int64_t count;
} hfx_groups;

// The matrices of some bones at each row, rest to target space.
typedef struct {
  double *matrices;        // (rows, count, 3, 4)
  double *stretches;       // (rows, count)
  const int64_t *slots;    // which of them a bone has
  int64_t count;
} hfx_bones;

// Takes the next `count` of an array that is room.
static inline double *take(double **room, int64_t count) {
  double *taken = *room;
  *room += count;
  return taken;
}

#endif
