// SPDX-License-Identifier: GPL-3.0-or-later
// Fills in where the skin of clusters is sampled. See engine/skin_table.py, engine/skin_quads.py.

#include <math.h>

#include "hfx_native.h"
#include "numbers.h"
#include "skin_mesh.h"

#define FLAT_ENOUGH 0.1
#define MOST_STEPS 256.0
#define BULGE_LIMIT 0.25

// SkinTable, to be written.
typedef struct {
  const int64_t *starts, *unit_counts, *cell_starts;  // of clusters
  const int32_t *vertices;                            // of places
  const int64_t *cell_of, *quad_starts;               // of places
  int64_t *steps;                                     // of units
  double *unit_shares, *vertex_shares, *reaches, *means;
  uint8_t *is_ringed;
  int64_t *unit_of, *around, *sample_starts;  // of quads
  double *heights_m, *wholes;
  double *bulge_m;  // of clusters
  int64_t *most_samples;
  const double *distance;   // of vertices of the mesh: how far apart samples may be
  const uint8_t *is_split;  // of these: which stand for more than themselves
  const double *closeness;  // of these: one over the spacing
} hfx_filling;

// What places samples in a quad; see Quads.
typedef struct {
  double edge, other, inner, inner_2;
  double area, by_s, by_t;
  double to_one, to_two, between;  // bulges, none where it does not count
} hfx_quad;

// What else is known of a quad.
typedef struct {
  double total, longest, reach, mean, size;
} extent;

static double dot(const double *a, const double *b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static double bulge(double height, double size) {
  height = 0.5 * height / size;
  if (!isfinite(height)) return 0.0;
  return height < -BULGE_LIMIT ? -BULGE_LIMIT : (height > BULGE_LIMIT ? BULGE_LIMIT : height);
}

// See Quads.of: the quad at the first corner of a triangle.
static extent quad_at(const hfx_skin_mesh *mesh, const double *closeness, const int64_t ring[3],
                      hfx_quad *quad) {
  double points[3][3], upright[3][3], along[3], across[3], facing[3], apart[3];
  for (int k = 0; k < 3; k++)
    for (int i = 0; i < 3; i++) points[k][i] = mesh->vertices[3 * ring[k] + i];
  for (int i = 0; i < 3; i++) along[i] = points[1][i] - points[0][i];
  for (int i = 0; i < 3; i++) across[i] = points[2][i] - points[0][i];
  for (int i = 0; i < 3; i++) facing[i] = across[i] - along[i];
  double cross[3] = {along[1] * across[2] - along[2] * across[1],
                     along[2] * across[0] - along[0] * across[2],
                     along[0] * across[1] - along[1] * across[0]};
  double doubled = sqrt(dot(cross, cross)), size = sqrt(doubled);

  double one = closeness[ring[0]], two = closeness[ring[1]], three = closeness[ring[2]];
  double whole = one + two + three;
  double edge = two / (one + two), other = three / (one + three);
  double inner = two / whole, inner_2 = three / whole;
  double twist = inner - edge, twist_2 = inner_2 - other;
  double area = edge * other * doubled, by_s = edge * twist_2 * doubled, by_t = twist * other * doubled;
  double lengths = hfx_larger(edge * edge * dot(along, along), other * other * dot(across, across));
  double total = area + 0.5 * by_s + 0.5 * by_t;
  double mean = edge * (area / 4.0 + by_s / 6.0 + by_t / 12.0) +
                other * (area / 4.0 + by_s / 12.0 + by_t / 6.0) +
                (inner + inner_2) * (area / 4.0 + by_s / 6.0 + by_t / 6.0);

  for (int k = 0; k < 3; k++) {
    double normal[3];
    for (int i = 0; i < 3; i++) normal[i] = mesh->normals[3 * ring[k] + i];
    double share = dot(normal, cross) / doubled;
    for (int i = 0; i < 3; i++) upright[k][i] = normal[i] * share;
  }
  double heights[3];
  const double *ways[3] = {along, across, facing};
  for (int k = 0; k < 3; k++) {
    const double *to = upright[k ? 2 : 1], *from = upright[k == 2];
    for (int i = 0; i < 3; i++) apart[i] = to[i] - from[i];
    heights[k] = bulge(dot(ways[k], apart), size);
  }
  *quad = (hfx_quad){edge, other, inner, inner_2, area, by_s, by_t, heights[0], heights[1], heights[2]};
  double reach = hfx_larger(hfx_larger(edge, other), inner + inner_2);
  return (extent){total, sqrt(lengths), reach, total > 0.0 ? mean / total : 0.0, size};
}

// A unit's quads, its steps and its area; `balance` holds a zero for each vertex.
static double fill_quads(const hfx_filling *table, const hfx_skin_mesh *mesh, int64_t unit,
                         const int64_t *place, int64_t *balance, hfx_quad *quads, extent *extents) {
  int64_t vertex = table->vertices[unit], first = table->quad_starts[unit];
  int64_t count = table->quad_starts[unit + 1] - first;
  const int64_t *corners = mesh->corners + mesh->starts[vertex];
  double area = 0.0, side = 0.0, largest = 0.0;
  uint8_t is_ringed = 1;
  for (int64_t k = 0; k < count; k++) {
    int64_t ring[3];
    for (int i = 0; i < 3; i++) ring[i] = hfx_next(mesh, corners[k], i);
    extents[k] = quad_at(mesh, table->closeness, ring, quads + k);
    area += extents[k].total;
    side = hfx_larger(side, extents[k].longest);
    largest = hfx_larger(largest, extents[k].total);
    table->unit_of[first + k] = unit;
    for (int i = 0; i < 2; i++) table->around[2 * (first + k) + i] = place[ring[1 + i]];
    balance[ring[1]]++;
    balance[ring[2]]--;
  }
  for (int64_t k = 0; k < count; k++)
    for (int i = 1; i < 3; i++)
      if (balance[hfx_next(mesh, corners[k], i)]) is_ringed = 0;
  for (int64_t k = 0; k < count; k++)
    for (int i = 1; i < 3; i++) balance[hfx_next(mesh, corners[k], i)] = 0;
  double steps = ceil(hfx_larger(sqrt(largest), 0.5 * side) / table->distance[vertex] - 1e-9);
  steps = steps > 1.0 ? (steps < MOST_STEPS ? steps : MOST_STEPS) : 1.0;
  table->steps[unit] = table->is_split[vertex] ? (int64_t)steps : 0;
  table->is_ringed[unit] = is_ringed;
  return area > 0.0 ? area : 1.0;
}

// What depends on the area of the whole cell; returns the highest bulge.
static double share_out(const hfx_filling *table, int64_t unit, double area, double cell,
                        hfx_quad *quads, const extent *extents) {
  int64_t first = table->quad_starts[unit], count = table->quad_starts[unit + 1] - first;
  double steps = (double)table->steps[unit], squared = steps * steps;
  double share = area / cell, mine = share / ((double)count * squared + 1.0);
  double scale = (share - mine) / area / hfx_larger(squared, 1.0);
  double reach = 0.0, mean = 0.0, highest = 0.0;
  double flat = FLAT_ENOUGH * table->distance[table->vertices[unit]];
  for (int64_t k = 0; k < count; k++) {
    hfx_quad *quad = quads + k;
    double most = hfx_larger(hfx_larger(fabs(quad->to_one), fabs(quad->to_two)), fabs(quad->between));
    double height = most / 3.0;  // all three edges meet in the middle
    int is_curved = height * extents[k].size > flat;
    double up = is_curved ? 2.0 * height : 0.0, counts = is_curved ? 1.0 : 0.0;
    table->heights_m[first + k] = is_curved ? height * extents[k].size : 0.0;
    table->wholes[first + k] = extents[k].total * (scale * steps * steps);
    reach = hfx_larger(reach, extents[k].reach + up);
    mean += extents[k].total * (extents[k].mean + up);
    highest = hfx_larger(highest, table->heights_m[first + k]);
    quad->to_one *= counts, quad->to_two *= counts, quad->between *= counts;
    quad->area *= scale, quad->by_s *= scale, quad->by_t *= scale;
  }
  table->unit_shares[unit] = share, table->vertex_shares[unit] = mine;
  table->reaches[unit] = steps > 0.0 ? reach : 0.0;
  table->means[unit] = steps > 0.0 ? mean / area : 0.0;
  return highest;
}

// See SkinTable.need: all but the samples, of which there are `samples` before. Returns how many
// there are then. `quads` holds those of all these clusters, as they place their samples; `place` and
// `balance` hold zeros for the vertices of the mesh, `extents` all that a cluster has; `areas` and
// `cells` hold numbers for a cluster's units and cells, `counts` for its cells.
HFX_EXPORT int64_t hfx_fill(const hfx_filling *table, const hfx_skin_mesh *mesh, int64_t asked,
                            const int64_t *clusters, int64_t samples, int64_t *place,
                            int64_t *balance, extent *extents, double *areas, double *cells,
                            int64_t *counts, hfx_quad *quads) {
  for (int64_t k = 0; k < asked; k++) {
    int64_t c = clusters[k], start = table->starts[c], end = start + table->unit_counts[c];
    int64_t first = table->cell_starts[c], count = table->cell_starts[c + 1] - first;
    int64_t quad = table->quad_starts[start], most = 1;
    double highest = 0.0;
    for (int64_t p = start; p < table->starts[c + 1]; p++) place[table->vertices[p]] = p;
    for (int64_t i = 0; i < count; i++) cells[i] = 0.0, counts[i] = 0;
    for (int64_t u = start; u < end; u++) {
      int64_t at = table->quad_starts[u] - quad;
      areas[u - start] = fill_quads(table, mesh, u, place, balance, quads + at, extents + at);
      cells[table->cell_of[u] - first] += areas[u - start];
    }
    for (int64_t u = start; u < end; u++) {
      int64_t at = table->quad_starts[u] - quad, squared = table->steps[u] * table->steps[u];
      int64_t *counted = counts + table->cell_of[u] - first;
      double cell = cells[table->cell_of[u] - first];
      double bulge_m = share_out(table, u, areas[u - start], cell, quads + at, extents + at);
      highest = hfx_larger(highest, bulge_m);
      for (int64_t q = table->quad_starts[u]; q < table->quad_starts[u + 1]; q++, samples += squared)
        table->sample_starts[q] = samples;
      *counted += 1 + (table->quad_starts[u + 1] - table->quad_starts[u]) * squared;
      if (*counted > most) most = *counted;
    }
    table->bulge_m[c] = highest;
    table->most_samples[c] = most;
    quads += table->quad_starts[end] - quad;
  }
  return samples;
}

// Writes the samples of the quads of these clusters, as hfx_fill left them, (4, room).
HFX_EXPORT void hfx_place_samples(const hfx_filling *table, int64_t asked, const int64_t *clusters,
                                  const hfx_quad *quads, int64_t room, double *samples) {
  for (int64_t k = 0; k < asked; k++) {
    int64_t start = table->starts[clusters[k]], end = start + table->unit_counts[clusters[k]];
    for (int64_t u = start; u < end; u++)
      for (int64_t q = table->quad_starts[u]; q < table->quad_starts[u + 1]; q++, quads++) {
        double *sample = samples + table->sample_starts[q], number = (double)table->steps[u];
        for (int64_t i = 0; i < table->steps[u]; i++)
          for (int64_t j = 0; j < table->steps[u]; j++, sample++) {
            double s = ((double)i + 0.5) / number, t = ((double)j + 0.5) / number;
            double one = s * (1.0 - t) * quads->edge + s * t * quads->inner;
            double two = (1.0 - s) * t * quads->other + s * t * quads->inner_2;
            sample[0] = one;
            sample[room] = two;
            sample[2 * room] = (1.0 - one - two) * (one * quads->to_one + two * quads->to_two) +
                               one * two * quads->between;
            sample[3 * room] = quads->area + s * quads->by_s + t * quads->by_t;
          }
      }
  }
}
