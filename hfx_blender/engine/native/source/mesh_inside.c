// SPDX-License-Identifier: GPL-3.0-or-later
// Inside test of points for a closed mesh: InsideGrid.contains of volume/mesh_inside.py.

#include "hfx_native.h"
#include "mesh.h"
#include "numbers.h"

// Memory that will be read soon.
#if defined(__GNUC__)
#define HFX_SOON(place) __builtin_prefetch(place)
#else
#define HFX_SOON(place) ((void)0)
#endif

// The numbers of a triangle: corners by height y, the edges low to high, low to middle, middle
// to high with their slopes, and which way it faces. What tells whether it is crossed at all
// fills one cache line.
enum {
  Y_LOW, Y_MIDDLE, Y_HIGH, X_LOW, X_MIDDLE, SLOPE_X_LONG, SLOPE_X_LOWER, SLOPE_X_UPPER,
  Z_LOW, Z_MIDDLE, SLOPE_Z_LONG, SLOPE_Z_LOWER, SLOPE_Z_UPPER, SIGN, SPAN = 16
};

// A listed triangle is one number: eight bounds of where it is in its column, one a byte and each
// below 128. A point beyond one of them is not above or below the triangle. All are told at once:
// a byte of `limits` loses its highest bit where the bound is greater.
static const uint64_t ALL = UINT64_C(0x8080808080808080);

// Resolution: x and y over a column's width, x + y and x - y over twice that, z over the height
// of all cells.
enum { STEPS = 128 };

// A number as a step, what is beyond 0 and 1 as the first and the last: bounds and what may be
// beyond them are counted alike, so that nothing gets past one.
static uint64_t step_of(double share) {
  const double step = share * STEPS;
  return step > 0.0 ? step < STEPS ? (uint64_t)step : STEPS - 1 : 0;
}

// Limits that a point may be beyond, least first: its places in a column and the height of all cells.
static uint64_t limits_of(double x, double y, double z) {
  const uint64_t last = STEPS - 1;
  const uint64_t across = step_of(x), along = step_of(y), high = step_of(z);
  const uint64_t sum = step_of(0.5 * (x + y)), difference = step_of(0.5 * (x - y) + 0.5);
  return ALL | along | (last - along) << 8 | across << 16 | (last - across) << 24 |
         (last - high) << 32 | sum << 40 | (last - sum) << 48 | difference << 56;
}

// Bounds (count) of `listed` triangles in their `columns` (count), which are `along` to a row of
// them, with a margin that is far above rounding; corners (triangles, 3, 3), in cells.
HFX_EXPORT void hfx_mesh_bounds(const double *corners, const int64_t *listed,
                                const int64_t *columns, int64_t count, int64_t along,
                                int64_t height, double margin, int64_t *bounds) {
  const uint64_t last = STEPS - 1;
  for (int64_t n = 0; n < count; ++n) {
    const double *corner = corners + 9 * listed[n];
    const double i = (double)(columns[n] / along), j = (double)(columns[n] % along);
    double least[5], most[5];
    for (int c = 0; c < 3; ++c) {
      const double x = corner[3 * c] - i, y = corner[3 * c + 1] - j;
      const double places[5] = {x, y, corner[3 * c + 2] / (double)height, 0.5 * (x + y),
                                0.5 * (x - y) + 0.5};
      for (int k = 0; k < 5; ++k) {
        least[k] = c ? lesser(least[k], places[k]) : places[k];
        most[k] = c ? greater(most[k], places[k]) : places[k];
      }
    }
    uint64_t from[5], to[5];
    for (int k = 0; k < 5; ++k) {
      from[k] = step_of(least[k] - margin);
      to[k] = last - step_of(most[k] + margin);
    }
    bounds[n] = (int64_t)(from[1] | to[1] << 8 | from[0] << 16 | to[0] << 24 | to[2] << 32 |
                          from[3] << 40 | to[3] << 48 | from[4] << 56);
  }
}

// Term of a triangle in the winding number of a point: where it is crossed at or above it.
// Without a branch: nobody could foretell which way it goes.
static int64_t winding_of(const double *span, double x, double y, double z) {
  const int upper = y >= span[Y_MIDDLE];
  const double long_rise = y - span[Y_LOW], short_rise = y - span[Y_LOW + upper];
  const double long_x = span[X_LOW] + long_rise * span[SLOPE_X_LONG];
  const double short_x = span[X_LOW + upper] + short_rise * span[SLOPE_X_LOWER + upper];
  const double long_z = span[Z_LOW] + long_rise * span[SLOPE_Z_LONG];
  const double short_z = span[Z_LOW + upper] + short_rise * span[SLOPE_Z_LOWER + upper];
  const double share = (x - long_x) / (short_x - long_x);
  const int left = x < short_x, right = !(x < long_x);
  const int crosses = (span[Y_LOW] <= y) & (y < span[Y_HIGH]) & (left == right) &
                      (long_z + share * (short_z - long_z) >= z);
  return crosses * (2 * left - 1) * (int64_t)span[SIGN];
}

// Points that are looked at together: while one waits for memory, so do the others.
enum { BLOCK = 64, PAIRS = 512 };

typedef struct {
  double x, y, z;
  uint64_t limits;
  int64_t winding, at, run;
} Query;

// A listed triangle that may be crossed by the way up from a point.
typedef struct {
  int64_t query, listed;
} Pair;

static void add_windings(Pair *pairs, int64_t count, const int64_t *listed, const double *spans,
                         Query *queries) {
  for (int64_t k = 0; k < count; ++k) {
    pairs[k].listed = listed[pairs[k].listed];
    HFX_SOON(spans + SPAN * pairs[k].listed);
    HFX_SOON(spans + SPAN * pairs[k].listed + 8);
  }
  for (int64_t k = 0; k < count; ++k) {
    Query *mine = queries + pairs[k].query;
    mine->winding += winding_of(spans + SPAN * pairs[k].listed, mine->x, mine->y, mine->z);
  }
}

// Tests points (3, count) for being inside, (count).
HFX_EXPORT void hfx_mesh_inside(const hfx_grid *grid, const double *points, int64_t count,
                                uint8_t *inside) {
  const double *box = grid->box, *scale = grid->scale, *spans = grid->spans;
  const int64_t *cells = grid->cells, *codes = grid->codes, *offsets = grid->offsets;
  const int64_t *beyond = grid->beyond, *listed = grid->listed, *bounds = grid->bounds;
  const int64_t a = grid->axes[0], b = grid->axes[1], c = grid->axes[2];
  const double *xs = points + a * count, *ys = points + b * count, *zs = points + c * count;
  const double height = 1.0 / (double)cells[2];
  for (int64_t first = 0; first < count; first += BLOCK) {
    const int64_t end = first + BLOCK < count ? first + BLOCK : count;
    Query queries[BLOCK + 1];
    Pair pairs[PAIRS + 1];
    int64_t cell[BLOCK + 1], near = 0, unsure = 0, paired = 0;
    for (int64_t n = first; n < end; ++n) {
      double x = xs[n], y = ys[n], z = zs[n];
      const int within = (x >= box[a]) & (x <= box[3 + a]) & (y >= box[b]) & (y <= box[3 + b]) &
                         (z >= box[c]) & (z <= box[3 + c]);
      x = within ? (x - box[a]) * scale[0] : 0.0;
      y = within ? (y - box[b]) * scale[1] : 0.0;
      z = within ? (z - box[c]) * scale[2] : 0.0;
      int64_t i = (int64_t)x, j = (int64_t)y, k = (int64_t)z;
      i = i < cells[0] ? i : cells[0] - 1;
      j = j < cells[1] ? j : cells[1] - 1;
      k = k < cells[2] ? k : cells[2] - 1;
      queries[near] = (Query){x, y, z, limits_of(x - (double)i, y - (double)j, z * height), 0, n, 0};
      cell[near] = (i * cells[1] + j) * cells[2] + k;
      HFX_SOON(codes + cell[near]);
      inside[n] = 0;
      near += within;
    }
    for (int64_t n = 0; n < near; ++n) {
      const int64_t run = codes[cell[n]];
      inside[queries[n].at] = run == -2;
      queries[unsure] = queries[n];
      queries[unsure].run = run;
      unsure += run >= 0;
      HFX_SOON(offsets + (run < 0 ? 0 : run));
      HFX_SOON(beyond + (run < 0 ? 0 : run));
    }
    for (int64_t n = 0; n < unsure; ++n) {
      const int64_t run = queries[n].run;
      queries[n].winding = beyond[run];
      for (int64_t k = offsets[run]; k < offsets[run + 1]; k += 8) HFX_SOON(bounds + k);
    }
    for (int64_t n = 0; n < unsure; ++n) {
      const uint64_t limits = queries[n].limits;
      const int64_t stop = offsets[queries[n].run + 1];
      for (int64_t k = offsets[queries[n].run]; k < stop; ++k) {
        pairs[paired] = (Pair){n, k};
        paired += ((limits - (uint64_t)bounds[k]) & ALL) == ALL;
        if (paired == PAIRS) {
          add_windings(pairs, paired, listed, spans, queries);
          paired = 0;
        }
      }
    }
    add_windings(pairs, paired, listed, spans, queries);
    for (int64_t n = 0; n < unsure; ++n) inside[queries[n].at] = queries[n].winding != 0;
  }
}
