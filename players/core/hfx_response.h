/* SPDX-License-Identifier: MIT
 *
 * Response of an effect to its touch. Included by hfx_player.h. */
#ifndef HFX_RESPONSE_H
#define HFX_RESPONSE_H

#ifdef __cplusplus
extern "C" {
#endif

#define HFX_WEAKEST 1e-4 /* a weaker response is silence */

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
