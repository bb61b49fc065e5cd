/* SPDX-License-Identifier: MIT
 *
 * Touch of a volume and the skin of a model: chunks within reach, weights, speed. Included by
 * hfx_player.h. */
#ifndef HFX_TOUCH_H
#define HFX_TOUCH_H

#ifdef __cplusplus
extern "C" {
#endif

typedef struct hfx_touch { /* an effect on the skin of a model, at one moment */
  hfx_felt *felt;
  hfx_volume volume;
  hfx_body *body;
  const unsigned char *model;
  float *weights;                  /* of the model */
  uint32_t vertices, first, count; /* of the model: vertices, first chunk of the body, chunks */
  uint32_t from, to;               /* chunks that have weights */
  float bounds[HFX_CHUNK];         /* of the boxes that hfx_next_near is at */
} hfx_touch;

/* First chunk from `k` on that may be within reach; begins at 0. */
static inline uint32_t hfx_next_near(hfx_touch *touch, uint32_t k, float reach) {
  for (; k < touch->count; k++) {
    const uint32_t at = touch->first + k;
    if (k == 0 || at % HFX_CHUNK == 0)
      hfx_least_gauges(&touch->volume, touch->body->boxes + at / HFX_CHUNK, reach, touch->bounds);
    if (touch->bounds[at % HFX_CHUNK] <= 1.0f + HFX_ROUNDING) break;
  }
  return k;
}

/* Poses a chunk of the model; `box`: as of hfx_pose_chunk. */
static inline void hfx_pose_model_chunk(const hfx_touch *touch, const float *matrices, uint32_t k,
                               hfx_chunk *chunk, float *box) {
  const uint32_t i = HFX_CHUNK * k;
  const unsigned char *at = hfx_record(&touch->body->clip, HFX_VERT, hfx_u32(touch->model + 12) + i);
  hfx_pose_chunk(&touch->body->clip, matrices, at, touch->vertices - i, chunk, box);
}

/* A chunk of the model in this frame, posed when it is first needed. */
static inline const hfx_chunk *hfx_posed(hfx_touch *touch, uint32_t k) {
  hfx_body *self = touch->body;
  const uint32_t at = touch->first + k, i = at % HFX_CHUNK;
  hfx_boxes *boxes = self->boxes + at / HFX_CHUNK;
  hfx_chunk *chunk = self->places + at;
  float box[8], middle[4], half[4];
  int c;
  if (chunk->frame == self->frame) return chunk;
  hfx_pose_model_chunk(touch, self->bones->now, k, chunk, box);
  for (c = 0; c < 4; c++) {
    middle[c] = 0.5f * box[c] + 0.5f * box[4 + c];
    half[c] = 0.5f * box[4 + c] - 0.5f * box[c];
    half[c] += HFX_ROUNDING * (fabsf(middle[c]) + half[c]);
  }
  boxes->centre.x[i] = middle[0], boxes->centre.y[i] = middle[1], boxes->centre.z[i] = middle[2];
  boxes->half.x[i] = half[0], boxes->half.y[i] = half[1], boxes->half.z[i] = half[2];
  boxes->slack[i] = 0.0f;
  chunk->frame = self->frame;
  return chunk;
}

/* The same in the frame before. */
static inline const hfx_chunk *hfx_posed_before(hfx_touch *touch, uint32_t k) {
  hfx_body *self = touch->body;
  hfx_chunk *chunk = self->before + touch->first + k;
  float box[8];
  if (chunk->frame == self->frame - 1) return chunk;
  hfx_pose_model_chunk(touch, self->bones->before, k, chunk, box);
  chunk->frame = self->frame - 1;
  return chunk;
}

/* Widens the range of chunks that have weights. */
static inline void hfx_widen_range(hfx_touch *touch, uint32_t k) {
  if (k < touch->from) touch->from = k;
  if (k >= touch->to) touch->to = k + 1;
}

/* Next chunk from `k` on that has weights. */
static inline uint32_t hfx_next_weighted(const hfx_touch *touch, uint32_t k) {
  for (; k < touch->to; k++) {
    const float *weights = touch->weights + HFX_CHUNK * (size_t)k;
    int i, is_any = 0;
    for (i = 0; i < HFX_CHUNK; i++) is_any |= weights[i] > 0.0f;
    if (is_any) break;
  }
  return k;
}

/* Takes weights from what fills the last chunk. */
static inline void hfx_clear_padding(const hfx_touch *touch) {
  uint32_t i;
  for (i = touch->vertices; i < HFX_CHUNK * touch->count; i++) touch->weights[i] = 0.0f;
}

/* Weights of what is inside; whether anything is. The weights are 0 before. */
static inline int hfx_contact_weights(hfx_touch *touch) {
  uint32_t k;
  for (k = hfx_next_near(touch, 0, 0.0f); k < touch->count; k = hfx_next_near(touch, k + 1, 0.0f)) {
    hfx_chunk p;
    float gauge[HFX_CHUNK];
    hfx_transform(touch->volume.to_shape, hfx_posed(touch, k), &p);
    hfx_gauge(&touch->volume, &p, gauge);
    if (hfx_falloff_weights(&touch->volume, gauge, touch->weights + HFX_CHUNK * (size_t)k))
      hfx_widen_range(touch, k);
  }
  hfx_clear_padding(touch);
  return hfx_next_weighted(touch, touch->from) < touch->to;
}

/* Mean speed of touched skin against the volume since the moment before, m/s. */
static inline double hfx_mean_speed(hfx_touch *touch, double seconds) {
  float then[12];
  double sum = 0.0, weights = 0.0;
  uint32_t k;
  if (!touch->body->was_posed || !touch->felt->was_on || !(seconds > 0.0)) return 0.0;
  if (!hfx_inverse(touch->felt->before, then)) return 0.0;
  for (k = touch->from; (k = hfx_next_weighted(touch, k)) < touch->to; k++) {
    const float *weight = touch->weights + HFX_CHUNK * (size_t)k;
    hfx_chunk p, q;
    const float *m = touch->volume.to_world;
    float way[HFX_CHUNK];
    int i;
    hfx_transform(touch->volume.to_shape, hfx_posed(touch, k), &p);
    hfx_transform(then, hfx_posed_before(touch, k), &q);
    for (i = 0; i < HFX_CHUNK; i++) {
      const float x = p.x[i] - q.x[i], y = p.y[i] - q.y[i], z = p.z[i] - q.z[i];
      const float a = m[0] * x + m[1] * y + m[2] * z, b = m[4] * x + m[5] * y + m[6] * z;
      const float d = m[8] * x + m[9] * y + m[10] * z;
      way[i] = sqrtf(a * a + b * b + d * d);
    }
    for (i = 0; i < HFX_CHUNK; i++) {
      if (!(weight[i] > 0.0f)) continue;
      sum += weight[i] * way[i];
      weights += weight[i];
    }
  }
  return weights > 0.0 ? sum / weights / seconds : 0.0;
}

#define HFX_HALVINGS 12 /* of the time between two frames */

/* Share of the time since the moment before at which the first of what is touched was inside.
 * Skin moves straight in shape space, where shapes are convex: halving finds when. */
static inline double hfx_onset(hfx_touch *touch) {
  float then[12], first = 1.0f;
  uint32_t k;
  if (!hfx_inverse(touch->felt->before, then)) return 1.0;
  for (k = touch->from; (k = hfx_next_weighted(touch, k)) < touch->to; k++) {
    const float *weight = touch->weights + HFX_CHUNK * (size_t)k;
    float gauge[HFX_CHUNK], low[HFX_CHUNK], high[HFX_CHUNK];
    hfx_chunk p, q, at;
    int i, step;
    hfx_transform(touch->volume.to_shape, hfx_posed(touch, k), &p);
    hfx_transform(then, hfx_posed_before(touch, k), &q);
    for (i = 0; i < HFX_CHUNK; i++) low[i] = 0.0f, high[i] = 1.0f;
    for (step = 0; step < HFX_HALVINGS; step++) {
      for (i = 0; i < HFX_CHUNK; i++) {
        const float share = 0.5f * (low[i] + high[i]);
        at.x[i] = q.x[i] + share * (p.x[i] - q.x[i]);
        at.y[i] = q.y[i] + share * (p.y[i] - q.y[i]);
        at.z[i] = q.z[i] + share * (p.z[i] - q.z[i]);
      }
      hfx_gauge(&touch->volume, &at, gauge);
      for (i = 0; i < HFX_CHUNK; i++) {
        const float share = 0.5f * (low[i] + high[i]);
        if (gauge[i] <= 1.0f) high[i] = share;
        else low[i] = share;
      }
    }
    for (i = 0; i < HFX_CHUNK; i++)
      if (weight[i] > 0.0f && high[i] < first) first = high[i];
  }
  return first;
}

#ifdef __cplusplus
}
#endif

#endif
