/* SPDX-License-Identifier: MIT
 *
 * Skin of a body: where its vertices are, and which of them a volume holds. Included by
 * hfx_player.h. */
#ifndef HFX_SKIN_H
#define HFX_SKIN_H

#ifdef __cplusplus
extern "C" {
#endif

#define HFX_FARTHEST 3.4e38f
#define HFX_CHUNK 32u /* vertices that share a box */

typedef struct hfx_volume { /* a volume at one moment */
  float to_shape[12], box[6]; /* box: lowest and highest corner, world space */
  const float *to_world;
  uint32_t shape, falloff;
  float half, share;
} hfx_volume;

static inline void hfx_moved(const float *matrix, const float *point, float *found) {
  int i;
  for (i = 0; i < 3; i++, matrix += 4)
    found[i] = matrix[0] * point[0] + matrix[1] * point[1] + matrix[2] * point[2] + matrix[3];
}

/* Inverse of an affine matrix; 0: it has none, or holds what is no number. */
static inline int hfx_inverse(const float *matrix, float *found) {
  double of[3][3], size = 0.0, determinant;
  int i, k;
  for (i = 0; i < 3; i++)
    for (k = 0; k < 3; k++) {
      const int a = (k + 1) % 3, b = (k + 2) % 3, c = (i + 1) % 3, d = (i + 2) % 3;
      of[i][k] = (double)matrix[4 * a + c] * matrix[4 * b + d] -
                 (double)matrix[4 * a + d] * matrix[4 * b + c];
      size += fabs(matrix[4 * i + k]);
    }
  determinant = matrix[0] * of[0][0] + matrix[4] * of[0][1] + matrix[8] * of[0][2];
  if (!(fabs(determinant) > 1e-12 * size * size * size) || !(size < 1e12)) return 0;
  for (i = 0; i < 3; i++) {
    double moved = 0.0;
    for (k = 0; k < 3; k++) {
      found[4 * i + k] = (float)(of[i][k] / determinant);
      moved -= of[i][k] / determinant * matrix[4 * k + 3];
    }
    found[4 * i + 3] = (float)moved;
    if (!hfx_is_within(moved, -HFX_HUGE_F32, HFX_HUGE_F32)) return 0;
  }
  return 1;
}

/* Poses one vertex. */
static inline void hfx_pose_vertex(const hfx_body *self, const unsigned char *at, float *place) {
  const unsigned char *weight = hfx_record(self->clip, HFX_WGHT, hfx_u32(at + 16));
  const unsigned char *end = weight + 4 * (size_t)hfx_u32(at + 20);
  const float x = hfx_f32(at), y = hfx_f32(at + 4), z = hfx_f32(at + 8);
  float px = 0.0f, py = 0.0f, pz = 0.0f;
  place[0] = x, place[1] = y, place[2] = z;
  if (weight == end) return;
  for (; weight < end; weight += 4) {
    const float *m = self->matrices + 12 * (size_t)hfx_u16(weight);
    const float share = (float)hfx_u16(weight + 2);
    px += share * (m[0] * x + m[1] * y + m[2] * z + m[3]);
    py += share * (m[4] * x + m[5] * y + m[6] * z + m[7]);
    pz += share * (m[8] * x + m[9] * y + m[10] * z + m[11]);
  }
  place[0] = px * (1.0f / 65535.0f);
  place[1] = py * (1.0f / 65535.0f);
  place[2] = pz * (1.0f / 65535.0f);
}

/* Poses all vertices of a body, and boxes round each chunk of them. */
static inline void hfx_pose(hfx_body *self) {
  const uint32_t count = self->vertex_count;
  const unsigned char *at = hfx_record(self->clip, HFX_VERT, self->first_vertex);
  float *place = self->places, *box = self->boxes;
  uint32_t i = 0;
  while (i < count) {
    const uint32_t end = count - i > HFX_CHUNK ? i + HFX_CHUNK : count;
    float x0 = HFX_FARTHEST, y0 = HFX_FARTHEST, z0 = HFX_FARTHEST;
    float x1 = -HFX_FARTHEST, y1 = -HFX_FARTHEST, z1 = -HFX_FARTHEST;
    for (; i < end; i++, at += 24, place += 3) {
      float x, y, z;
      hfx_pose_vertex(self, at, place);
      x = place[0], y = place[1], z = place[2];
      x0 = x < x0 ? x : x0, y0 = y < y0 ? y : y0, z0 = z < z0 ? z : z0;
      x1 = x > x1 ? x : x1, y1 = y > y1 ? y : y1, z1 = z > z1 ? z : z1;
    }
    box[0] = x0, box[1] = y0, box[2] = z0, box[3] = x1, box[4] = y1, box[5] = z1;
    box += 6;
  }
}

/* Square of the gauge of a shape: up to 1 inside, docs/formats/clip.md. */
static inline float hfx_gauge(const hfx_volume *volume, const float *p) {
  const float x = p[0] * p[0], y = p[1] * p[1], z = p[2] * p[2];
  if (volume->shape == 0) return x > y ? (x > z ? x : z) : (y > z ? y : z);
  if (volume->shape == 1) return x + y + z;
  if (volume->shape == 2) return x + y > z ? x + y : z;
  {
    const float past = fabsf(p[2]) - volume->half;
    return x + y + (past > 0.0f ? past * past : 0.0f);
  }
}

static inline float hfx_weight(const hfx_volume *volume, float gauge) {
  float rise;
  if (!(gauge <= 1.0f)) return 0.0f;
  if (volume->falloff == 0 || volume->share <= 0.0f) return 1.0f;
  rise = (1.0f - sqrtf(gauge)) / volume->share;
  if (rise >= 1.0f) return 1.0f;
  return volume->falloff == 1 ? rise : rise * rise * (3.0f - 2.0f * rise);
}

/* Way in the world from the nearest place of a volume, as before stretching, to a point outside. */
static inline double hfx_distance(const hfx_volume *volume, const float *p) {
  float off[3] = {0.0f, 0.0f, 0.0f};
  const float half = volume->shape == 3 ? volume->half : 0.0f;
  double sum = 0.0;
  int c;
  if (volume->shape == 0) {
    for (c = 0; c < 3; c++) off[c] = p[c] - (float)hfx_clamped(p[c], -1.0, 1.0);
  } else {
    const float along = volume->shape == 2 ? 0.0f : p[2] - (float)hfx_clamped(p[2], -half, half);
    const double length = sqrt((double)p[0] * p[0] + (double)p[1] * p[1] + (double)along * along);
    const double outside = length > 1.0 ? 1.0 - 1.0 / length : 0.0;
    off[0] = (float)(p[0] * outside);
    off[1] = (float)(p[1] * outside);
    off[2] = volume->shape == 2 ? p[2] - (float)hfx_clamped(p[2], -1.0, 1.0)
                                : (float)(along * outside);
  }
  for (c = 0; c < 3; c++) {
    const float *row = volume->to_world + 4 * c;
    const double way = (double)row[0] * off[0] + (double)row[1] * off[1] + (double)row[2] * off[2];
    sum += way * way;
  }
  return sqrt(sum);
}

/* Sets a volume up; 0: its matrix is flat, and nothing is in it. */
static inline int hfx_place(hfx_volume *volume, const unsigned char *effect, const float *matrix) {
  int c, k;
  volume->shape = hfx_u32(effect + 20);
  volume->half = hfx_f32(effect + 24);
  volume->falloff = hfx_u32(effect + 28);
  volume->share = hfx_f32(effect + 32);
  volume->to_world = matrix;
  for (c = 0; c < 3; c++) {
    float reach = 0.0f;
    for (k = 0; k < 3; k++)
      reach += fabsf(matrix[4 * c + k]) * (k == 2 && volume->shape == 3 ? 1.0f + volume->half : 1.0f);
    volume->box[c] = matrix[4 * c + 3] - reach;
    volume->box[3 + c] = matrix[4 * c + 3] + reach;
  }
  return hfx_inverse(matrix, volume->to_shape);
}

/* True if a chunk of vertices may be within `reach` metres of a volume. */
static inline int hfx_is_near(const hfx_volume *volume, const float *box, float reach) {
  int c;
  for (c = 0; c < 3; c++)
    if (!(box[c] <= volume->box[3 + c] + reach && box[3 + c] >= volume->box[c] - reach)) return 0;
  return 1;
}

#ifdef __cplusplus
}
#endif

#endif
