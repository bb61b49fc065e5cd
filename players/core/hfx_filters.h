/* SPDX-License-Identifier: MIT
 *
 * Filters that have a value for each vertex: proximity, distance and sine over space. Included by
 * hfx_player.h. */
#ifndef HFX_FILTERS_H
#define HFX_FILTERS_H

#ifdef __cplusplus
extern "C" {
#endif

enum { HFX_DISTANCE, HFX_SPEED, HFX_IMPACT, HFX_PROXIMITY, HFX_SINE };


static inline const unsigned char *hfx_filter(const hfx_body *self, const hfx_touch *touch,
                                              uint32_t index) {
  return hfx_record(self->effects, HFX_FLTR, hfx_u32(touch->felt->effect + 60) + index);
}

static inline double hfx_control(const unsigned char *filter, int index) {
  return hfx_f32(filter + 12 + 4 * index);
}

static inline int hfx_is_in_space(const unsigned char *filter) {
  if (hfx_u32(filter) == HFX_SINE) return hfx_u32(filter + 8) != 2;
  return hfx_u32(filter) == HFX_DISTANCE;
}

/* Powers of numbers from 0 to 1, within 0.00001, with an exponent of 0 or more; 0 stays 0. The
 * logarithm to base 2 is the number's own exponent and a series in (m - 1) / (m + 1) of the rest
 * `m`, 0.7 to 1.4; its exponential function is a power of 2 and a series of the rest. */
static inline void hfx_powers(float *values, float exponent) {
  uint32_t bits[HFX_CHUNK];
  float rest[HFX_CHUNK], twos[HFX_CHUNK];
  int i;
  hfx_copy(bits, values, sizeof bits);
  for (i = 0; i < HFX_CHUNK; i++) {
    const int32_t whole = (int32_t)(bits[i] - 0x3F3504F3u) >> 23;
    twos[i] = (float)whole;
    bits[i] -= (uint32_t)whole << 23;
  }
  hfx_copy(rest, bits, sizeof bits);
  for (i = 0; i < HFX_CHUNK; i++) {
    const float s = (rest[i] - 1.0f) / (rest[i] + 1.0f), y = s * s;
    const float series = 2.885390f + y * (0.9617967f + y * (0.5770780f + y * 0.4121986f));
    const float exact = (twos[i] + s * series) * exponent;
    const float power = exact > -126.0f ? exact : -126.0f;
    const float whole = (power + 12582912.0f) - 12582912.0f; /* rounded */
    rest[i] = 0.6931472f * (power - whole);
    bits[i] = (uint32_t)((int32_t)whole + 127) << 23;
  }
  hfx_copy(twos, bits, sizeof bits);
  for (i = 0; i < HFX_CHUNK; i++) {
    const float x = rest[i];
    const float more = 1.0f / 6.0f + x * (1.0f / 24.0f + x * (1.0f / 120.0f + x * (1.0f / 720.0f)));
    const float power = twos[i] * (1.0f + x * (1.0f + x * (0.5f + x * more)));
    values[i] = values[i] > 0.0f ? power : 0.0f;
  }
}

/* Nearness of untouched skin, 0 to 1 at the boundary, added to the weights where it is felt. */
static inline double hfx_add_proximity(hfx_touch *touch, const unsigned char *filter,
                                       int is_touched) {
  const float range_m = (float)hfx_control(filter, 1);
  const double exponent = hfx_positive(hfx_control(filter, 2));
  hfx_near *near = touch->body->near, *end = near + touch->nears;
  float least_m = is_touched ? 0.0f : range_m, share;
  double peak;
  if (!(hfx_control(filter, 0) > 0.0) || !(range_m > 0.0f)) return is_touched;
  for (; near < end; near++) least_m = near->least_m < least_m ? near->least_m : least_m;
  if (!(least_m < range_m)) return is_touched;
  peak = pow(1.0 - (double)least_m / range_m, exponent);
  share = (float)(1.0 / peak);
  for (near = touch->body->near; near < end; near++) {
    float *weights = touch->weights + HFX_CHUNK * (size_t)near->chunk, nearness[HFX_CHUNK];
    int i;
    if (!(near->least_m < range_m)) continue;
    for (i = 0; i < HFX_CHUNK; i++) {
      const float x = 1.0f - near->away_m[i] / range_m;
      nearness[i] = x > 0.0f ? x : 0.0f;
    }
    if (exponent != 1.0) hfx_powers(nearness, (float)exponent);
    for (i = 0; i < HFX_CHUNK; i++) {
      nearness[i] *= share;
      nearness[i] = nearness[i] < 1.0f ? nearness[i] : 1.0f;
    }
    hfx_raise(weights, nearness);
    hfx_note_weights(touch, near->chunk, 1.0f);
  }
  return peak;
}

static inline double hfx_wave(double turns, double depth, double phase) {
  return 1.0 - 0.5 * depth * (1.0 - sin(HFX_TAU * (turns + phase)));
}

/* The same, up to a million turns: a polynomial, which becomes vector instructions. */
static inline float hfx_wave_near(float turns, float depth) {
  const float part = turns - ((turns + 12582912.0f) - 12582912.0f); /* less the rounded */
  const float fold = part > 0.25f ? 0.5f - part : part < -0.25f ? -0.5f - part : part;
  const float x = (float)HFX_TAU * fold, y = x * x;
  const float sine = x * (1.0f - y * (1.0f / 6.0f - y * (1.0f / 120.0f - y * (1.0f / 5040.0f -
                                                                  y * (1.0f / 362880.0f)))));
  return 1.0f - 0.5f * depth * (1.0f - sine);
}

/* Weights times a filter that has a value for each vertex; whether anything is left. */
static inline int hfx_scale_over_space(hfx_touch *touch, const unsigned char *filter) {
  const float *matrix = touch->volume.to_world;
  const int is_wave = hfx_u32(filter) == HFX_SINE;
  const double first = hfx_control(filter, 1), second = hfx_control(filter, 2);
  const double way_m = is_wave ? first : second - first, least_m = is_wave ? 1e-6 : 1e-9;
  const float influence = (float)hfx_control(filter, 0), begin_m = is_wave ? 0.0f : (float)first;
  const float per_m = (float)(1.0 / (way_m > least_m ? way_m : least_m)), depth = (float)second;
  const float most = is_wave ? 1e6f : 1.0f, near = (float)hfx_control(filter, 3);
  const float phase = (float)(hfx_control(filter, 3) - floor(hfx_control(filter, 3)));
  const float rise = (float)hfx_control(filter, 4) - near;
  float axis[3] = {0.0f, 0.0f, 0.0f}, length = 0.0f;
  uint32_t k, from = touch->from, to = touch->to;
  int c, i;
  for (c = 0; c < 3; c++) length += matrix[4 * c + 2] * matrix[4 * c + 2];
  if (hfx_u32(filter + 8) == 1 && length > 0.0f)
    for (c = 0; c < 3; c++) axis[c] = matrix[4 * c + 2] / sqrtf(length);
  touch->from = touch->count, touch->to = 0;
  for (k = from; k < to; k++) {
    float *weights = touch->weights + HFX_CHUNK * (size_t)k, value[HFX_CHUNK];
    const hfx_chunk *of;
    if (!(touch->peaks[k] > 0.0f)) continue;
    of = hfx_posed(touch, k);
    for (i = 0; i < HFX_CHUNK; i++) {
      const float x = of->x[i] - matrix[3], y = of->y[i] - matrix[7], z = of->z[i] - matrix[11];
      const float along = axis[0] * x + axis[1] * y + axis[2] * z;
      const float a = x - along * axis[0], b = y - along * axis[1], d = z - along * axis[2];
      const float way = (sqrtf(a * a + b * b + d * d) - begin_m) * per_m;
      value[i] = way > 0.0f ? way < most ? way : most : 0.0f;
    }
    if (is_wave)
      for (i = 0; i < HFX_CHUNK; i++) value[i] = hfx_wave_near(value[i] + phase, depth);
    else
      for (i = 0; i < HFX_CHUNK; i++) value[i] = near + rise * value[i];
    for (i = 0; i < HFX_CHUNK; i++) {
      const float factor = 1.0f + influence * (value[i] - 1.0f);
      const float within = factor > 0.0f ? factor < 1.0f ? factor : 1.0f : 0.0f;
      value[i] = weights[i] > 0.0f ? weights[i] * within : weights[i];
    }
    hfx_copy(weights, value, sizeof value);
    hfx_note_weights(touch, k, hfx_largest(value));
  }
  return touch->from < touch->to;
}

#ifdef __cplusplus
}
#endif

#endif
