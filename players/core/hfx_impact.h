/* SPDX-License-Identifier: MIT
 *
 * Impacts: how long they ring, and the weights that they hold. Included by hfx_player.h. */
#ifndef HFX_IMPACT_H
#define HFX_IMPACT_H

#ifdef __cplusplus
extern "C" {
#endif

#define HFX_FADED 1e-3 /* of its peak: an impact has ended */

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

#ifdef __cplusplus
}
#endif

#endif
