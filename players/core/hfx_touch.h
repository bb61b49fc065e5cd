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
  float *weights, *peaks;          /* of the model's vertices; the largest of each chunk */
  uint32_t vertices, first, count; /* of the model: vertices, first chunk of the body, chunks */
  uint32_t from, to;               /* chunks outside of these have no weight */
  uint32_t nears;                  /* chunks within reach */
} hfx_touch;

/* Tells whether anything within `reach` metres of some boxes may be in a volume. */
static inline int hfx_is_row_near(const hfx_volume *volume, const hfx_boxes *boxes, float reach) {
  const float *m = volume->to_world;
  const float end = volume->shape == 3 ? 1.0f + volume->half : 1.0f;
  int c;
  for (c = 0; c < 3; c++, m += 4) {
    float half = fabsf(m[0]) + fabsf(m[1]) + fabsf(m[2]) * end + reach;
    half += HFX_ROUNDING * (half + fabsf(m[3]));
    if (m[3] + half < boxes->low[c] || m[3] - half > boxes->high[c]) return 0;
  }
  return 1;
}

/* Finds the chunks that may be within reach of a volume, ascending. */
static inline void hfx_find_near(hfx_touch *touch, float reach) {
  const uint32_t end = touch->first + touch->count;
  hfx_near *near = touch->body->near;
  float bounds[HFX_CHUNK];
  uint32_t row, at;
  for (row = touch->first / HFX_CHUNK; row < hfx_chunk_count(end); row++) {
    const hfx_boxes *boxes = touch->body->boxes + row;
    const uint32_t from = HFX_CHUNK * row > touch->first ? HFX_CHUNK * row : touch->first;
    const uint32_t to = HFX_CHUNK * (row + 1) < end ? HFX_CHUNK * (row + 1) : end;
    if (!hfx_is_row_near(&touch->volume, boxes, reach)) continue;
    hfx_least_gauges(&touch->volume, boxes, reach, bounds);
    for (at = from; at < to; at++) {
      near->chunk = at - touch->first;
      near += bounds[at % HFX_CHUNK] <= 1.0f + HFX_ROUNDING;
    }
  }
  touch->nears = (uint32_t)(near - touch->body->near);
}

/* Poses a chunk of a body, and finds its box. */
static inline void hfx_pose_box(hfx_body *self, uint32_t at) {
  const uint32_t i = at % HFX_CHUNK;
  hfx_boxes *boxes = self->boxes + at / HFX_CHUNK;
  hfx_chunk *chunk = self->places + at;
  float lows[3][HFX_LANES], highs[3][HFX_LANES], *middle[3], *half[3];
  int c, k;
  hfx_pose_chunk(self->rest + at, self->pulls, self->pose, chunk, lows, highs);
  middle[0] = boxes->centre.x + i, middle[1] = boxes->centre.y + i, middle[2] = boxes->centre.z + i;
  half[0] = boxes->half.x + i, half[1] = boxes->half.y + i, half[2] = boxes->half.z + i;
  for (c = 0; c < 3; c++) {
    float low = lows[c][0], high = highs[c][0];
    for (k = 1; k < HFX_LANES; k++) {
      low = lows[c][k] < low ? lows[c][k] : low;
      high = highs[c][k] > high ? highs[c][k] : high;
    }
    *middle[c] = 0.5f * low + 0.5f * high;
    *half[c] = 0.5f * high - 0.5f * low;
    *half[c] += HFX_ROUNDING * (fabsf(*middle[c]) + *half[c]);
    if (*half[c] >= 0.0f && *half[c] < HFX_UNKNOWN) continue;
    *middle[c] = 0.0f, *half[c] = HFX_UNKNOWN; /* bones that are no numbers */
  }
  chunk->frame = self->frame;
}

/* A chunk of the model in this frame, posed when it is first needed. */
static inline const hfx_chunk *hfx_posed(hfx_touch *touch, uint32_t k) {
  const uint32_t at = touch->first + k;
  if (touch->body->places[at].frame != touch->body->frame) hfx_pose_box(touch->body, at);
  return touch->body->places + at;
}

/* The same in the frame before. */
static inline const hfx_chunk *hfx_posed_before(hfx_touch *touch, uint32_t k) {
  hfx_body *self = touch->body;
  const uint32_t at = touch->first + k;
  hfx_chunk *chunk = self->before + at;
  float lows[3][HFX_LANES], highs[3][HFX_LANES];
  if (chunk->frame == self->frame - 1) return chunk;
  hfx_pose_chunk(self->rest + at, self->pulls, self->pose_before, chunk, lows, highs);
  chunk->frame = self->frame - 1;
  return chunk;
}

/* Takes note of the new weights of a chunk; `peak`: the largest, or more if any is above 0. */
static inline void hfx_note_weights(hfx_touch *touch, uint32_t k, float peak) {
  float *weights = touch->weights + HFX_CHUNK * (size_t)k;
  uint32_t i;
  for (i = touch->vertices - HFX_CHUNK * k; i < HFX_CHUNK; i++) weights[i] = 0.0f; /* padding */
  touch->peaks[k] = peak;
  if (!(peak > 0.0f)) return;
  touch->felt->chunk_bits |= (uint64_t)1 << k % 64;
  if (k < touch->from) touch->from = k;
  if (k >= touch->to) touch->to = k + 1;
}

/* Next chunk from `k` on that has weights. */
static inline uint32_t hfx_next_weighted(const hfx_touch *touch, uint32_t k) {
  while (k < touch->to && !(touch->peaks[k] > 0.0f)) k++;
  return k;
}

/* Distances of vertices, at `p` in shape space, from a volume, metres, where any vertex is within
 * `most` on all axes. Returns the least, or HFX_FARTHEST. */
static inline float hfx_distances(const hfx_volume *volume, const hfx_chunk *p, const float *gauge,
                                  const float *most, float *HFX_RESTRICT found) {
  int i, is_any = 0;
  for (i = 0; i < HFX_CHUNK; i++)
    is_any |= (fabsf(p->x[i]) <= most[0]) & (fabsf(p->y[i]) <= most[1]) &
              (fabsf(p->z[i]) <= most[2]);
  if (!is_any) return HFX_FARTHEST;
  hfx_distances_outside(volume, p, found);
  for (i = 0; i < HFX_CHUNK; i++) found[i] = gauge[i] <= 1.0f ? 0.0f : found[i];
  return hfx_smallest(found);
}

/* Weights of what is inside, and distances of what is within `reach`; whether anything is inside.
 * The weights are 0 before. */
static inline int hfx_contact_weights(hfx_touch *touch, float reach) {
  hfx_near *near = touch->body->near, *end = near + touch->nears;
  const float *m = touch->volume.to_shape;
  float most[3]; /* on the axes of shape space, of what is within reach */
  int c;
  for (c = 0; c < 3; c++, m += 4)
    most[c] = (c == 2 && touch->volume.shape == 3 ? 1.0f + touch->volume.half : 1.0f) +
              reach * sqrtf(m[0] * m[0] + m[1] * m[1] + m[2] * m[2]) * (1.0f + HFX_ROUNDING);
  for (; near < end; near++) {
    const uint32_t k = near->chunk;
    hfx_chunk p;
    float gauge[HFX_CHUNK], *weights = touch->weights + HFX_CHUNK * (size_t)k;
    hfx_transform(touch->volume.to_shape, hfx_posed(touch, k), &p);
    hfx_gauge(&touch->volume, &p, gauge);
    if (hfx_falloff_weights(&touch->volume, gauge, weights))
      hfx_note_weights(touch, k, hfx_largest(weights));
    if (reach > 0.0f)
      near->least_m = hfx_distances(&touch->volume, &p, gauge, most, near->away_m);
  }
  return touch->from < touch->to;
}

#define HFX_FARTHEST_M 1e9f /* a longer way is of a bone that was no number */

/* Mean speed of touched skin against the volume since the moment before, m/s. */
static inline double hfx_mean_speed(hfx_touch *touch, double seconds) {
  const float *m = touch->volume.to_world;
  const float *then = touch->felt->to_shape_before;
  float moved[12]; /* by the volume, of what it takes along, in the world */
  double sum = 0.0, weights = 0.0;
  uint32_t k;
  int r, c;
  if (!touch->body->was_posed || !touch->felt->was_on || touch->felt->was_flat) return 0.0;
  if (!(seconds > 0.0)) return 0.0;
  for (r = 0; r < 12; r += 4)
    for (c = 0; c < 4; c++)
      moved[r + c] = m[r] * then[c] + m[r + 1] * then[4 + c] + m[r + 2] * then[8 + c] +
                     (c == 3 ? m[r + 3] : 0.0f);
  for (k = touch->from; (k = hfx_next_weighted(touch, k)) < touch->to; k++) {
    const float *weight = touch->weights + HFX_CHUNK * (size_t)k;
    const hfx_chunk *p = hfx_posed(touch, k);
    hfx_chunk q;
    float way[HFX_CHUNK];
    int i;
    hfx_transform(moved, hfx_posed_before(touch, k), &q);
    for (i = 0; i < HFX_CHUNK; i++) {
      const float x = p->x[i] - q.x[i], y = p->y[i] - q.y[i], z = p->z[i] - q.z[i];
      const float length = sqrtf(x * x + y * y + z * z);
      way[i] = weight[i] > 0.0f && length < HFX_FARTHEST_M ? weight[i] * length : 0.0f;
    }
    sum += hfx_total(way);
    weights += hfx_total(weight);
  }
  return weights > 0.0 ? sum / weights / seconds : 0.0;
}

#define HFX_HALVINGS 12 /* of the time between two frames */

/* Share of the time since the moment before at which the first of what is touched was inside.
 * Skin moves straight in shape space, where shapes are convex: halving finds when. */
static inline double hfx_onset(hfx_touch *touch) {
  float first = 1.0f;
  uint32_t k;
  for (k = touch->from; (k = hfx_next_weighted(touch, k)) < touch->to; k++) {
    const float *weight = touch->weights + HFX_CHUNK * (size_t)k;
    float gauge[HFX_CHUNK], share[HFX_CHUNK], half = 1.0f; /* outside until `share` */
    hfx_chunk p, q, at;
    int i, step;
    hfx_transform(touch->volume.to_shape, hfx_posed(touch, k), &p);
    hfx_transform(touch->felt->to_shape_before, hfx_posed_before(touch, k), &q);
    for (i = 0; i < HFX_CHUNK; i++) share[i] = 0.0f;
    for (step = 0; step < HFX_HALVINGS; step++) {
      half *= 0.5f;
      for (i = 0; i < HFX_CHUNK; i++) {
        const float middle = share[i] + half;
        at.x[i] = q.x[i] + middle * (p.x[i] - q.x[i]);
        at.y[i] = q.y[i] + middle * (p.y[i] - q.y[i]);
        at.z[i] = q.z[i] + middle * (p.z[i] - q.z[i]);
      }
      hfx_gauge(&touch->volume, &at, gauge);
      for (i = 0; i < HFX_CHUNK; i++) share[i] += gauge[i] <= 1.0f ? 0.0f : half;
    }
    for (i = 0; i < HFX_CHUNK; i++)
      if (weight[i] > 0.0f && share[i] + half < first) first = share[i] + half;
  }
  return first;
}

#ifdef __cplusplus
}
#endif

#endif
