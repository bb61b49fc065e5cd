// SPDX-License-Identifier: GPL-3.0-or-later
// Groups of cells, which bound at rest the sizes of cells in a pose; see skin/bound_clusters.py.

#include <math.h>
#include <string.h>

#include "hfx_native.h"
#include "numbers.h"
#include "skin.h"

#define PI 3.141592653589793
#define DISC (2.0 / 3.0)
#define LEAST_M 1e-12
#define LEAST_WEIGHT 0.01

// Groups of clusters, one after the other, with the first group and pair of each; see hfx_groups.
typedef struct {
  int64_t *first_groups, *first_pairs;  // (requested + 1,)
  int64_t *starts;                      // one more for each cluster than it has groups
  double *distances, *boxes;
  int64_t *bones;
  double *shares, *changes;
} hfx_found_groups;

// Some cells, and what is known of each.
typedef struct {
  int64_t count, bones;
  double *weights;    // (count, bones)
  double *changes;    // (count, bones)
  double *places;     // (count, 3)
  double *distances;  // (count,)
} cells;

static double distance(const double *a, const double *b) {
  double x = a[0] - b[0], y = a[1] - b[1], z = a[2] - b[2];
  return sqrt(x * x + y * y + z * z);
}

// See cell_sizes._weights, of the first places of a cluster.
static void weigh(const hfx_cluster *cluster, int64_t places, double *weights, double *rest) {
  memset(weights, 0, (size_t)(places * cluster->bone_count) * sizeof *weights);
  for (int64_t p = 0; p < places; p++, rest += 3) {
    int64_t first = cluster->firsts[p], last = cluster->firsts[p + 1];
    double more[3] = {0.0, 0.0, 0.0};  // in the order in which numpy adds
    const double *place = cluster->rest + 4 * p;
    for (int64_t e = first; e < last; e++) {
      weights[p * cluster->bone_count + cluster->entry_bones[e]] = cluster->weights[e];
      for (int i = 0; i < 3 && e > first; i++) more[i] += cluster->weights[e] * place[i];
    }
    for (int i = 0; i < 3; i++) rest[i] = cluster->weights[first] * place[i] + more[i];
  }
}

// Mean difference of weights of a unit's skin from its own, (bones,); returns its radius.
static double weight_changes_around(const hfx_skin_mesh *mesh, const int32_t *ids, const int64_t *place,
                          int64_t unit, int64_t bones, const double *weights, const double *rest,
                          double *changes) {
  const float *here = mesh->vertices + 3 * (int64_t)ids[unit];
  double gaps = 0.0, before = 0.0;
  memset(changes, 0, (size_t)bones * sizeof *changes);
  for (int64_t k = mesh->starts[ids[unit]]; k < mesh->starts[ids[unit] + 1]; k++) {
    int64_t vertex = hfx_next(mesh, mesh->corners[k], 1), other = place[vertex];
    const float *there = mesh->vertices + 3 * (int64_t)ids[other];
    double gap = distance(rest + 3 * unit, rest + 3 * other);
    gaps += gap;
    before += distance((double[]){here[0], here[1], here[2]}, (double[]){there[0], there[1], there[2]});
    gap = hfx_larger(gap, LEAST_M);
    for (int64_t b = 0; b < bones; b++) {
      double slope = fabs(weights[unit * bones + b] - weights[other * bones + b]) / gap;
      changes[b] = hfx_larger(changes[b], slope);
    }
  }
  double grown = gaps / hfx_larger(before, LEAST_M);
  double radius = sqrt((double)mesh->areas_m2[ids[unit]] / PI) * grown;
  for (int64_t b = 0; b < bones; b++) changes[b] *= DISC * radius;
  return radius;
}

static int64_t largest_of(const double *values, int64_t count) {
  int64_t largest = 0;
  for (int64_t k = 1; k < count; k++)
    if (values[k] > values[largest]) largest = k;
  return largest;
}

// Cells that the same bones move alike; how many groups. `numbers` holds the bones' squared.
static int64_t group_alike(const cells *all, int64_t *group, int64_t *numbers) {
  int64_t kinds = all->bones * all->bones, groups = 0;
  memset(numbers, 0, (size_t)kinds * sizeof *numbers);
  for (int64_t c = 0; c < all->count; c++) {
    group[c] = largest_of(all->weights + c * all->bones, all->bones) * all->bones +
               largest_of(all->changes + c * all->bones, all->bones);
    numbers[group[c]] = 1;
  }
  for (int64_t k = 0; k < kinds; k++)
    if (numbers[k]) numbers[k] = groups++;
  for (int64_t c = 0; c < all->count; c++) group[c] = numbers[group[c]];
  return groups;
}

// See _Groups.of: from cells and the group of each, whose bones are these.
static void write_groups(const cells *all, const int64_t *group, int64_t groups, const int64_t *bones,
                 int64_t *sizes, double *room, const hfx_found_groups *found, int64_t cluster) {
  int64_t first = found->first_groups[cluster], pair = found->first_pairs[cluster], start = pair;
  double *shares = take(&room, groups * all->bones), *largest = take(&room, groups * all->bones);
  int64_t *starts = found->starts + first + cluster;
  memset(sizes, 0, (size_t)groups * sizeof *sizes);
  memset(shares, 0, (size_t)(groups * all->bones) * sizeof *shares);
  for (int64_t c = 0; c < all->count; c++) {
    int64_t g = group[c], is_first = !sizes[g]++;
    double *low = found->boxes + 6 * (first + g), *high = low + 3, *most = largest + g * all->bones;
    double *farthest = found->distances + first + g;
    *farthest = is_first ? all->distances[c] : hfx_larger(*farthest, all->distances[c]);
    for (int i = 0; i < 3; i++) {
      double place = all->places[3 * c + i];
      low[i] = is_first ? place : hfx_smaller(low[i], place);
      high[i] = is_first ? place : hfx_larger(high[i], place);
    }
    for (int64_t b = 0; b < all->bones; b++) {
      double change = all->changes[c * all->bones + b];
      most[b] = is_first ? change : hfx_larger(most[b], change);
      shares[g * all->bones + b] += all->weights[c * all->bones + b];
    }
  }
  for (int64_t g = 0; g < groups; g++) {
    double *box = found->boxes + 6 * (first + g), *share = shares + g * all->bones, whole = 0.0;
    for (int i = 0; i < 3; i++) {
      double low = box[i], high = box[3 + i];
      box[i] = 0.5 * (low + high);
      box[3 + i] = 0.5 * (high - low);
    }
    for (int64_t b = 0; b < all->bones; b++) {
      share[b] /= (double)sizes[g];
      if (share[b] > LEAST_WEIGHT) whole += share[b];
    }
    *starts++ = pair - start;
    for (int64_t b = 0; b < all->bones; b++) {
      double change = largest[g * all->bones + b], part = share[b] / whole;
      if (!(share[b] > LEAST_WEIGHT || change > LEAST_WEIGHT)) continue;
      found->bones[pair] = bones[b];
      found->shares[pair] = part > LEAST_WEIGHT ? part : 0.0;
      found->changes[pair++] = change;
    }
  }
  *starts = pair - start;
  found->first_groups[cluster + 1] = first + groups;
  found->first_pairs[cluster + 1] = pair;
}

// Bones of either of two clusters, ascending, and where those of each are among them.
static int64_t unite(const hfx_cluster *one, const hfx_cluster *other, int64_t *every,
                     int64_t *of_one, int64_t *of_other) {
  int64_t count = 0, a = 0, b = 0;
  while (a < one->bone_count || b < other->bone_count) {
    int is_one = b == other->bone_count ||
                 (a < one->bone_count && one->bones[a] <= other->bones[b]);
    int is_other = a == one->bone_count ||
                   (b < other->bone_count && other->bones[b] <= one->bones[a]);
    every[count] = is_one ? one->bones[a] : other->bones[b];
    if (is_one) of_one[a++] = count;
    if (is_other) of_other[b++] = count;
    count++;
  }
  return count;
}

// Fills in the groups of some clusters. `surface` are those of the mesh, `own` those of the model's vertices where they
// are others, else null. `place` holds a zero for each vertex of the mesh; `counts` and `room` have
// room for what a cluster needs.
HFX_EXPORT void hfx_cell_groups(const hfx_table *table, const hfx_skin_mesh *mesh,
                                const hfx_cluster *surface, const hfx_cluster *own, int64_t requested,
                                const int64_t *clusters, int64_t *place, int64_t *counts,
                                double *room, const hfx_found_groups *found) {
  found->first_groups[0] = found->first_pairs[0] = 0;
  for (int64_t k = 0; k < requested; k++) {
    int64_t c = clusters[k], start = table->starts[c], units = table->unit_counts[c];
    int64_t places = table->place_counts[c], first = table->cell_starts[c];
    int64_t count = table->cell_starts[c + 1] - first;
    const hfx_cluster *skin = surface + c;
    const int32_t *ids = table->vertices + start;
    double *left = room, *weights = take(&left, places * skin->bone_count);
    double *rest = take(&left, 3 * places), *changes = take(&left, units * skin->bone_count);
    double *radii = take(&left, units);
    for (int64_t p = 0; p < places; p++) place[ids[p]] = p;
    weigh(skin, places, weights, rest);
    for (int64_t u = 0; u < units; u++)
      radii[u] = weight_changes_around(mesh, ids, place, u, skin->bone_count, weights, rest,
                             changes + u * skin->bone_count);
    for (int64_t p = 0; p < places; p++) place[ids[p]] = 0;
    if (!own) {
      double *distances = take(&left, units);
      for (int64_t u = 0; u < units; u++) distances[u] = DISC * radii[u];
      cells all = {units, skin->bone_count, weights, changes, rest, distances};
      int64_t *sizes = counts + units, groups = group_alike(&all, counts, sizes + units);
      write_groups(&all, counts, groups, skin->bones, sizes, left, found, k);
      continue;
    }
    const hfx_cluster *model = own + c;
    int64_t *every = counts, *of_skin = every + skin->bone_count + model->bone_count;
    int64_t *of_model = of_skin + skin->bone_count, *group = of_model + model->bone_count;
    int64_t bones = unite(skin, model, every, of_skin, of_model);
    double *sums = take(&left, count), *theirs = take(&left, bones);
    double *own_weights = take(&left, count * model->bone_count);
    cells all = {count, bones, take(&left, count * bones), take(&left, count * bones),
                 take(&left, 3 * count), take(&left, count)};
    weigh(model, count, own_weights, all.places);
    memset(sums, 0, (size_t)count * sizeof *sums);
    memset(all.distances, 0, (size_t)count * sizeof *all.distances);
    memset(all.weights, 0, (size_t)(count * bones) * sizeof *all.weights);
    memset(all.changes, 0, (size_t)(count * bones) * sizeof *all.changes);
    for (int64_t i = 0; i < count; i++) {
      group[i] = i;
      for (int64_t b = 0; b < model->bone_count; b++)
        all.weights[i * bones + of_model[b]] = own_weights[i * model->bone_count + b];
    }
    for (int64_t u = 0; u < units; u++)
      sums[table->cell_of[start + u] - first] += (double)mesh->areas_m2[ids[u]];
    for (int64_t u = 0; u < units; u++) {
      int64_t owner = table->cell_of[start + u] - first;
      double share = (double)mesh->areas_m2[ids[u]] / sums[owner];
      double way = distance(rest + 3 * u, all.places + 3 * owner);
      // A mean is no more than the root of the mean square: half a disc's squared radius.
      all.distances[owner] += share * sqrt(way * way + 0.5 * (radii[u] * radii[u]));
      for (int64_t b = 0; b < bones; b++) theirs[b] = fabs(all.weights[owner * bones + b]);
      for (int64_t b = 0; b < skin->bone_count; b++) {
        int64_t at = u * skin->bone_count + b, to = of_skin[b];
        theirs[to] = fabs(weights[at] - all.weights[owner * bones + to]) + changes[at];
      }
      for (int64_t b = 0; b < bones; b++) all.changes[owner * bones + b] += share * theirs[b];
    }
    write_groups(&all, group, count, every, group + count, left, found, k);
  }
}
