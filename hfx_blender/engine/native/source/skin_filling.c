// SPDX-License-Identifier: GPL-3.0-or-later
// Fills in where the skin of clusters is sampled. See engine/skin/skin_table.py.

#include <math.h>

#include "hfx_native.h"
#include "numbers.h"
#include "skin.h"

#define FLAT_ENOUGH 0.1
#define BULGE_LIMIT 0.25

// Spacing of vertices and samples of the mesh, all of vertices.
typedef struct {
  const double *distance, *finest;  // metres from skin to its samples, at rest and at the finest
  const double *closeness;          // one over the spacing
  double most_share;                // of a unit, that its vertex stands for
} hfx_spacing;

// Further data of a quad.
typedef struct {
  double total, reach, mean, size;
  double squares[3];  // of edges, see hfx_diagonal
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
  mean = total > 0.0 ? mean / total : 0.0;
  return (extent){total, reach, mean, size, {dot(along, along), dot(along, across), dot(across, across)}};
}

// A unit's quads, its steps and its area; `balance` holds a zero for each vertex.
static double fill_quads(const hfx_table *table, const hfx_skin_mesh *mesh, const hfx_spacing *spacing,
                         int64_t unit, const int64_t *place, int64_t *balance, extent *extents) {
  int64_t vertex = table->vertices[unit], first = table->quad_starts[unit];
  int64_t count = table->quad_starts[unit + 1] - first;
  const int64_t *corners = mesh->corners + mesh->starts[vertex];
  int32_t *steps[2] = {table->steps + first, table->finest + first};
  const double distances[2] = {spacing->distance[vertex], spacing->finest[vertex]};
  double area = 0.0;
  uint8_t is_ringed = 1;
  for (int64_t k = 0; k < count; k++) {
    int64_t ring[3];
    for (int i = 0; i < 3; i++) ring[i] = hfx_next(mesh, corners[k], i);
    hfx_quad *quad = table->quads + first + k;
    extents[k] = quad_at(mesh, spacing->closeness, ring, quad);
    area += extents[k].total;
    double longest = hfx_diagonal(quad, extents[k].squares, INFINITY);
    for (int i = 0; i < 2; i++)
      *steps[i]++ = (int32_t)hfx_steps_within(quad, extents[k].squares, longest, distances[i]);
    table->diagonals[first + k] = hfx_longest(quad, (double)table->steps[first + k]);
    table->unit_of[first + k] = unit;
    for (int i = 0; i < 2; i++) table->around[2 * (first + k) + i] = (int32_t)place[ring[1 + i]];
    balance[ring[1]]++;
    balance[ring[2]]--;
  }
  for (int64_t k = 0; k < count; k++)
    for (int i = 1; i < 3; i++)
      if (balance[hfx_next(mesh, corners[k], i)]) is_ringed = 0;
  for (int64_t k = 0; k < count; k++)
    for (int i = 1; i < 3; i++) balance[hfx_next(mesh, corners[k], i)] = 0;
  table->is_ringed[unit] = is_ringed;
  return area > 0.0 ? area : 1.0;
}

static double squared_of(int64_t steps) { return (double)(steps * steps); }

// Sets all that depends on the area of the whole cell.
static void share_out(const hfx_table *table, const hfx_spacing *spacing, int64_t unit, double area,
                        double cell, const extent *extents) {
  int64_t first = table->quad_starts[unit], count = table->quad_starts[unit + 1] - first;
  double share = area / cell, samples = 0.0, total = 0.0;
  for (int64_t k = 0; k < count; k++) {
    samples += squared_of(table->steps[first + k]);
    total += extents[k].total;
  }
  // Samples of triangles without area have no share: the vertex stands for all of its skin.
  double mine = total > 0.0 ? share * hfx_smaller(1.0 / (samples + 1.0), spacing->most_share) : share;
  double scale = (share - mine) / area;
  double reach = 0.0, mean = 0.0;
  double flat = FLAT_ENOUGH * spacing->distance[table->vertices[unit]];
  for (int64_t k = 0; k < count; k++) {
    hfx_quad *quad = table->quads + first + k;
    double height = hfx_height(quad);
    int is_curved = height * extents[k].size > flat;
    double up = is_curved ? 2.0 * height : 0.0, counts = is_curved ? 1.0 : 0.0;
    table->wholes[first + k] = extents[k].total * scale;
    table->heights[first + k] = is_curved ? height : 0.0;
    reach = hfx_larger(reach, extents[k].reach + up);
    mean += extents[k].total * (extents[k].mean + up);
    quad->to_one *= counts, quad->to_two *= counts, quad->between *= counts;
    double each = scale / squared_of(table->steps[first + k]);
    quad->area *= each, quad->by_s *= each, quad->by_t *= each;
  }
  table->unit_shares[unit] = share, table->vertex_shares[unit] = mine;
  table->reaches[unit] = table->is_split ? reach : 0.0;
  table->means[unit] = table->is_split ? mean / area : 0.0;
}

// See SkinTable.need: all but the samples. Returns how many there are. `place` and `balance` hold zeros for the vertices of the mesh, `extents` what is
// known of the quads of a cluster; `areas` and `cells` hold numbers for a cluster's units and cells,
// `counts` for its cells.
HFX_EXPORT int64_t hfx_fill(const hfx_table *table, const hfx_skin_mesh *mesh,
                            const hfx_spacing *spacing, int64_t requested, const int64_t *clusters,
                            int64_t *place, int64_t *balance, extent *extents,
                            double *areas, double *cells, int64_t *counts) {
  int64_t samples = 0;
  for (int64_t k = 0; k < requested; k++) {
    int64_t c = clusters[k], start = table->starts[c], end = start + table->unit_counts[c];
    int64_t first = table->cell_starts[c], count = table->cell_starts[c + 1] - first;
    int64_t quad = table->quad_starts[start], most = 1;
    for (int64_t p = start; p < table->starts[c + 1]; p++) place[table->vertices[p]] = p;
    for (int64_t i = 0; i < count; i++) cells[i] = 0.0, counts[i] = 0;
    for (int64_t u = start; u < end; u++) {
      int64_t at = table->quad_starts[u] - quad;
      areas[u - start] = fill_quads(table, mesh, spacing, u, place, balance, extents + at);
      cells[table->cell_of[u] - first] += areas[u - start];
    }
    for (int64_t u = start; u < end; u++) {
      int64_t at = table->quad_starts[u] - quad;
      int64_t *counted = counts + table->cell_of[u] - first;
      double cell = cells[table->cell_of[u] - first];
      share_out(table, spacing, u, areas[u - start], cell, extents + at);
      *counted += 1;
      for (int64_t q = table->quad_starts[u]; q < table->quad_starts[u + 1]; q++) {
        table->sample_starts[q] = samples;
        samples += table->steps[q] * table->steps[q];
        *counted += table->finest[q] * table->finest[q];
      }
      if (*counted > most) most = *counted;
    }
    table->most_samples[c] = most;
  }
  return samples;
}

// Writes the samples (4, room) of the clusters of the last call of hfx_fill.
HFX_EXPORT void hfx_place_samples(const hfx_table *table, int64_t requested, const int64_t *clusters,
                                  double *samples, int64_t room) {
  for (int64_t k = 0; k < requested; k++) {
    int64_t start = table->starts[clusters[k]], end = start + table->unit_counts[clusters[k]];
    table->blocks[clusters[k]] = samples, table->rooms[clusters[k]] = room;
    for (int64_t u = start; u < end; u++)
      for (int64_t q = table->quad_starts[u]; q < table->quad_starts[u + 1]; q++) {
        double *sample = samples + table->sample_starts[q], number = (double)table->steps[q];
        for (int64_t i = 0; i < table->steps[q]; i++)
          for (int64_t j = 0; j < table->steps[q]; j++, sample++) {
            double s = ((double)i + 0.5) / number, t = ((double)j + 0.5) / number;
            hfx_sample at = hfx_sample_at(table->quads + q, s, t);
            sample[0] = at.one;
            sample[room] = at.other;
            sample[2 * room] = at.height;
            sample[3 * room] = at.share;
          }
      }
  }
}
