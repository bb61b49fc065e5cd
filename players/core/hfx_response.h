/* SPDX-License-Identifier: MIT
 *
 * Response of an effect to its touch. Included by hfx_player.h. */
#ifndef HFX_RESPONSE_H
#define HFX_RESPONSE_H

#ifdef __cplusplus
extern "C" {
#endif

enum { HFX_DISTANCE, HFX_SPEED, HFX_IMPACT, HFX_PROXIMITY, HFX_SINE };

#define HFX_WEAKEST 1e-4 /* a weaker response is silence */
#define HFX_FADED 1e-3   /* of its peak: an impact has ended */

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

enum { HFX_VALUE, HFX_DURATION, HFX_PEAK };

/* The envelope of an impact: its value at a time since it began, 1 at its peak; or how long it
 * lasts, or when it is at its peak. */
static inline double hfx_envelope(const hfx_impact *impact, double since_s, int what) {
  const double a = impact->attack_s, d = impact->decay_s;
  const double slow = a > d ? a : d, fast = a > d ? d : a;
  double at, peak;
  if (fast <= 1e-6 * slow) {
    if (what == HFX_PEAK) return 0.0;
    return what == HFX_DURATION ? -slow * log(HFX_FADED) : exp(-since_s / slow);
  }
  if (slow - fast <= 1e-6 * slow) {
    if (what == HFX_PEAK) return slow;
    return what == HFX_DURATION ? 12.0 * slow : since_s / slow * exp(1.0 - since_s / slow);
  }
  at = log(slow / fast) * slow * fast / (slow - fast);
  if (what == HFX_PEAK) return at;
  peak = exp(-at / slow) - exp(-at / fast);
  if (what == HFX_VALUE) return (exp(-since_s / slow) - exp(-since_s / fast)) / peak;
  at = -slow * log(HFX_FADED * peak);
  return at < 12.0 * slow ? at : 12.0 * slow;
}

/* Largest weights of an impact's touches since it began; each of those that ring has a place. */
static inline float *hfx_held(const hfx_touch *touch, const hfx_impact *impact) {
  return touch->felt->held + HFX_CHUNK * (size_t)touch->count * impact->place;
}

/* A new impact, in the place of the one that ends first where there are too many. */
static inline void hfx_strike(hfx_touch *touch, const unsigned char *filter, uint32_t index,
                              double time_s, double speed) {
  const double full = hfx_control(filter, 3);
  hfx_felt *felt = touch->felt;
  int k, chosen = 0;
  uint32_t i, place = 0;
  hfx_impact *made;
  for (k = 1; k < felt->impact_count; k++)
    if (felt->impacts[k].ends_s < felt->impacts[chosen].ends_s) chosen = k;
  if (felt->impact_count < HFX_IMPACTS) {
    chosen = felt->impact_count++;
    for (k = 0; k < chosen; k++) /* the first place that is free */
      if (felt->impacts[k].place == place) place++, k = -1;
  } else {
    place = felt->impacts[chosen].place;
  }
  made = &felt->impacts[chosen];
  made->time_s = time_s;
  made->strength = hfx_clamped(speed / (full > 1e-3 ? full : 1e-3), 0.0, 1.0);
  made->attack_s = hfx_clamped(hfx_control(filter, 1), 0.0, 10.0);
  made->decay_s = hfx_clamped(hfx_control(filter, 2), 1e-3, 10.0);
  made->filter = index;
  made->place = place;
  made->ends_s = time_s + hfx_envelope(made, 0.0, HFX_DURATION);
  made->peaks_s = time_s + hfx_envelope(made, 0.0, HFX_PEAK);
  for (i = 0; i < touch->count; i++) touch->felt->held_peaks[touch->count * place + i] = 0.0f;
}

/* Value of an impact; that of its peak in the first frame after it. */
static inline double hfx_ring(const hfx_impact *impact, double time_s, double seconds) {
  const int is_peak = impact->peaks_s <= time_s && impact->peaks_s > time_s - seconds;
  if (is_peak) return impact->strength;
  if (impact->ends_s <= time_s) return 0.0;
  return impact->strength * hfx_envelope(impact, time_s - impact->time_s, HFX_VALUE);
}

static inline double hfx_ringing(const hfx_felt *felt, uint32_t index, double time_s,
                                 double seconds) {
  double sum = 0.0;
  int k;
  for (k = 0; k < felt->impact_count; k++)
    if (felt->impacts[k].filter == index) sum += hfx_ring(&felt->impacts[k], time_s, seconds);
  return sum;
}

static inline void hfx_forget_ended(hfx_felt *felt, double time_s, double seconds) {
  int k = 0;
  while (k < felt->impact_count) {
    const hfx_impact *each = &felt->impacts[k];
    if (each->ends_s > time_s || each->peaks_s > time_s - seconds) k++;
    else felt->impacts[k] = felt->impacts[--felt->impact_count];
  }
}

/* All impacts that ring keep the weights of a touch where these are larger than theirs. */
static inline void hfx_hold(hfx_touch *touch) {
  hfx_felt *felt = touch->felt;
  uint32_t k;
  int n;
  for (n = 0; n < felt->impact_count; n++) {
    float *held = hfx_held(touch, &felt->impacts[n]);
    float *peaks = felt->held_peaks + touch->count * (size_t)felt->impacts[n].place;
    for (k = touch->from; (k = hfx_next_weighted(touch, k)) < touch->to; k++) {
      const float *weights = touch->weights + HFX_CHUNK * (size_t)k;
      float *kept = held + HFX_CHUNK * (size_t)k;
      if (!(peaks[k] > 0.0f)) hfx_copy(kept, weights, sizeof(float) * HFX_CHUNK);
      else hfx_raise(kept, weights);
      peaks[k] = touch->peaks[k] > peaks[k] ? touch->peaks[k] : peaks[k];
    }
  }
  if (touch->from < felt->held_from) felt->held_from = touch->from;
  if (touch->to > felt->held_to) felt->held_to = touch->to;
}

/* Weights of what is touched or near now, and of what rings, `share` as strongly: the mean of what
 * impacts hold, by their envelopes. The felt weights are 0 before, those of the touch after. */
static inline void hfx_add_held(hfx_touch *touch, double share, double seconds) {
  hfx_felt *felt = touch->felt;
  const double time_s = touch->body->time_s;
  double values[HFX_IMPACTS], sum = 0.0;
  uint32_t at;
  int i, n, newest = 0;
  for (n = 0; n < felt->impact_count; n++) {
    sum += values[n] = hfx_ring(&felt->impacts[n], time_s, seconds);
    if (felt->impacts[n].time_s > felt->impacts[newest].time_s) newest = n;
  }
  for (n = 0; n < felt->impact_count; n++)
    values[n] = share * (sum > 0.0 ? values[n] / sum : n == newest ? 1.0 : 0.0);
  felt->from = felt->held_from < touch->from ? felt->held_from : touch->from;
  felt->to = felt->held_to > touch->to ? felt->held_to : touch->to;
  for (at = felt->from; at < felt->to; at++) {
    const size_t first = HFX_CHUNK * (size_t)at;
    const float own_peak = touch->peaks[at];
    float sums[HFX_CHUNK], peak = 0.0f;
    hfx_copy(sums, hfx_zeros, sizeof sums);
    for (n = 0; n < felt->impact_count; n++) {
      const float *held = hfx_held(touch, &felt->impacts[n]) + first, value = (float)values[n];
      const float held_peak = felt->held_peaks[touch->count * (size_t)felt->impacts[n].place + at];
      if (!(held_peak * value > 0.0f)) continue;
      for (i = 0; i < HFX_CHUNK; i++) sums[i] += value * held[i];
      peak += value * held_peak;
    }
    if (!(peak > 0.0f || own_peak > 0.0f)) continue;
    for (i = 0; i < HFX_CHUNK; i++) sums[i] = sums[i] > 1.0f ? 1.0f : sums[i]; /* rounding */
    if (own_peak > 0.0f) {
      hfx_raise(sums, touch->weights + first);
      hfx_copy(touch->weights + first, hfx_zeros, sizeof sums);
    }
    hfx_copy(felt->weights + first, sums, sizeof sums);
    felt->peaks[at] = peak > own_peak ? peak : own_peak;
    felt->chunk_bits |= (uint64_t)1 << at % 64;
    touch->peaks[at] = 0.0f;
  }
}

/* Sets the weights of an effect to 0. */
static inline void hfx_clear(hfx_felt *felt) {
  uint32_t k;
  for (k = felt->from; k < felt->to; k++) {
    if (!(felt->peaks[k] > 0.0f)) continue;
    hfx_copy(felt->weights + HFX_CHUNK * (size_t)k, hfx_zeros, sizeof hfx_zeros);
    felt->peaks[k] = 0.0f;
  }
  felt->from = felt->to;
  felt->chunk_bits = 0;
}

/* Range of an effect beyond its volume, metres. */
static inline float hfx_range(const hfx_body *self, const hfx_touch *touch) {
  float reach = 0.0f;
  uint32_t i;
  for (i = 0; i < hfx_u32(touch->felt->effect + 64); i++) {
    const unsigned char *filter = hfx_filter(self, touch, i);
    const double range_m = hfx_u32(filter) == HFX_PROXIMITY ? hfx_control(filter, 1) : 0.0;
    if (range_m > reach) reach = (float)range_m;
  }
  return reach;
}

/* Folds the stack of filters, without the limits of 0 and 1. `is_left`: of what is neither touched
 * nor near any more. */
static inline double hfx_fold(const hfx_body *self, const hfx_touch *touch, const double *values,
                              double start, int is_left) {
  double result = start;
  uint32_t f;
  for (f = 0; f < hfx_u32(touch->felt->effect + 64); f++) {
    const unsigned char *filter = hfx_filter(self, touch, f);
    const double influence = hfx_control(filter, 0);
    const double value = is_left && hfx_u32(filter) == HFX_PROXIMITY ? 0.0 : values[f];
    if (hfx_is_in_space(filter)) continue;
    if (hfx_u32(filter + 4) == 0) result *= 1.0 + influence * (value - 1.0);
    else if (hfx_u32(filter + 4) == 1) result += influence * value;
    else if (influence * value > result) result = influence * value;
  }
  return result;
}

/* The response of a volume to its touch, 0 to 1. While impacts ring, its weights are the largest
 * since they began. `seconds` since the moment before. */
static inline double hfx_respond(hfx_body *self, hfx_touch *touch, double seconds) {
  hfx_felt *felt = touch->felt;
  const uint32_t count = hfx_u32(touch->felt->effect + 64);
  const float reach = hfx_range(self, touch);
  double values[16], speed, onset_s = self->time_s, result, left;
  int is_touched, is_any, is_new, multiplies = 0, has_impacts = 0, has_speed = 0, rings;
  uint32_t f;
  hfx_forget_ended(felt, self->time_s, seconds);
  hfx_find_near(touch, reach);
  hfx_clear(felt);
  if (!felt->impact_count && !touch->nears) {
    felt->was_touched = 0;
    return 0.0;
  }
  touch->from = touch->count;
  touch->to = 0;
  if (!felt->impact_count) {
    touch->weights = felt->weights, touch->peaks = felt->peaks;
    felt->held_from = touch->count, felt->held_to = 0;
  }
  is_touched = is_any = hfx_contact_weights(touch, reach);
  for (f = 0; f < count; f++) {
    has_impacts |= hfx_u32(hfx_filter(self, touch, f)) == HFX_IMPACT;
    has_speed |= hfx_u32(hfx_filter(self, touch, f)) == HFX_SPEED;
  }
  is_new = is_touched && !felt->was_touched && felt->was_on;
  has_speed |= has_impacts && is_new;
  speed = is_touched && has_speed ? hfx_mean_speed(touch, seconds) : 0.0;
  is_new &= speed > 0.0;
  if (is_new && has_impacts) onset_s -= (1.0 - hfx_onset(touch)) * seconds;
  for (f = 0; f < count; f++) {
    const unsigned char *filter = hfx_filter(self, touch, f);
    if (hfx_u32(filter) == HFX_IMPACT) multiplies |= hfx_u32(filter + 4) == 0;
    if (hfx_u32(filter) != HFX_PROXIMITY) continue;
    values[f] = hfx_add_proximity(touch, filter, is_touched);
    is_any |= values[f] > 0.0;
  }
  for (f = 0; f < count && is_any; f++)
    if (hfx_is_in_space(hfx_filter(self, touch, f))) {
      is_any = hfx_scale_over_space(touch, hfx_filter(self, touch, f));
      is_touched &= is_any;
    }
  for (f = 0; f < count && is_new && is_touched; f++) {
    const unsigned char *filter = hfx_filter(self, touch, f);
    if (hfx_u32(filter) == HFX_IMPACT) hfx_strike(touch, filter, f, onset_s, speed);
  }
  rings = felt->impact_count > 0;
  if (rings && is_touched) hfx_hold(touch);
  for (f = 0; f < count; f++) {
    const unsigned char *filter = hfx_filter(self, touch, f);
    const double still = hfx_control(filter, 1), full = hfx_control(filter, 2) - still;
    const uint32_t kind = hfx_u32(filter);
    if (kind == HFX_SPEED) {
      if (is_touched)
        felt->speeds[f] = hfx_clamped((speed - still) / (full > 1e-9 ? full : 1e-9), 0.0, 1.0);
      else if (!rings) felt->speeds[f] = 0.0;
      values[f] = felt->speeds[f];
    } else if (kind == HFX_IMPACT) {
      values[f] = hfx_ringing(felt, f, self->time_s, seconds);
    } else if (kind == HFX_SINE) {
      values[f] = hfx_wave(self->time_s * still, hfx_control(filter, 2), hfx_control(filter, 3));
    }
  }
  left = rings && multiplies ? 1.0 : 0.0;
  result = hfx_fold(self, touch, values, is_touched ? 1.0 : left, 0);
  result = hfx_clamped(result, 0.0, 1.0);
  left = hfx_clamped(hfx_fold(self, touch, values, left, 1), 0.0, 1.0);
  if (touch->weights == felt->weights) felt->from = touch->from, felt->to = touch->to;
  else hfx_add_held(touch, left < result ? left / result : 1.0, seconds);
  felt->was_touched = is_touched;
  return result >= HFX_WEAKEST && (is_any || rings) ? result : 0.0;
}

#ifdef __cplusplus
}
#endif

#endif
