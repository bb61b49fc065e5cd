/* SPDX-License-Identifier: MIT
 *
 * Volumes: their shapes, and the weights that they give to vertices. Included by hfx_player.h. */
#ifndef HFX_VOLUME_H
#define HFX_VOLUME_H

#ifdef __cplusplus
extern "C" {
#endif

#define HFX_FARTHEST 3.4e38f

/* A loop that gcc makes one vector instruction of, if it does not unroll it before. */
#if defined(__GNUC__) && !defined(__clang__)
#define HFX_KEEP_LOOP _Pragma("GCC unroll 1")
#else
#define HFX_KEEP_LOOP
#endif

/* An address that is a multiple of 16, as vector instructions want it. */
#if defined(__GNUC__) && !defined(__cplusplus)
#define HFX_ALIGNED(address) __builtin_assume_aligned(address, 16)
#else
#define HFX_ALIGNED(address) (address)
#endif

/* Promise to compilers that no other pointer reaches the data of this pointer. */
#ifdef __cplusplus
#define HFX_RESTRICT __restrict
#else
#define HFX_RESTRICT restrict
#endif

typedef struct hfx_volume { /* a volume at one moment */
  const float *to_world, *to_shape;
  float to_shape_sizes[12]; /* absolute values, without translation */
  uint32_t shape, falloff;
  float half, per_share; /* per_share: 1 over the share of the falloff */
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
  determinant = 1.0 / determinant;
  for (i = 0; i < 3; i++) {
    double moved = 0.0;
    for (k = 0; k < 3; k++) {
      found[4 * i + k] = (float)(of[i][k] * determinant);
      moved -= of[i][k] * determinant * matrix[4 * k + 3];
    }
    found[4 * i + 3] = (float)moved;
    if (!hfx_is_within(moved, -HFX_HUGE_F32, HFX_HUGE_F32)) return 0;
  }
  return 1;
}

/* Takes a chunk to another space. Like all loops over a chunk, which have a fixed length and no
 * branches, this becomes vector instructions. */
static inline void hfx_transform(const float *m, const hfx_chunk *of,
                                 hfx_chunk *HFX_RESTRICT found) {
  int i;
  for (i = 0; i < HFX_CHUNK; i++) {
    const float x = of->x[i], y = of->y[i], z = of->z[i];
    found->x[i] = m[0] * x + m[1] * y + m[2] * z + m[3];
    found->y[i] = m[4] * x + m[5] * y + m[6] * z + m[7];
    found->z[i] = m[8] * x + m[9] * y + m[10] * z + m[11];
  }
}

static const float hfx_zeros[HFX_CHUNK] = {0.0f};

/* Sum of the numbers of a chunk. */
static inline float hfx_total(const float *values) {
  float sums[HFX_LANES] = {0.0f};
  int k, i;
  for (k = 0; k < HFX_CHUNK; k += HFX_LANES) {
    HFX_KEEP_LOOP
    for (i = 0; i < HFX_LANES; i++) sums[i] += values[k + i];
  }
  return (sums[0] + sums[1]) + (sums[2] + sums[3]);
}

/* Largest of the numbers of a chunk, leaving out NaN. */
static inline float hfx_largest(const float *values) {
  float most[HFX_LANES];
  int k, i;
  for (i = 0; i < HFX_LANES; i++) most[i] = -HFX_FARTHEST;
  for (k = 0; k < HFX_CHUNK; k += HFX_LANES) {
    HFX_KEEP_LOOP
    for (i = 0; i < HFX_LANES; i++) most[i] = values[k + i] > most[i] ? values[k + i] : most[i];
  }
  for (i = 1; i < HFX_LANES; i++) most[0] = most[i] > most[0] ? most[i] : most[0];
  return most[0];
}

/* Largest product of the numbers of two chunks, 0 or more. */
static inline float hfx_largest_product(const float *one, const float *other) {
  float most[HFX_LANES] = {0.0f};
  int k, i;
  for (k = 0; k < HFX_CHUNK; k += HFX_LANES) {
    HFX_KEEP_LOOP
    for (i = 0; i < HFX_LANES; i++) {
      const float product = one[k + i] * other[k + i];
      most[i] = product > most[i] ? product : most[i];
    }
  }
  for (i = 1; i < HFX_LANES; i++) most[0] = most[i] > most[0] ? most[i] : most[0];
  return most[0];
}

/* Smallest of the numbers of a chunk, leaving out NaN. */
static inline float hfx_smallest(const float *values) {
  float least[HFX_LANES];
  int k, i;
  for (i = 0; i < HFX_LANES; i++) least[i] = HFX_FARTHEST;
  for (k = 0; k < HFX_CHUNK; k += HFX_LANES) {
    HFX_KEEP_LOOP
    for (i = 0; i < HFX_LANES; i++) least[i] = values[k + i] < least[i] ? values[k + i] : least[i];
  }
  for (i = 1; i < HFX_LANES; i++) least[0] = least[i] < least[0] ? least[i] : least[0];
  return least[0];
}

/* Raises the numbers of a chunk to others that are larger. */
static inline void hfx_raise(float *HFX_RESTRICT values, const float *others) {
  int i;
  for (i = 0; i < HFX_CHUNK; i++) values[i] = others[i] > values[i] ? others[i] : values[i];
}

/* Squares of the gauge of a shape, docs/formats/clip.md, at places in its space. */
static inline void hfx_gauge(const hfx_volume *volume, const hfx_chunk *p,
                             float *HFX_RESTRICT found) {
  const float *x = p->x, *y = p->y, *z = p->z, half = volume->half;
  int i;
  if (volume->shape == 0) {
    for (i = 0; i < HFX_CHUNK; i++) {
      const float a = x[i] * x[i], b = y[i] * y[i], c = z[i] * z[i], most = a > b ? a : b;
      found[i] = most > c ? most : c;
    }
  } else if (volume->shape == 1) {
    for (i = 0; i < HFX_CHUNK; i++) found[i] = x[i] * x[i] + y[i] * y[i] + z[i] * z[i];
  } else if (volume->shape == 2) {
    for (i = 0; i < HFX_CHUNK; i++) {
      const float across = x[i] * x[i] + y[i] * y[i], along = z[i] * z[i];
      found[i] = across > along ? across : along;
    }
  } else {
    for (i = 0; i < HFX_CHUNK; i++) {
      const float past = fabsf(z[i]) - half, over = past > 0.0f ? past : 0.0f;
      found[i] = x[i] * x[i] + y[i] * y[i] + over * over;
    }
  }
}

/* Weights of the vertices of a chunk from squares of their gauge; whether any is inside. */
static inline int hfx_falloff_weights(const hfx_volume *volume, const float *gauge,
                                      float *HFX_RESTRICT weights) {
  float rise[HFX_CHUNK];
  int i, is_any = 0;
  for (i = 0; i < HFX_CHUNK; i++) is_any |= gauge[i] <= 1.0f;
  if (!is_any) return 0;
  if (volume->falloff == 0) {
    for (i = 0; i < HFX_CHUNK; i++) weights[i] = gauge[i] <= 1.0f ? 1.0f : 0.0f;
    return 1;
  }
  for (i = 0; i < HFX_CHUNK; i++) {
    const float depth = (1.0f - sqrtf(gauge[i] < 1.0f ? gauge[i] : 1.0f)) * volume->per_share;
    rise[i] = depth < 1.0f ? depth : 1.0f;
  }
  if (volume->falloff == 1)
    for (i = 0; i < HFX_CHUNK; i++) weights[i] = rise[i];
  else
    for (i = 0; i < HFX_CHUNK; i++) weights[i] = rise[i] * rise[i] * (3.0f - 2.0f * rise[i]);
  return 1;
}

/* Lengths in the world of the ways from the nearest place of a volume, as before stretching, to
 * points outside. */
static inline void hfx_distances_outside(const hfx_volume *volume, const hfx_chunk *of,
                                         float *HFX_RESTRICT found) {
  const float *m = volume->to_world;
  const float half = volume->shape == 3 ? volume->half : 0.0f;
  hfx_chunk off;
  int i;
  if (volume->shape == 0) {
    for (i = 0; i < HFX_CHUNK; i++) {
      const float x = fabsf(of->x[i]) - 1.0f, y = fabsf(of->y[i]) - 1.0f;
      const float z = fabsf(of->z[i]) - 1.0f;
      off.x[i] = x > 0.0f ? (of->x[i] > 0.0f ? x : -x) : 0.0f;
      off.y[i] = y > 0.0f ? (of->y[i] > 0.0f ? y : -y) : 0.0f;
      off.z[i] = z > 0.0f ? (of->z[i] > 0.0f ? z : -z) : 0.0f;
    }
  } else {
    const float end = volume->shape == 2 ? 1.0f : half; /* of a cylinder, or of the segment */
    const float share = volume->shape == 2 ? 0.0f : 1.0f;
    for (i = 0; i < HFX_CHUNK; i++) {
      const float x = of->x[i], y = of->y[i], past = fabsf(of->z[i]) - end;
      const float over = past > 0.0f ? (of->z[i] > 0.0f ? past : -past) : 0.0f;
      const float round = share * over, length = sqrtf(x * x + y * y + round * round);
      const float outside = length > 1.0f ? 1.0f - 1.0f / length : 0.0f;
      off.x[i] = x * outside;
      off.y[i] = y * outside;
      off.z[i] = volume->shape == 2 ? over : over * outside;
    }
  }
  for (i = 0; i < HFX_CHUNK; i++) {
    const float x = m[0] * off.x[i] + m[1] * off.y[i] + m[2] * off.z[i];
    const float y = m[4] * off.x[i] + m[5] * off.y[i] + m[6] * off.z[i];
    const float z = m[8] * off.x[i] + m[9] * off.y[i] + m[10] * off.z[i];
    found[i] = sqrtf(x * x + y * y + z * z);
  }
}

/* Sets a volume up; `to_shape`: the inverse of its matrix. */
static inline void hfx_place(hfx_volume *volume, const unsigned char *effect, const float *matrix,
                             const float *to_shape) {
  int k;
  volume->shape = hfx_u32(effect + 20);
  volume->half = hfx_f32(effect + 24);
  volume->falloff = hfx_f32(effect + 32) > 1e-6f ? hfx_u32(effect + 28) : 0;
  volume->per_share = volume->falloff ? 1.0f / hfx_f32(effect + 32) : 0.0f;
  volume->to_world = matrix;
  volume->to_shape = to_shape;
  for (k = 0; k < 12; k++)
    volume->to_shape_sizes[k] = k % 4 == 3 ? 0.0f : fabsf(to_shape[k]);
}

/* Squares of the least gauge that anything within `reach` metres of boxes may have. */
static inline void hfx_least_gauges(const hfx_volume *volume, const hfx_boxes *boxes, float reach,
                                    float *found) {
  hfx_chunk centre, half, sizes, nearest;
  int i;
  for (i = 0; i < HFX_CHUNK; i++) {
    half.x[i] = boxes->half.x[i] + reach;
    half.y[i] = boxes->half.y[i] + reach;
    half.z[i] = boxes->half.z[i] + reach;
  }
  hfx_transform(volume->to_shape, &boxes->centre, &centre);
  hfx_transform(volume->to_shape_sizes, &half, &sizes);
  for (i = 0; i < HFX_CHUNK; i++) { /* the place of each box that is nearest to the shape */
    const float x = fabsf(centre.x[i]) - sizes.x[i], y = fabsf(centre.y[i]) - sizes.y[i];
    const float z = fabsf(centre.z[i]) - sizes.z[i];
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
