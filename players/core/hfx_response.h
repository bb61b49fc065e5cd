/* SPDX-License-Identifier: MIT
 *
 * How an effect is felt by a body: what it touches, and its response to the touch. Included by
 * hfx_player.h. */
#ifndef HFX_RESPONSE_H
#define HFX_RESPONSE_H

#ifdef __cplusplus
extern "C" {
#endif

enum { HFX_DISTANCE, HFX_SPEED, HFX_IMPACT, HFX_PROXIMITY, HFX_SINE };

#define HFX_TAU 6.283185307179586
#define HFX_WEAKEST 1e-4 /* a weaker response is silence */
#define HFX_FADED 1e-3   /* of its peak: an impact has ended */

typedef struct hfx_touch { /* an effect on the skin of a model, at one moment */
  hfx_felt *felt;
  const unsigned char *effect;
  hfx_volume volume;
  hfx_body *body;
  const unsigned char *model;
  float *weights;                     /* of the model */
  uint32_t vertices, first, count;    /* first: its first chunk among the body's */
  uint32_t from, to;                  /* chunks that have weights */
  float bounds[HFX_CHUNK];            /* of the chunks that hfx_next is at */
} hfx_touch;

static inline const unsigned char *hfx_filter(const hfx_body *self, const hfx_touch *touch,
                                              uint32_t index) {
  return hfx_record(self->clip, HFX_FLTR, hfx_u32(touch->effect + 60) + index);
}

static inline double hfx_control(const unsigned char *filter, int index) {
  return hfx_f32(filter + 12 + 4 * index);
}

static inline int hfx_is_in_space(const unsigned char *filter) {
  return hfx_u32(filter) == HFX_DISTANCE || (hfx_u32(filter) == HFX_SINE && hfx_u32(filter + 8) != 2);
}

/* First chunk from `k` on that may be within reach; begins at 0. */
static inline uint32_t hfx_next(hfx_touch *touch, uint32_t k, float reach) {
  for (; k < touch->count; k++) {
    const uint32_t at = touch->first + k;
    if (k == 0 || at % HFX_CHUNK == 0)
      hfx_bound(&touch->volume, touch->body->boxes + at / HFX_CHUNK, reach, touch->bounds);
    if (touch->bounds[at % HFX_CHUNK] <= 1.0f + HFX_ROUNDING) break;
  }
  return k;
}

static inline void hfx_pose_of(const hfx_touch *touch, const float *matrices, uint32_t k, hfx_chunk *chunk,
                               float *box) {
  const uint32_t i = HFX_CHUNK * k;
  const unsigned char *at = hfx_record(touch->body->clip, HFX_VERT, hfx_u32(touch->model + 12) + i);
  hfx_pose_chunk(touch->body->clip, matrices, at, touch->vertices - i, chunk, box);
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
  hfx_pose_of(touch, self->bones->now, k, chunk, box);
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
  if (chunk->frame != self->frame - 1) hfx_pose_of(touch, self->bones->before, k, chunk, box);
  chunk->frame = self->frame - 1;
  return chunk;
}

/* Widens the range of chunks that have weights. */
static inline void hfx_look_at(hfx_touch *touch, uint32_t k) {
  if (k < touch->from) touch->from = k;
  if (k >= touch->to) touch->to = k + 1;
}

/* Next chunk from `k` on that has weights. */
static inline uint32_t hfx_next_felt(const hfx_touch *touch, uint32_t k) {
  for (; k < touch->to; k++) {
    const float *weights = touch->weights + HFX_CHUNK * (size_t)k;
    int i, is_any = 0;
    for (i = 0; i < HFX_CHUNK; i++) is_any |= weights[i] > 0.0f;
    if (is_any) break;
  }
  return k;
}

/* Takes weights from what fills the last chunk. */
static inline void hfx_trim(const hfx_touch *touch) {
  uint32_t i;
  for (i = touch->vertices; i < HFX_CHUNK * touch->count; i++) touch->weights[i] = 0.0f;
}

/* Weights of what is inside; whether anything is. The weights are 0 before. */
static inline int hfx_inside(hfx_touch *touch) {
  uint32_t k;
  for (k = hfx_next(touch, 0, 0.0f); k < touch->count; k = hfx_next(touch, k + 1, 0.0f)) {
    hfx_chunk p;
    float gauge[HFX_CHUNK];
    hfx_moved(touch->volume.to_shape, hfx_posed(touch, k), &p);
    hfx_gauge(&touch->volume, &p, gauge);
    if (hfx_weigh(&touch->volume, gauge, touch->weights + HFX_CHUNK * (size_t)k)) hfx_look_at(touch, k);
  }
  hfx_trim(touch);
  return hfx_next_felt(touch, touch->from) < touch->to;
}

/* Mean speed of touched skin against the volume since the moment before, m/s. */
static inline double hfx_speed(hfx_touch *touch, double seconds) {
  float then[12];
  double sum = 0.0, weights = 0.0;
  uint32_t k;
  if (!touch->body->was_posed || !touch->felt->was_on || !(seconds > 0.0)) return 0.0;
  if (!hfx_inverse(touch->felt->before, then)) return 0.0;
  for (k = hfx_next_felt(touch, touch->from); k < touch->to; k = hfx_next_felt(touch, k + 1)) {
    const float *weight = touch->weights + HFX_CHUNK * (size_t)k;
    hfx_chunk p, q;
    int i, c;
    hfx_moved(touch->volume.to_shape, hfx_posed(touch, k), &p);
    hfx_moved(then, hfx_posed_before(touch, k), &q);
    for (i = 0; i < HFX_CHUNK; i++) {
      const float x = p.x[i] - q.x[i], y = p.y[i] - q.y[i], z = p.z[i] - q.z[i];
      float way[3];
      if (!(weight[i] > 0.0f)) continue;
      for (c = 0; c < 3; c++) {
        const float *row = touch->volume.to_world + 4 * c;
        way[c] = row[0] * x + row[1] * y + row[2] * z;
      }
      sum += weight[i] * sqrt((double)way[0] * way[0] + way[1] * way[1] + way[2] * way[2]);
      weights += weight[i];
    }
  }
  return weights > 0.0 ? sum / weights / seconds : 0.0;
}

/* How near untouched skin is, 0 to 1 at the boundary, added to the weights where it is felt. */
static inline double hfx_near(hfx_touch *touch, const unsigned char *filter, int is_touched) {
  const double range_m = hfx_control(filter, 1), exponent = hfx_control(filter, 2);
  double peak = is_touched ? 1.0 : 0.0;
  int pass;
  if (!(hfx_control(filter, 0) > 0.0)) return peak;
  for (pass = is_touched; pass < 2; pass++) { /* the peak, then the weights */
    uint32_t k = hfx_next(touch, 0, (float)range_m);
    for (; k < touch->count; k = hfx_next(touch, k + 1, (float)range_m)) {
      float *weights = touch->weights + HFX_CHUNK * (size_t)k, gauge[HFX_CHUNK];
      hfx_chunk p;
      int i;
      hfx_moved(touch->volume.to_shape, hfx_posed(touch, k), &p);
      hfx_gauge(&touch->volume, &p, gauge);
      for (i = 0; i < HFX_CHUNK; i++) {
        const double away_m = gauge[i] <= 1.0f ? 0.0 : hfx_distance(&touch->volume, &p, i);
        double near;
        if (!(away_m < range_m)) continue;
        near = pow(1.0 - away_m / range_m, exponent);
        if (pass == 0 && near > peak) peak = near;
        if (pass == 0 || !(near / peak > weights[i])) continue;
        weights[i] = (float)(near / peak);
        hfx_look_at(touch, k);
      }
    }
    if (!(peak > 0.0)) break;
  }
  hfx_trim(touch);
  return peak;
}

static inline double hfx_wave(double turns, double depth, double phase) {
  return 1.0 - 0.5 * depth * (1.0 - sin(HFX_TAU * (turns + phase)));
}

/* Weights times a filter that has a value for each vertex; whether anything is left. */
static inline int hfx_over_space(hfx_touch *touch, const unsigned char *filter) {
  const float *matrix = touch->volume.to_world;
  const double influence = hfx_control(filter, 0), near = hfx_control(filter, 1);
  const double far = hfx_control(filter, 2);
  double axis[3] = {0.0, 0.0, 0.0}, length = 0.0;
  int is_left = 0, c, i;
  uint32_t k;
  for (c = 0; c < 3; c++) length += (double)matrix[4 * c + 2] * matrix[4 * c + 2];
  if (hfx_u32(filter + 8) == 1 && length > 0.0)
    for (c = 0; c < 3; c++) axis[c] = matrix[4 * c + 2] / sqrt(length);
  for (k = hfx_next_felt(touch, touch->from); k < touch->to; k = hfx_next_felt(touch, k + 1)) {
    const hfx_chunk *of = hfx_posed(touch, k);
    float *weights = touch->weights + HFX_CHUNK * (size_t)k;
    for (i = 0; i < HFX_CHUNK; i++) {
      const float off[3] = {of->x[i] - matrix[3], of->y[i] - matrix[7], of->z[i] - matrix[11]};
      double along = 0.0, away_m = 0.0, value;
      if (!(weights[i] > 0.0f)) continue;
      for (c = 0; c < 3; c++) along += axis[c] * off[c];
      for (c = 0; c < 3; c++) away_m += (off[c] - along * axis[c]) * (off[c] - along * axis[c]);
      away_m = sqrt(away_m);
      if (hfx_u32(filter) == HFX_DISTANCE) {
        const double share = hfx_clamped((away_m - near) / (far - near > 1e-9 ? far - near : 1e-9), 0, 1);
        value = hfx_control(filter, 3) + (hfx_control(filter, 4) - hfx_control(filter, 3)) * share;
      } else {
        value = hfx_wave(away_m / (near > 1e-6 ? near : 1e-6), far, hfx_control(filter, 3));
      }
      weights[i] *= (float)hfx_clamped(1.0 + influence * (value - 1.0), 0.0, 1.0);
      is_left |= weights[i] > 0.0f;
    }
  }
  return is_left;
}

/* The envelope of an impact, 1 at its peak; without a time: how long it lasts. */
static inline double hfx_envelope(const hfx_impact *impact, double since_s, int lasts) {
  const double a = impact->attack_s, d = impact->decay_s;
  const double slow = a > d ? a : d, fast = a > d ? d : a;
  double at, peak;
  if (fast <= 1e-6 * slow) return lasts ? -slow * log(HFX_FADED) : exp(-since_s / slow);
  if (slow - fast <= 1e-6 * slow)
    return lasts ? 12.0 * slow : since_s / slow * exp(1.0 - since_s / slow);
  at = log(slow / fast) * slow * fast / (slow - fast);
  peak = exp(-at / slow) - exp(-at / fast);
  if (!lasts) return (exp(-since_s / slow) - exp(-since_s / fast)) / peak;
  at = -slow * log(HFX_FADED * peak);
  return at < 12.0 * slow ? at : 12.0 * slow;
}

/* A new impact, in the place of the one that ends first where there are too many. */
static inline void hfx_strike(hfx_felt *felt, const unsigned char *filter, uint32_t index,
                              double time_s, double speed) {
  int k, chosen = 0;
  hfx_impact *made;
  for (k = 1; k < felt->impact_count; k++)
    if (felt->impacts[k].ends_s < felt->impacts[chosen].ends_s) chosen = k;
  if (felt->impact_count < HFX_IMPACTS) chosen = felt->impact_count++;
  made = &felt->impacts[chosen];
  made->time_s = time_s;
  made->strength = hfx_clamped(speed / (hfx_control(filter, 3) > 1e-3 ? hfx_control(filter, 3) : 1e-3), 0.0, 1.0);
  made->attack_s = hfx_clamped(hfx_control(filter, 1), 0.0, 10.0);
  made->decay_s = hfx_clamped(hfx_control(filter, 2), 1e-3, 10.0);
  made->filter = index;
  made->ends_s = time_s + hfx_envelope(made, 0.0, 1);
}

static inline double hfx_ringing(hfx_felt *felt, uint32_t index, double time_s) {
  double sum = 0.0;
  int k;
  for (k = 0; k < felt->impact_count; k++) {
    const hfx_impact *each = &felt->impacts[k];
    if (each->filter == index) sum += each->strength * hfx_envelope(each, time_s - each->time_s, 0);
  }
  return sum;
}

static inline void hfx_forget_ended(hfx_felt *felt, double time_s) {
  int k = 0;
  while (k < felt->impact_count) {
    if (felt->impacts[k].ends_s > time_s) k++;
    else felt->impacts[k] = felt->impacts[--felt->impact_count];
  }
}

static inline void hfx_clear(hfx_felt *felt, float *weights) {
  size_t i = HFX_CHUNK * (size_t)felt->from;
  for (; i < HFX_CHUNK * (size_t)felt->to; i++) weights[i] = 0.0f;
  felt->from = felt->to;
}

/* Whether no skin is near enough for a volume to be felt; then its weights are 0. */
static inline int hfx_is_far(const hfx_body *self, hfx_touch *touch, float *weights) {
  float reach = 0.0f;
  uint32_t i;
  for (i = 0; i < hfx_u32(touch->effect + 64); i++) {
    const unsigned char *filter = hfx_filter(self, touch, i);
    const double range_m = hfx_u32(filter) == HFX_PROXIMITY ? hfx_control(filter, 1) : 0.0;
    if (range_m > reach) reach = (float)range_m;
  }
  hfx_forget_ended(touch->felt, self->time_s);
  if (touch->felt->impact_count || hfx_next(touch, 0, reach) < touch->count) return 0;
  hfx_clear(touch->felt, weights);
  touch->felt->was_touched = 0;
  return 1;
}

/* The response of a volume to its touch, 0 to 1; its weights are those of the last touch while
 * impacts ring. `seconds` since the moment before. */
static inline double hfx_respond(hfx_body *self, hfx_touch *touch, float *weights, double seconds) {
  hfx_felt *felt = touch->felt;
  const uint32_t count = hfx_u32(touch->effect + 64);
  double nearness[16], speed, result;
  int is_touched, is_any, multiplies = 0, rings;
  uint32_t i, f;
  if (hfx_is_far(self, touch, weights)) return 0.0;
  touch->from = touch->count;
  touch->to = 0;
  if (felt->impact_count) { /* what rings is felt where it was touched last */
    for (i = 0; i < HFX_CHUNK * touch->count; i++) touch->weights[i] = 0.0f;
  } else {
    hfx_clear(felt, weights);
    touch->weights = weights;
  }
  is_touched = is_any = hfx_inside(touch);
  speed = count && is_touched ? hfx_speed(touch, seconds) : 0.0;
  for (f = 0; f < count; f++) {
    const unsigned char *filter = hfx_filter(self, touch, f);
    if (hfx_u32(filter) == HFX_IMPACT) multiplies |= hfx_u32(filter + 4) == 0;
    if (hfx_u32(filter) != HFX_PROXIMITY) continue;
    nearness[f] = hfx_near(touch, filter, is_touched);
    is_any |= nearness[f] > 0.0;
  }
  for (f = 0; f < count && is_any; f++)
    if (hfx_is_in_space(hfx_filter(self, touch, f))) {
      is_any = hfx_over_space(touch, hfx_filter(self, touch, f));
      is_touched &= is_any;
    }
  for (f = 0; f < count; f++) {
    const unsigned char *filter = hfx_filter(self, touch, f);
    if (hfx_u32(filter) == HFX_IMPACT && is_touched && !felt->was_touched && felt->was_on && speed > 0.0)
      hfx_strike(felt, filter, f, self->time_s, speed);
  }
  rings = felt->impact_count > 0;
  if (is_any && touch->weights != weights) {
    hfx_clear(felt, weights);
    for (i = HFX_CHUNK * touch->from; i < HFX_CHUNK * touch->to; i++) weights[i] = touch->weights[i];
  }
  if (is_any || touch->weights == weights) felt->from = touch->from, felt->to = touch->to;
  result = is_touched || (rings && multiplies) ? 1.0 : 0.0;
  for (f = 0; f < count; f++) {
    const unsigned char *filter = hfx_filter(self, touch, f);
    const double influence = hfx_control(filter, 0), still = hfx_control(filter, 1);
    const uint32_t kind = hfx_u32(filter), operation = hfx_u32(filter + 4);
    double value = 1.0;
    if (hfx_is_in_space(filter)) continue;
    if (kind == HFX_SPEED) {
      const double full = hfx_control(filter, 2) - still;
      if (is_touched) felt->speeds[f] = hfx_clamped((speed - still) / (full > 1e-9 ? full : 1e-9), 0.0, 1.0);
      else if (!rings) felt->speeds[f] = 0.0;
      value = felt->speeds[f];
    } else if (kind == HFX_IMPACT) {
      value = hfx_ringing(felt, f, self->time_s);
    } else if (kind == HFX_PROXIMITY) {
      value = nearness[f];
    } else {
      value = hfx_wave(self->time_s * still, hfx_control(filter, 2), hfx_control(filter, 3));
    }
    if (operation == 0) result *= 1.0 + influence * (value - 1.0);
    else if (operation == 1) result += influence * value;
    else if (influence * value > result) result = influence * value;
  }
  felt->was_touched = is_touched;
  result = hfx_clamped(result, 0.0, 1.0);
  return result >= HFX_WEAKEST && (is_any || rings) ? result : 0.0;
}

#ifdef __cplusplus
}
#endif

#endif
