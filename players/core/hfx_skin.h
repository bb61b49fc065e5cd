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
#define HFX_ANYWHERE 1e30f   /* slack of a chunk whose place is not known */
#define HFX_ROUNDING 4e-6f   /* of places in the world, far more than a sum of products has */

/* A loop that gcc makes one vector instruction of, if it does not unroll it before. */
#if defined(__GNUC__) && !defined(__clang__)
#define HFX_KEEP_LOOP _Pragma("GCC unroll 1")
#else
#define HFX_KEEP_LOOP
#endif

typedef struct hfx_volume { /* a volume at one moment */
  float to_shape[12], to_shape_sizes[12]; /* sizes: their absolute values, without translation */
  float low[3], high[3];                  /* its box in the world */
  const float *to_world;
  uint32_t shape, falloff;
  float half, share;
} hfx_volume;

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

/* Poses one vertex; the fourth number of its place means nothing. */
static inline void hfx_pose_vertex(const hfx_clip *clip, const float *matrices, const unsigned char *at,
                                   float *place) {
  const unsigned char *weight = hfx_record(clip, HFX_WGHT, hfx_u32(at + 16));
  const unsigned char *end = weight + 4 * (size_t)hfx_u32(at + 20);
  const float x = hfx_f32(at), y = hfx_f32(at + 4), z = hfx_f32(at + 8);
  float sum[4] = {0.0f, 0.0f, 0.0f, 0.0f};
  int c;
  place[0] = x, place[1] = y, place[2] = z;
  if (weight == end) return;
  for (; weight < end; weight += 4) {
    const float *m = matrices + sizeof(hfx_bone_pose) / sizeof(float) * hfx_u16(weight);
    const float share = (float)hfx_u16(weight + 2);
    HFX_KEEP_LOOP
    for (c = 0; c < 4; c++) sum[c] += share * (m[c] * x + m[4 + c] * y + m[8 + c] * z + m[12 + c]);
  }
  for (c = 0; c < 4; c++) place[c] = sum[c] * (1.0f / 65535.0f);
}

/* Poses a chunk of `count` or more vertices from the record `at` on; `box`: its lowest and highest
 * corner. */
static inline void hfx_pose_chunk(const hfx_clip *clip, const float *matrices, const unsigned char *at,
                                  uint32_t count, hfx_chunk *chunk, float *box) {
  float low[4], high[4], place[4] = {0.0f, 0.0f, 0.0f, 0.0f};
  uint32_t i;
  int c;
  for (c = 0; c < 4; c++) low[c] = HFX_FARTHEST, high[c] = -HFX_FARTHEST;
  for (i = 0; i < HFX_CHUNK; i++, at += 24) {
    if (i < count) hfx_pose_vertex(clip, matrices, at, place);
    for (c = 0; c < 4; c++) {
      low[c] = place[c] < low[c] ? place[c] : low[c];
      high[c] = place[c] > high[c] ? place[c] : high[c];
    }
    chunk->x[i] = place[0], chunk->y[i] = place[1], chunk->z[i] = place[2];
  }
  for (c = 0; c < 4; c++) box[c] = low[c], box[4 + c] = high[c];
}

static inline uint32_t hfx_chunks(uint32_t vertices) {
  return vertices / HFX_CHUNK + (vertices % HFX_CHUNK > 0);
}

/* Sets up what is known of a body before it is posed. */
static inline void hfx_find_rest(hfx_body *self) {
  const hfx_clip *clip = self->clip;
  const unsigned char *body = hfx_record(clip, HFX_BODY, self->body);
  uint32_t i, k, m;
  int c;
  for (i = 0; i < hfx_u32(body + 8); i++)
    for (c = 0; c < 4; c++)
      self->bones[i].low[c] = HFX_FARTHEST, self->bones[i].high[c] = -HFX_FARTHEST;
  for (m = 0; m < hfx_u32(body + 16); m++) {
    const unsigned char *model = hfx_record(clip, HFX_MODL, hfx_u32(body + 12) + m);
    for (i = 0; i < hfx_u32(model + 16); i++) {
      const unsigned char *at = hfx_record(clip, HFX_VERT, hfx_u32(model + 12) + i);
      for (k = 0; k < hfx_u32(at + 20); k++) {
        hfx_bone_pose *bone =
            self->bones + hfx_u16(hfx_record(clip, HFX_WGHT, hfx_u32(at + 16) + k));
        for (c = 0; c < 3; c++) {
          const float place = hfx_f32(at + 4 * c);
          if (place < bone->low[c]) bone->low[c] = place;
          if (place > bone->high[c]) bone->high[c] = place;
        }
      }
    }
  }
}

/* The longest way along an axis that a vertex may have moved since the frame before, metres. */
static inline float hfx_motion(const hfx_body *self, uint32_t bones) {
  float most[4] = {0.0f, 0.0f, 0.0f, 0.0f}, longest;
  uint32_t i;
  int c;
  for (i = 0; i < bones; i++) {
    const hfx_bone_pose *bone = self->bones + i;
    float middle[3], half[3];
    if (bone->low[0] > bone->high[0]) continue; /* nothing follows it */
    for (c = 0; c < 3; c++) {
      middle[c] = 0.5f * bone->low[c] + 0.5f * bone->high[c];
      half[c] = 0.5f * bone->high[c] - 0.5f * bone->low[c];
    }
    for (c = 0; c < 4; c++) {
      const float x = bone->now[c] - bone->before[c], y = bone->now[4 + c] - bone->before[4 + c];
      const float z = bone->now[8 + c] - bone->before[8 + c], t = bone->now[12 + c] - bone->before[12 + c];
      const float way = fabsf(x * middle[0] + y * middle[1] + z * middle[2] + t) +
                        fabsf(x) * half[0] + fabsf(y) * half[1] + fabsf(z) * half[2];
      most[c] = way <= most[c] ? most[c] : way; /* NaN, too */
    }
  }
  longest = most[0] <= most[1] ? most[1] : most[0];
  longest = longest <= most[2] ? most[2] : longest;
  return longest < HFX_ANYWHERE ? longest : HFX_ANYWHERE;
}

/* Begins a frame: all chunks may have moved, and none is posed. */
static inline void hfx_pose(hfx_body *self) {
  const float way = self->was_posed ? hfx_motion(self, hfx_clip_bones(self->clip, self->body)) : HFX_ANYWHERE;
  hfx_chunk *spare = self->before;
  uint32_t k;
  int i;
  self->before = self->places;
  self->places = spare;
  self->frame++;
  for (k = 0; k < hfx_chunks(self->chunks); k++)
    for (i = 0; i < HFX_CHUNK; i++) {
      const float slack = self->boxes[k].slack[i] + way;
      self->boxes[k].slack[i] = slack < HFX_ANYWHERE ? slack : HFX_ANYWHERE;
    }
}

/* Takes a chunk to another space. Like all loops over a chunk, which have a fixed length and no
 * branches, this becomes vector instructions. */
static inline void hfx_moved(const float *m, const hfx_chunk *of, hfx_chunk *found) {
  int i;
  for (i = 0; i < HFX_CHUNK; i++) {
    const float x = of->x[i], y = of->y[i], z = of->z[i];
    found->x[i] = m[0] * x + m[1] * y + m[2] * z + m[3];
    found->y[i] = m[4] * x + m[5] * y + m[6] * z + m[7];
    found->z[i] = m[8] * x + m[9] * y + m[10] * z + m[11];
  }
}

/* Squares of the gauge of a shape, docs/formats/clip.md, at places in its space. */
static inline void hfx_gauge(const hfx_volume *volume, const hfx_chunk *p, float *found) {
  const float half = volume->half;
  float across[HFX_CHUNK];
  int i;
  if (volume->shape == 0) {
    for (i = 0; i < HFX_CHUNK; i++) {
      const float x = p->x[i] * p->x[i], y = p->y[i] * p->y[i], z = p->z[i] * p->z[i];
      const float most = x > y ? x : y;
      found[i] = most > z ? most : z;
    }
    return;
  }
  for (i = 0; i < HFX_CHUNK; i++) across[i] = p->x[i] * p->x[i] + p->y[i] * p->y[i];
  if (volume->shape == 1) {
    for (i = 0; i < HFX_CHUNK; i++) found[i] = across[i] + p->z[i] * p->z[i];
  } else if (volume->shape == 2) {
    for (i = 0; i < HFX_CHUNK; i++) {
      const float z = p->z[i] * p->z[i];
      found[i] = across[i] > z ? across[i] : z;
    }
  } else {
    for (i = 0; i < HFX_CHUNK; i++) {
      const float past = fabsf(p->z[i]) - half, over = past > 0.0f ? past : 0.0f;
      found[i] = across[i] + over * over;
    }
  }
}

/* Weights of the vertices of a chunk from squares of their gauge; whether any is inside. */
static inline int hfx_weigh(const hfx_volume *volume, const float *gauge, float *weights) {
  float rise[HFX_CHUNK];
  int i, is_any = 0;
  for (i = 0; i < HFX_CHUNK; i++) is_any |= gauge[i] <= 1.0f;
  if (!is_any) return 0;
  if (volume->falloff == 0 || volume->share <= 0.0f) {
    for (i = 0; i < HFX_CHUNK; i++) weights[i] = gauge[i] <= 1.0f ? 1.0f : 0.0f;
    return 1;
  }
  for (i = 0; i < HFX_CHUNK; i++) rise[i] = sqrtf(gauge[i] < 1.0f ? gauge[i] : 1.0f);
  for (i = 0; i < HFX_CHUNK; i++) {
    rise[i] = (1.0f - rise[i]) / volume->share;
    rise[i] = rise[i] < 1.0f ? rise[i] : 1.0f;
  }
  if (volume->falloff == 1)
    for (i = 0; i < HFX_CHUNK; i++) weights[i] = rise[i];
  else
    for (i = 0; i < HFX_CHUNK; i++) weights[i] = rise[i] * rise[i] * (3.0f - 2.0f * rise[i]);
  return 1;
}

/* Way in the world from the nearest place of a volume, as before stretching, to a point outside. */
static inline double hfx_distance(const hfx_volume *volume, const hfx_chunk *of, int i) {
  const float p[3] = {of->x[i], of->y[i], of->z[i]};
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
    volume->low[c] = matrix[4 * c + 3] - reach;
    volume->high[c] = matrix[4 * c + 3] + reach;
  }
  if (!hfx_inverse(matrix, volume->to_shape)) return 0;
  for (k = 0; k < 12; k++) volume->to_shape_sizes[k] = k % 4 == 3 ? 0.0f : fabsf(volume->to_shape[k]);
  return 1;
}

/* Squares of the least gauge that anything within `reach` metres of boxes may have. */
static inline void hfx_bound(const hfx_volume *volume, const hfx_boxes *boxes, float reach, float *found) {
  hfx_chunk centre, half, nearest;
  int i;
  for (i = 0; i < HFX_CHUNK; i++) {
    const float more = boxes->slack[i] + reach;
    const float x = boxes->half.x[i] + more, y = boxes->half.y[i] + more, z = boxes->half.z[i] + more;
    nearest.x[i] = x, nearest.y[i] = y, nearest.z[i] = z;
  }
  hfx_moved(volume->to_shape, &boxes->centre, &centre);
  hfx_moved(volume->to_shape_sizes, &nearest, &half);
  for (i = 0; i < HFX_CHUNK; i++) {
    const float x = fabsf(centre.x[i]) - half.x[i], y = fabsf(centre.y[i]) - half.y[i];
    const float z = fabsf(centre.z[i]) - half.z[i];
    nearest.x[i] = x > 0.0f ? x : 0.0f;
    nearest.y[i] = y > 0.0f ? y : 0.0f;
    nearest.z[i] = z > 0.0f ? z : 0.0f;
  }
  hfx_gauge(volume, &nearest, found);
}

#ifdef __cplusplus
}
#endif

#endif
