// SPDX-License-Identifier: GPL-3.0-or-later
// Memory layout of a mesh's triangles and of the tree of boxes over them.

#ifndef HFX_MESH_TREE_H
#define HFX_MESH_TREE_H

#include "hfx_native.h"
#include "numbers.h"

// Lowest and highest corner. Node 1 is the root, nodes 2 n and 2 n + 1 are the halves of node n,
// and nodes from the number of leaves on are leaves: no node needs to say where its halves are.
enum { BOX = 6 };

// A triangle in a plane of its own, see _plane_frames of volume/mesh_distance.py: what tells how far
// its plane is comes first. Triangles stand in the order of the leaves.
enum { ORIGIN = 0, AXIS_Z = 3, AXIS_X = 6, AXIS_Y = 9, LENGTH = 12, APEX_X, APEX_Y, FRAME = 16 };

// A search for what is near looks at this many leaves together, rather than at their boxes.
enum { TOGETHER = 4 };

// Nodes that wait: one for each level, and none has as many.
enum { DEEPEST = 64 };

static inline void cross(const double *one, const double *other, double *out) {
  out[0] = one[1] * other[2] - one[2] * other[1];
  out[1] = one[2] * other[0] - one[0] * other[2];
  out[2] = one[0] * other[1] - one[1] * other[0];
}

static inline double dot(const double *one, const double *other) {
  return one[0] * other[0] + one[1] * other[1] + one[2] * other[2];
}

#endif
