// SPDX-License-Identifier: GPL-3.0-or-later
// The tree of boxes over a mesh's triangles: volume/mesh_distance.py builds the same.

#include <math.h>
#include <string.h>

#include "mesh_tree.h"

// Sorts places by their keys, those of equal keys as they stood: merges runs twice as long each
// time. All arrays (count).
static void sort_by(double *keys, int64_t *places, int64_t count, double *spare_keys,
                    int64_t *spare_places) {
  enum { RUN = 8 };
  for (int64_t first = 0; first < count; first += RUN) {
    const int64_t end = first + RUN < count ? first + RUN : count;
    for (int64_t k = first + 1; k < end; ++k) {
      const double key = keys[k];
      const int64_t place = places[k];
      int64_t at = k;
      for (; at > first && keys[at - 1] > key; --at) {
        keys[at] = keys[at - 1];
        places[at] = places[at - 1];
      }
      keys[at] = key;
      places[at] = place;
    }
  }
  double *from = keys, *to = spare_keys;
  int64_t *from_places = places, *to_places = spare_places;
  for (int64_t run = RUN; run < count; run *= 2) {
    for (int64_t first = 0; first < count; first += 2 * run) {
      const int64_t middle = first + run < count ? first + run : count;
      const int64_t end = first + 2 * run < count ? first + 2 * run : count;
      int64_t one = first, other = middle;
      for (int64_t k = first; k < end; ++k) {
        const int64_t at =
            one < middle && (other >= end || from[one] <= from[other]) ? one++ : other++;
        to[k] = from[at];
        to_places[k] = from_places[at];
      }
    }
    double *keys_again = from;
    int64_t *places_again = from_places;
    from = to;
    to = keys_again;
    from_places = to_places;
    to_places = places_again;
  }
  if (from_places != places) memcpy(places, from_places, (size_t)count * sizeof *places);
}

// corners (count, 3, 3); order (size), size a power of two that is no less; middles (count, 3),
// keys, spare_keys, spare (size): scratch.
HFX_EXPORT void hfx_mesh_leaf_order(const double *corners, int64_t count, int64_t size,
                                    int64_t *order, double *middles, double *keys,
                                    double *spare_keys, int64_t *spare) {
  for (int64_t f = 0; f < count; ++f)
    for (int k = 0; k < 3; ++k)
      middles[3 * f + k] =
          (corners[9 * f + k] + corners[9 * f + 3 + k] + corners[9 * f + 6 + k]) / 3.0;
  for (int64_t k = 0; k < size; ++k) order[k] = k * count / size;
  for (int64_t group = size; group > 1; group /= 2) {
    for (int64_t first = 0; first < size; first += group) {
      int64_t *mine = order + first;
      double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
      for (int64_t n = 0; n < group; ++n) {
        for (int k = 0; k < 3; ++k) {
          const double value = middles[3 * mine[n] + k];
          low[k] = lesser(value, low[k]);
          high[k] = greater(value, high[k]);
        }
      }
      int axis = 0;
      for (int k = 1; k < 3; ++k)
        if (high[k] - low[k] > high[axis] - low[axis]) axis = k;
      for (int64_t n = 0; n < group; ++n) keys[n] = middles[3 * mine[n] + axis];
      sort_by(keys, mine, group, spare_keys, spare);
    }
  }
}

// corners (count, 3, 3), order (size); boxes (2 size, 6): those of the leaves come last.
HFX_EXPORT void hfx_mesh_boxes(const double *corners, const int64_t *order, int64_t size,
                               double *boxes) {
  for (int64_t leaf = 0; leaf < size; ++leaf) {
    const double *corner = corners + 9 * order[leaf];
    double *box = boxes + BOX * (size + leaf);
    for (int k = 0; k < 3; ++k) {
      box[k] = lesser(lesser(corner[k], corner[3 + k]), corner[6 + k]);
      box[3 + k] = greater(greater(corner[k], corner[3 + k]), corner[6 + k]);
    }
  }
  for (int64_t node = size - 1; node > 0; --node) {
    const double *one = boxes + BOX * 2 * node, *other = one + BOX;
    for (int k = 0; k < 3; ++k) {
      boxes[BOX * node + k] = lesser(one[k], other[k]);
      boxes[BOX * node + 3 + k] = greater(one[3 + k], other[3 + k]);
    }
  }
}

// Each triangle in a plane of its own, see _plane_frames: corners (count, 3, 3), order (size),
// frames (size, 16).
HFX_EXPORT void hfx_mesh_frames(const double *corners, const int64_t *order, int64_t size,
                                double *frames) {
  for (int64_t leaf = 0; leaf < size; ++leaf) {
    const double *corner = corners + 9 * order[leaf];
    double *frame = frames + FRAME * leaf;
    double edges[3][3], longest_square = -1.0;
    int longest = 0;
    for (int c = 0; c < 3; ++c) {
      for (int k = 0; k < 3; ++k) edges[c][k] = corner[3 * ((c + 1) % 3) + k] - corner[3 * c + k];
      const double square = dot(edges[c], edges[c]);
      if (square > longest_square) {
        longest_square = square;
        longest = c;
      }
    }
    const double *origin = corner + 3 * longest, *base = edges[longest];
    double apex[3], axis_x[3], axis_y[3], some[3] = {0.0, 0.0, 0.0};
    const double length = sqrt(dot(base, base));
    for (int k = 0; k < 3; ++k) {
      apex[k] = corner[3 * ((longest + 2) % 3) + k] - origin[k];
      axis_x[k] = base[k] / (length > 0.0 ? length : 1.0);
      axis_y[k] = apex[k];
    }
    // Once more: for a thin triangle the first difference is mostly rounding.
    for (int again = 0; again < 2; ++again) {
      const double along = dot(axis_y, axis_x);
      for (int k = 0; k < 3; ++k) axis_y[k] = axis_y[k] - along * axis_x[k];
    }
    const double width = sqrt(dot(axis_y, axis_y));
    if (width <= 1e-15 * length) {
      int least = 0;
      for (int k = 1; k < 3; ++k)
        if (fabs(axis_x[k]) < fabs(axis_x[least])) least = k;
      some[least] = 1.0;
      cross(axis_x, some, axis_y);
      const double size = greater(sqrt(dot(axis_y, axis_y)), 1e-300);
      for (int k = 0; k < 3; ++k) axis_y[k] /= size;
    } else {
      for (int k = 0; k < 3; ++k) axis_y[k] /= width;
    }
    memcpy(frame + ORIGIN, origin, 3 * sizeof *frame);
    memcpy(frame + AXIS_X, axis_x, 3 * sizeof *frame);
    memcpy(frame + AXIS_Y, axis_y, 3 * sizeof *frame);
    cross(axis_x, axis_y, frame + AXIS_Z);
    frame[LENGTH] = length;
    frame[APEX_X] = dot(apex, axis_x);
    frame[APEX_Y] = dot(apex, axis_y);
    frame[15] = 0.0;
  }
}
