/* SPDX-License-Identifier: MIT
 *
 * Haptic surfaces under a finger or a pointer: docs/formats/clip.md, "Surfaces". Included by
 * hfx_player.h. */
#ifndef HFX_SURFACE_H
#define HFX_SURFACE_H

#ifdef __cplusplus
extern "C" {
#endif

#define HFX_REST_MM_S 0.1
#define HFX_MOST_TILES 4.0   /* length of a path along one axis, in widths or heights of the map */
#define HFX_FARTHEST_UV 1e6

HFX_API uint32_t hfx_clip_surfaces(const hfx_clip *clip) { return hfx_count(clip, HFX_SURF); }

HFX_API int hfx_clip_surface(const hfx_clip *clip, uint32_t index, hfx_surface *found) {
  const unsigned char *at, *map;
  if (index >= hfx_clip_surfaces(clip)) return HFX_ERROR_INDEX;
  at = hfx_record(clip, HFX_SURF, index);
  map = hfx_record(clip, HFX_HMAP, hfx_u32(at + 4));
  found->name = hfx_text(clip, at);
  found->lowest_m_s2 = hfx_f32(at + 8);
  found->highest_m_s2 = hfx_f32(at + 12);
  found->lowest_hz = hfx_f32(at + 16);
  found->highest_hz = hfx_f32(at + 20);
  found->uv_width_mm = hfx_f32(at + 24);
  found->uv_height_mm = hfx_f32(at + 28);
  found->columns = hfx_u32(map);
  found->rows = hfx_u32(map + 4);
  found->width_mm = hfx_f32(map + 8);
  found->height_mm = hfx_f32(map + 12);
  found->tiles = (int)hfx_u32(map + 16);
  return 0;
}

HFX_API void hfx_surface_lift(hfx_stroke *stroke) { stroke->is_touching = 0; }

/* Column or row of a map: repeated, or that of the border. */
static inline uint32_t hfx_cell(double cell, uint32_t count, int tiles) {
  if (tiles) cell -= count * floor(cell / count);
  return (uint32_t)hfx_clamped(cell, 0.0, count - 1.0);
}

typedef struct hfx_strongest_texel {
  uint32_t texel, number; /* as stored; row * columns + column */
} hfx_strongest_texel;

static inline void hfx_meet(const unsigned char *texels, const hfx_surface *surface, double column,
                            double row, hfx_strongest_texel *strongest) {
  const uint32_t number = hfx_cell(row, surface->rows, surface->tiles) * surface->columns +
                          hfx_cell(column, surface->columns, surface->tiles);
  const uint32_t texel = hfx_u32(texels + 4 * (size_t)number);
  const uint32_t intensity = texel >> 8, best = strongest->texel >> 8;
  if (intensity < best || (intensity == best && number >= strongest->number)) return;
  strongest->texel = texel;
  strongest->number = number;
}

/* Strongest texel on the straight path from `a` to `b`, in texels. A texel is entered where the
 * path crosses a line between columns (axis 0) or rows (axis 1); nothing is sampled. */
static inline uint32_t hfx_strongest_on_path(const unsigned char *texels,
                                             const hfx_surface *surface, const double *a,
                                             const double *b) {
  hfx_strongest_texel strongest = {0, HFX_NONE};
  int axis;
  hfx_meet(texels, surface, floor(a[0]), floor(a[1]), &strongest);
  for (axis = 0; axis < 2; axis++) {
    const double way = b[axis] - a[axis], across = b[1 - axis] - a[1 - axis];
    const double first = floor(a[axis]), sign = way < 0.0 ? -1.0 : 1.0;
    const double crossed = fabs(floor(b[axis]) - first);
    double line;
    for (line = 1.0; line <= crossed; line += 1.0) {
      /* Rightwards line first + 1 comes first; leftwards the line `first` itself. */
      const double share = (first - a[axis] + (way < 0.0) + sign * line) / way;
      const double along = first + sign * line, other = floor(a[1 - axis] + share * across);
      hfx_meet(texels, surface, axis ? other : along, axis ? along : other, &strongest);
    }
  }
  return strongest.texel;
}

HFX_API int hfx_surface_feel(const hfx_clip *clip, uint32_t surface, hfx_stroke *stroke, double u,
                             double v, double speed_mm_s, double seconds, float *out) {
  hfx_surface found;
  const unsigned char *texels;
  double a[2], b[2], x_mm, y_mm, tiles;
  uint32_t texel;
  int is_moving;
  out[0] = out[1] = 0.0f;
  if (hfx_clip_surface(clip, surface, &found)) {
    hfx_surface_lift(stroke);
    return HFX_ERROR_INDEX;
  }
  if (!hfx_is_within(u, -HFX_FARTHEST_UV, HFX_FARTHEST_UV) ||
      !hfx_is_within(v, -HFX_FARTHEST_UV, HFX_FARTHEST_UV)) {
    hfx_surface_lift(stroke);
    return 0;
  }
  is_moving = stroke->is_touching && stroke->surface == surface;
  if (!is_moving) stroke->u = u, stroke->v = v;
  a[0] = stroke->u * found.columns, a[1] = stroke->v * found.rows;
  b[0] = u * found.columns, b[1] = v * found.rows;
  x_mm = (u - stroke->u) * found.width_mm, y_mm = (v - stroke->v) * found.height_mm;
  tiles = fabs(u - stroke->u) > fabs(v - stroke->v) ? fabs(u - stroke->u) : fabs(v - stroke->v);
  if (tiles > HFX_MOST_TILES) { /* only the end of a path that is too long */
    a[0] = b[0] - (b[0] - a[0]) * (HFX_MOST_TILES / tiles);
    a[1] = b[1] - (b[1] - a[1]) * (HFX_MOST_TILES / tiles);
  }
  if (speed_mm_s >= 0.0) is_moving = is_moving && speed_mm_s > HFX_REST_MM_S;
  else is_moving = is_moving && sqrt(x_mm * x_mm + y_mm * y_mm) > HFX_REST_MM_S * hfx_elapsed(seconds);
  stroke->u = u;
  stroke->v = v;
  stroke->surface = surface;
  stroke->is_touching = 1;
  texels = hfx_record(clip, HFX_TEXL, hfx_u32(hfx_record(clip, HFX_HMAP, hfx_u32(
      hfx_record(clip, HFX_SURF, surface) + 4)) + 20));
  texel = hfx_strongest_on_path(texels, &found, a, b);
  if (is_moving && texel >> 8)
    out[0] = (float)(found.lowest_m_s2 +
                     ((double)found.highest_m_s2 - found.lowest_m_s2) * (texel >> 8) / 16777215.0);
  out[1] = (float)(found.lowest_hz +
                   ((double)found.highest_hz - found.lowest_hz) * (texel & 255u) / 255.0);
  return 0;
}

#ifdef __cplusplus
}
#endif

#endif
