// SPDX-License-Identifier: GPL-3.0-or-later
// Boxes around what bones move, without posing any of it; see engine/skin/skinned_model.py.

#include <math.h>

#include "broad.h"
#include "hfx_native.h"
#include "skin_posing.h"

#define COLUMNS 12     // of a bone, 2 doubles each
#define LARGEST 1e100  // nothing overflows below it

// Smaller and larger of numbers; the second one where either is NaN.
static inline hfx_two least(hfx_two a, hfx_two b) {
  hfx_mask is_a = a < b;
  return (hfx_two)(((hfx_mask)a & is_a) | ((hfx_mask)b & ~is_a));
}

static inline hfx_two most(hfx_two a, hfx_two b) {
  hfx_mask is_a = a > b;
  return (hfx_two)(((hfx_mask)a & is_a) | ((hfx_mask)b & ~is_a));
}

// A box: lowest x and y, highest x and y, lowest z negated and highest z.
typedef struct {
  hfx_two low, high, z;
} hfx_corners;

static const hfx_corners NOWHERE = {
    {INFINITY, INFINITY}, {-INFINITY, -INFINITY}, {-INFINITY, -INFINITY}};

static inline hfx_corners around(hfx_corners one, hfx_corners other) {
  return (hfx_corners){least(one.low, other.low), most(one.high, other.high), most(one.z, other.z)};
}

// By columns: (x, y) of each; their sizes; z of each and its size; z of the last. Its stretch comes after them.
static void columns_of(const double m[12], hfx_loose *columns) {
  for (int j = 0; j < 4; j++) columns[j] = (hfx_two){m[j], m[4 + j]};
  for (int j = 0; j < 3; j++) {
    columns[4 + j] = (hfx_two){fabs(m[j]), fabs(m[4 + j])};
    columns[7 + j] = (hfx_two){m[8 + j], fabs(m[8 + j])};
  }
  columns[10] = (hfx_two){m[11], 0.0};
}

// The box of a cluster in the matrices that columns_of gave.
static inline hfx_corners corners_of(const hfx_outline *outline, int64_t cluster,
                                     const hfx_loose *columns) {
  hfx_corners found = NOWHERE;
  for (int64_t p = outline->starts[cluster]; p < outline->starts[cluster + 1]; p++) {
    const hfx_loose *box = (const hfx_loose *)(outline->boxes + 6 * p);
    const hfx_loose *m = columns + COLUMNS * outline->slots[p];
    hfx_two x = box[0], y = box[1], z = box[2];  // centre and half edge along each axis
    hfx_two middle = m[0] * x[0] + m[1] * y[0] + m[2] * z[0] + m[3];
    hfx_two reach = m[4] * x[1] + m[5] * y[1] + m[6] * z[1];
    hfx_two up = m[7] * x + m[8] * y + m[9] * z + m[10];
    hfx_two ends = {-up[0], up[0]}, size = {up[1], up[1]};
    found = around((hfx_corners){middle - reach, middle + reach, ends + size}, found);
  }
  return found;
}

// The same where a matrix holds something that is not a number: that stays, as what the cluster may
// touch is not known.
static hfx_corners unsure_corners(const hfx_outline *outline, int64_t cluster, const double *columns) {
  double low[3], high[3];
  for (int i = 0; i < 3; i++) low[i] = INFINITY, high[i] = -INFINITY;
  for (int64_t p = outline->starts[cluster]; p < outline->starts[cluster + 1]; p++) {
    const double *box = outline->boxes + 6 * p;
    const double *m = columns + 2 * COLUMNS * outline->slots[p];
    for (int i = 0; i < 3; i++) {
      double middle = 0.0, reach = 0.0;
      for (int j = 0; j < 3; j++) {
        double each = i < 2 ? m[2 * j + i] : m[14 + 2 * j];
        middle += each * box[2 * j], reach += fabs(each) * box[2 * j + 1];
      }
      middle += i < 2 ? m[6 + i] : m[20];
      low[i] = hfx_smaller(low[i], middle - reach);
      high[i] = hfx_larger(high[i], middle + reach);
    }
  }
  return (hfx_corners){{low[0], low[1]}, {high[0], high[1]}, {-low[2], high[2]}};
}

// The largest stretch of any bone that moves a cluster.
static inline double stretch_of(const hfx_outline *outline, int64_t cluster, const hfx_loose *columns) {
  double most = 0.0;
  for (int64_t p = outline->starts[cluster]; p < outline->starts[cluster + 1]; p++)
    most = hfx_larger(most, columns[COLUMNS * outline->slots[p] + 11][0]);
  return most;
}

static inline void put(hfx_corners box, double *low, double *high) {
  low[0] = box.low[0], low[1] = box.low[1], low[2] = -box.z[0];
  high[0] = box.high[0], high[1] = box.high[1], high[2] = box.z[1];
}

// See Outline.bounds of cluster_bounds.py: boxes around clusters, (rows, clusters, 3) each, around
// all of them at each row, (rows, 2, 3), and around each at all rows, (clusters, 2, 3). Skin lies
// beyond what bones move by `margins`, NULL: not at all. `room` holds 24 numbers for each bone.
HFX_EXPORT void hfx_bounds(const hfx_outline *outline, int64_t rows, int64_t posed_bones, const double *posed,
                           const int64_t *row, const double *to_target, const double *margins,
                           double *room, double *low, double *high, double *of_rows,
                           double *of_clusters) {
  hfx_loose *columns = (hfx_loose *)room, *over = (hfx_loose *)of_clusters;
  int64_t clusters = outline->clusters;
  for (int64_t c = 0; c < clusters; c++)
    over[3 * c] = NOWHERE.low, over[3 * c + 1] = NOWHERE.high, over[3 * c + 2] = NOWHERE.z;
  for (int64_t n = 0; n < rows; n++) {
    const double *target = to_target + 16 * n;
    int is_sure = 1;
    for (int64_t b = 0; b < outline->bone_count; b++) {
      double m[12], sum = 0.0;
      hfx_find_matrix(posed + 12 * row[n] * posed_bones, posed_bones, outline->bones[b], target, m);
      columns_of(m, columns + COLUMNS * b);
      if (margins) columns[COLUMNS * b + 11] = (hfx_two){hfx_stretch(m, 4), 0.0};
      for (int i = 0; i < 12; i++) sum += fabs(m[i]);
      is_sure &= sum <= LARGEST;
    }
    hfx_corners whole = NOWHERE;
    double is_unknown = 0.0;
    for (int64_t c = 0; c < clusters; c++, low += 3, high += 3) {
      hfx_corners box = is_sure ? corners_of(outline, c, columns) : unsure_corners(outline, c, room);
      if (margins) {
        double margin = stretch_of(outline, c, columns) * margins[c];
        box.low -= margin, box.high += margin, box.z += margin;
      }
      put(box, low, high);
      whole = around(box, whole);
      if (!is_sure) {
        hfx_two sum = box.low + box.high + box.z;
        is_unknown += sum[0] + sum[1];
      }
      hfx_corners before = {over[3 * c], over[3 * c + 1], over[3 * c + 2]};
      hfx_corners both = around(box, before);
      over[3 * c] = both.low, over[3 * c + 1] = both.high, over[3 * c + 2] = both.z;
    }
    put(whole, of_rows + 6 * n, of_rows + 6 * n + 3);
    for (int i = 0; i < 6 && isnan(is_unknown); i++) of_rows[6 * n + i] = NAN;
  }
  for (int64_t c = 0; c < clusters; c++, of_clusters += 6) {
    hfx_corners both = {over[3 * c], over[3 * c + 1], over[3 * c + 2]};
    put(both, of_clusters, of_clusters + 3);
  }
}
