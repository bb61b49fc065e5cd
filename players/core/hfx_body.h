/* SPDX-License-Identifier: MIT
 *
 * A body that feels the effects of a clip, and what its actuators give of it. Included by
 * hfx_player.h. */
#ifndef HFX_BODY_H
#define HFX_BODY_H

#ifdef __cplusplus
extern "C" {
#endif

/* The effect or added volume of a number; NULL: there is none. Numbers that are asked for in
 * ascending order are found at once. */
static inline hfx_felt *hfx_find_felt(const hfx_body *self, uint32_t number) {
  hfx_felt *felt;
  if (self->body == HFX_NONE || !self->felt) return NULL;
  if (number < hfx_clip_effects(self->effects)) return &self->felt[number];
  felt = self->recent && self->recent->number <= number ? self->recent : self->felt;
  while (felt && felt->number < number) felt = felt->next;
  return felt && felt->number == number ? felt : NULL;
}

HFX_API void hfx_body_set_bones(hfx_body *self, const float *matrices) {
  const uint32_t count = hfx_clip_bones(&self->clip, self->body);
  uint32_t i;
  int c;
  for (i = 0; i < count; i++, matrices += 12)
    for (c = 0; c < 4; c++) {
      float *column = self->bones[i].now + 4 * c;
      column[0] = matrices[c], column[1] = matrices[4 + c], column[2] = matrices[8 + c];
    }
  self->is_posed = count > 0;
}

/* Finds as hfx_find_felt; a later search begins here. */
static inline hfx_felt *hfx_take_felt(hfx_body *self, uint32_t number) {
  hfx_felt *felt = hfx_find_felt(self, number);
  if (felt) self->recent = felt;
  return felt;
}

HFX_API int hfx_body_set_volume(hfx_body *self, uint32_t effect, const float *matrix) {
  hfx_felt *felt = hfx_take_felt(self, effect);
  int i;
  if (!felt) return HFX_ERROR_INDEX;
  for (i = 0; i < 12; i++) felt->matrix[i] = matrix[i];
  felt->is_flat = !hfx_inverse(felt->matrix, felt->to_shape);
  return 0;
}

HFX_API int hfx_body_set_parameter(hfx_body *self, uint32_t effect, uint32_t parameter,
                                   double value) {
  hfx_felt *felt = hfx_take_felt(self, effect);
  if (!felt || parameter > 3) return HFX_ERROR_INDEX;
  if (hfx_is_within(value, -HFX_HUGE_F32, HFX_HUGE_F32)) felt->parameters[parameter] = (float)value;
  return 0;
}

HFX_API int hfx_body_trigger(hfx_body *self, uint32_t effect, double factor) {
  hfx_felt *felt = hfx_take_felt(self, effect);
  if (!felt) return HFX_ERROR_INDEX;
  felt->level = hfx_clamped(hfx_positive(factor), 0.0, 1.0) * hfx_f32(felt->effect + 36);
  return 0;
}

HFX_API int hfx_body_place(hfx_body *self, uint32_t effect, double turn_degrees, double raise_m,
                           double stretch) {
  hfx_felt *felt = hfx_take_felt(self, effect);
  if (!felt || !hfx_u32(felt->effect + 4)) return HFX_ERROR_INDEX;
  hfx_paint(self, felt, hfx_is_within(turn_degrees, -1e9, 1e9) ? hfx_wrapped(turn_degrees) : 0.0,
            hfx_is_within(raise_m, -1e9, 1e9) ? raise_m : 0.0,
            hfx_is_within(stretch, 1e-9, 1e9) ? stretch : 1.0);
  return 0;
}

/* Evaluates one effect at this moment. */
static inline void hfx_feel(hfx_body *self, hfx_felt *felt, double seconds) {
  const int is_on = felt->model != HFX_NONE && felt->level > 0.0 && self->is_posed;
  int i;
  felt->response = 0.0;
  if (is_on && hfx_u32(felt->effect + 4)) {
    felt->response = 1.0;
  } else if (is_on) {
    hfx_touch touch;
    touch.felt = felt;
    touch.body = self;
    touch.weights = self->scratch, touch.peaks = self->scratch_peaks;
    touch.first = felt->first_chunk;
    touch.vertices = hfx_vertices_of(&self->clip, felt->model);
    touch.count = hfx_chunks_of(&self->clip, felt->model);
    hfx_place(&touch.volume, felt->effect, felt->matrix, felt->to_shape);
    if (!felt->is_flat) felt->response = hfx_respond(self, &touch, seconds);
    felt->was_flat = felt->is_flat;
    for (i = 0; i < 12; i++) felt->to_shape_before[i] = felt->to_shape[i];
  }
  if (!is_on) felt->was_touched = 0;
  felt->was_on = is_on;
}

/* Puts a vibration into a list by ascending frequency, behind those of the same frequency. */
static inline void hfx_add_tone(hfx_tone **first, hfx_tone **last, hfx_tone *tone) {
  if (*first && tone->hertz >= (*last)->hertz) first = &(*last)->next;
  else
    while (*first && (*first)->hertz <= tone->hertz) first = &(*first)->next;
  tone->next = *first;
  if (!*first) *last = tone;
  *first = tone;
}

/* Sum of vibrations at one place: within 1 Hz they add, else their powers do. The strongest's
 * frequency. */
static inline double hfx_together(const hfx_tone *tone, double *found_hz) {
  double power = 0.0, group = 0.0, strongest = 0.0, group_hz = -HFX_HUGE_F64;
  *found_hz = 0.0;
  for (; tone; tone = tone->next) {
    if (tone->hertz > group_hz + 1.0) {
      power += group * group;
      group = 0.0;
      group_hz = tone->hertz;
    }
    group += tone->strength;
    if (group > strongest) strongest = group, *found_hz = group_hz;
  }
  return sqrt(power + group * group);
}

/* Gain of an actuator for an effect: weights of the vertices that it reaches, times factors. */
static inline double hfx_gain(const hfx_body *self, const hfx_felt *felt, uint32_t reaction,
                              const unsigned char *at) {
  const hfx_reach *reach = self->reaches + self->reactions[reaction].first;
  const hfx_reach *end = self->reaches + self->reactions[reaction].end;
  const int is_mean = hfx_u32(at + 12) == 1;
  float strongest = 0.0f;
  double sum = 0.0;
  for (; reach < end; reach++) {
    const float *weights = felt->weights + HFX_CHUNK * (size_t)reach->chunk;
    if (!(felt->peaks[reach->chunk] * reach->most > strongest)) continue;
    if (is_mean) {
      float gains[HFX_CHUNK];
      int i;
      for (i = 0; i < HFX_CHUNK; i++) gains[i] = weights[i] * reach->factors[i];
      sum += hfx_total(gains);
    } else {
      const float gain = hfx_largest_product(weights, reach->factors);
      if (gain > strongest) strongest = gain;
    }
  }
  return is_mean && sum > 0.0 ? sum / hfx_u32(at + 28) : strongest;
}

/* Value of a reaction at its actuator, and for vibrations its frequency. */
static inline double hfx_react(hfx_body *self, uint32_t reaction, uint32_t target,
                               double *found_hz) {
  const unsigned char *at = hfx_record(&self->clip, HFX_REAC, reaction);
  const uint32_t modality = hfx_u32(at + 8);
  double sum = 0.0, wind[3] = {0.0, 0.0, 0.0};
  hfx_tone *first = NULL, *last = NULL;
  hfx_felt *felt;
  for (felt = self->acting[modality]; felt; felt = felt->next_acting) {
    double does;
    int c;
    if (felt->model != hfx_u32(at + 4)) continue;
    if (!(felt->chunk_bits & self->reactions[reaction].chunk_bits)) continue;
    does = hfx_gain(self, felt, reaction, at) * felt->response * felt->level;
    if (!(does > 0.0)) continue;
    does *= felt->parameters[0] -
            (modality == HFX_TEMPERATURE ? hfx_f32(felt->effect + 56) : 0.0);
    for (c = 0; c < 3; c++) wind[c] += does * felt->parameters[1 + c];
    felt->tone.strength = (float)does;
    felt->tone.hertz = felt->parameters[1];
    if (modality == HFX_VIBRATION) hfx_add_tone(&first, &last, &felt->tone);
    sum += does;
  }
  *found_hz = 0.0;
  if (modality == HFX_VIBRATION) sum = hfx_together(first, found_hz);
  if (modality == HFX_WIND) sum = sqrt(wind[0] * wind[0] + wind[1] * wind[1] + wind[2] * wind[2]);
  if (target != HFX_TEMPERATURE) sum = fabs(sum);
  if (hfx_f32(at + 20) > 0.0f) *found_hz = hfx_f32(at + 20);
  return sum * hfx_f32(at + 16);
}

static inline float hfx_limited(const unsigned char *column, double value) {
  return (float)hfx_clamped(value, hfx_f64(column + 16), hfx_f64(column + 24));
}

static inline void hfx_drive(hfx_body *self, float *out) {
  const hfx_clip *clip = &self->clip;
  const uint32_t reactions = clip->parts[HFX_REAC].count;
  uint32_t r = 0;
  while (r < reactions) {
    const uint32_t index = hfx_u32(hfx_record(clip, HFX_REAC, r));
    const unsigned char *actuator = hfx_record(clip, HFX_ACTR, index);
    const unsigned char *column = hfx_record(clip, HFX_COLM, hfx_u32(actuator + 8));
    const uint32_t target = hfx_u32(actuator + 4);
    hfx_tone *lowest = NULL, *last = NULL;
    double sum = 0.0, hz = 0.0;
    int is_any = 0;
    for (; r < reactions && hfx_u32(hfx_record(clip, HFX_REAC, r)) == index; r++) {
      const double does = hfx_react(self, r, target, &hz);
      if (does == 0.0) continue;
      sum += does;
      is_any = 1;
      self->reactions[r].tone.strength = (float)does;
      self->reactions[r].tone.hertz = (float)hz;
      if (target == HFX_VIBRATION) hfx_add_tone(&lowest, &last, &self->reactions[r].tone);
    }
    if (!is_any) continue;
    if (target == HFX_VIBRATION) sum = hfx_together(lowest, &hz);
    if (target == HFX_TEMPERATURE) sum += hfx_f64(column + 32);
    if (!hfx_is_within(sum, -HFX_HUGE_F64, HFX_HUGE_F64)) continue; /* of a strange clip: neutral */
    out[hfx_u32(actuator + 8)] = hfx_limited(column, sum);
    if (target != HFX_VIBRATION || hfx_u32(actuator + 12) < 2) continue;
    out[hfx_u32(actuator + 8) + 1] = hfx_limited(column + 40, hz);
  }
}

HFX_API void hfx_body_evaluate(hfx_body *self, double seconds, float *out) {
  hfx_felt *felt, **next_acting[HFX_WIND + 1];
  uint32_t k;
  int c;
  hfx_neutral(&self->clip, out);
  if (self->body >= hfx_clip_bodies(&self->clip)) return;
  seconds = hfx_elapsed(seconds);
  self->time_s += seconds;
  if (self->is_posed) hfx_begin_pose(self);
  for (k = 0; k <= HFX_WIND; k++) next_acting[k] = &self->acting[k], self->acting[k] = NULL;
  for (felt = self->felt; felt; felt = felt->next) {
    const uint32_t modality = hfx_u32(felt->effect + 8);
    hfx_feel(self, felt, seconds);
    felt->next_acting = NULL;
    if (!(felt->response > 0.0)) continue;
    *next_acting[modality] = felt;
    next_acting[modality] = &felt->next_acting;
  }
  for (k = 0; k < hfx_clip_bones(&self->clip, self->body); k++)
    for (c = 0; c < 16; c++) self->bones[k].before[c] = self->bones[k].now[c];
  self->was_posed = self->is_posed;
  hfx_drive(self, out);
}

HFX_API const float *hfx_body_weights(const hfx_body *self, uint32_t effect, uint32_t *count) {
  const hfx_felt *felt = hfx_find_felt(self, effect);
  *count = felt ? hfx_vertices_of(&self->clip, felt->model) : 0;
  return *count ? felt->weights : NULL;
}

HFX_API double hfx_body_level(const hfx_body *self, uint32_t effect) {
  const hfx_felt *felt = hfx_find_felt(self, effect);
  return felt ? felt->level * felt->response : 0.0;
}

#ifdef __cplusplus
}
#endif

#endif
