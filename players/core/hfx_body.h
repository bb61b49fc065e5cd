/* SPDX-License-Identifier: MIT
 *
 * A body that feels the effects of a clip, and what its actuators give of it. Included by
 * hfx_player.h. */
#ifndef HFX_BODY_H
#define HFX_BODY_H

#ifdef __cplusplus
extern "C" {
#endif

/* The chunk of a body where those of a model begin. */
static inline uint32_t hfx_first_chunk(const hfx_clip *clip, uint32_t body, uint32_t model) {
  uint32_t k, sum = 0;
  if (model == HFX_NONE) return 0;
  for (k = hfx_u32(hfx_record(clip, HFX_BODY, body) + 12); k < model; k++)
    sum += hfx_chunks_of(clip, k);
  return sum;
}

/* Number of chunks whose weights impacts of an effect hold; 0 without a filter for impacts. */
static inline uint32_t hfx_held_of(const hfx_clip *clip, uint32_t model, const hfx_clip *effects,
                                   const unsigned char *effect) {
  uint32_t i;
  for (i = 0; i < hfx_u32(effect + 64); i++)
    if (hfx_u32(hfx_record(effects, HFX_FLTR, hfx_u32(effect + 60) + i)) == HFX_IMPACT)
      return HFX_IMPACTS * hfx_chunks_of(clip, model);
  return 0;
}

/* Number of reaches of an actuator's reaction, one a chunk; they are written to `found` unless that
 * is NULL. */
static inline uint32_t hfx_find_reaches(const hfx_clip *clip, const unsigned char *reaction,
                                        hfx_reach *found) {
  const unsigned char *at = hfx_record(clip, HFX_RCHV, hfx_u32(reaction + 24));
  const unsigned char *end = at + 8 * (size_t)hfx_u32(reaction + 28);
  uint32_t count = 0, last = HFX_NONE;
  for (; at < end; at += 8) {
    const uint32_t chunk = hfx_u32(at) / HFX_CHUNK;
    count += chunk != last;
    last = chunk;
    if (!found) continue;
    found[count - 1].chunk = chunk;
    found[count - 1].factors[hfx_u32(at) % HFX_CHUNK] = hfx_f32(at + 4);
    if (hfx_f32(at + 4) > found[count - 1].most) found[count - 1].most = hfx_f32(at + 4);
  }
  return count;
}

/* Tells whether a reaction is to effects on a model of a body. */
static inline int hfx_is_reaction_of(const hfx_clip *clip, uint32_t body,
                                     const unsigned char *reaction) {
  const unsigned char *at = hfx_record(clip, HFX_BODY, body);
  return hfx_u32(reaction + 4) - hfx_u32(at + 12) < hfx_u32(at + 16);
}

#define HFX_PARTS 16 /* of a body's memory */

/* Parts of a body's memory, in bytes; their sum. */
static inline uint64_t hfx_parts_of(const hfx_clip *clip, uint32_t body, const hfx_clip *effects,
                                    uint64_t parts[HFX_PARTS]) {
  const unsigned char *at = hfx_record(clip, HFX_BODY, body);
  const uint64_t bones = hfx_u32(at + 8), reactions = clip->parts[HFX_REAC].count;
  uint64_t chunks = 0, linked = 0, pulls = 0, reaches = 0, weights = 0, held = 0, largest = 0;
  uint64_t sum = 15; /* for an address that is a multiple of 16 */
  uint32_t k;
  for (k = 0; k < hfx_u32(at + 16); k++) {
    const uint32_t count = hfx_chunks_of(clip, hfx_u32(at + 12) + k);
    chunks += count;
    hfx_count_bones(clip, hfx_record(clip, HFX_MODL, hfx_u32(at + 12) + k), &linked, &pulls);
    if (count > largest) largest = count;
  }
  for (k = 0; k < reactions; k++) {
    const unsigned char *reaction = hfx_record(clip, HFX_REAC, k);
    if (hfx_is_reaction_of(clip, body, reaction)) reaches += hfx_find_reaches(clip, reaction, NULL);
  }
  for (k = 0; k < hfx_clip_effects(effects); k++) {
    const unsigned char *effect = hfx_record(effects, HFX_EFCT, k);
    const uint32_t model = hfx_model_of(clip, body, effects, effect);
    weights += hfx_chunks_of(clip, model);
    held += hfx_held_of(clip, model, effects, effect);
  }
  parts[0] = 2 * sizeof(hfx_lanes) * (bones + 1);
  parts[1] = sizeof(hfx_felt) * (uint64_t)hfx_clip_effects(effects) + sizeof(hfx_clip);
  parts[2] = sizeof(hfx_reaction) * reactions;
  parts[3] = sizeof(hfx_reach) * reaches;
  parts[4] = parts[5] = sizeof(hfx_chunk) * chunks;
  parts[6] = sizeof(hfx_boxes) * (chunks / HFX_CHUNK + 1);
  parts[7] = sizeof(hfx_bone_pose) * (bones + 1);
  parts[8] = sizeof(hfx_rest) * chunks;
  parts[9] = sizeof(hfx_pull) * pulls;
  parts[10] = sizeof(hfx_near) * (largest + 1);
  parts[11] = 4 * (HFX_CHUNK + 1) * weights;
  parts[12] = 4 * (HFX_CHUNK + 1) * held;
  parts[13] = 4 * HFX_CHUNK * largest;
  parts[14] = 4 * largest;
  parts[15] = 4 * linked;
  for (k = 0; k < HFX_PARTS; k++) sum += parts[k];
  return sum;
}

HFX_API size_t hfx_body_effects_bytes(const hfx_clip *clip, uint32_t body,
                                      const hfx_clip *effects) {
  uint64_t parts[HFX_PARTS], sum;
  if (body >= hfx_clip_bodies(clip)) return 0;
  sum = hfx_parts_of(clip, body, effects, parts);
  return sum < (uint64_t)(size_t)-1 ? (size_t)sum : 0;
}

HFX_API size_t hfx_body_bytes(const hfx_clip *clip, uint32_t body) {
  return hfx_body_effects_bytes(clip, body, clip);
}

/* Sets up an effect on a body, off, in memory of zeros; where its weights end. */
static inline float *hfx_begin_felt(const hfx_body *self, hfx_felt *felt, uint32_t effect,
                                    float *weights) {
  uint32_t chunks, held;
  felt->effect = hfx_record(self->effects, HFX_EFCT, effect);
  felt->model = hfx_model_of(&self->clip, self->body, self->effects, felt->effect);
  felt->first_chunk = hfx_first_chunk(&self->clip, self->body, felt->model);
  chunks = hfx_chunks_of(&self->clip, felt->model);
  held = hfx_held_of(&self->clip, felt->model, self->effects, felt->effect);
  felt->weights = weights;
  felt->peaks = felt->weights + HFX_CHUNK * (size_t)chunks;
  felt->held = felt->peaks + chunks;
  felt->held_peaks = felt->held + HFX_CHUNK * (size_t)held;
  hfx_floats(felt->effect + 40, 4, felt->parameters);
  hfx_floats(felt->effect + 76, 12, felt->matrix);
  felt->is_flat = !hfx_inverse(felt->matrix, felt->to_shape);
  return felt->held_peaks + held;
}

/* Reads what actuators reach, into memory of zeros. */
static inline void hfx_read_reactions(hfx_body *self) {
  uint32_t k, i, first = 0;
  for (k = 0; k < self->clip.parts[HFX_REAC].count; k++) {
    const unsigned char *at = hfx_record(&self->clip, HFX_REAC, k);
    self->reactions[k].first = first;
    if (hfx_is_reaction_of(&self->clip, self->body, at))
      first += hfx_find_reaches(&self->clip, at, self->reaches + first);
    self->reactions[k].end = first;
    for (i = self->reactions[k].first; i < first; i++)
      self->reactions[k].chunk_bits |= (uint64_t)1 << self->reaches[i].chunk % 64;
  }
}

HFX_API int hfx_body_open_effects(hfx_body *self, const hfx_clip *clip, uint32_t body,
                                  const hfx_clip *effects, void *memory, size_t size) {
  unsigned char *at = (unsigned char *)memory;
  uint64_t parts[HFX_PARTS], i;
  uint32_t k;
  float *weights;
  hfx_clip *copy;
  self->clip = *clip;
  self->effects = NULL;
  self->body = HFX_NONE;
  self->felt = self->last = self->recent = NULL;
  if (body >= hfx_clip_bodies(clip)) return HFX_ERROR_INDEX;
  if (!memory || hfx_parts_of(clip, body, effects, parts) > size) return HFX_ERROR_MEMORY;
  for (i = 0; i < size; i++) at[i] = 0;
  at += (16 - (size_t)memory % 16) % 16;
  self->pose = (hfx_lanes *)(void *)at;
  self->felt = (hfx_felt *)(void *)(at += parts[0]);
  copy = (hfx_clip *)(void *)(self->felt + hfx_clip_effects(effects));
  if (!hfx_clip_effects(effects)) self->felt = NULL;
  *copy = *effects;
  self->effects = copy;
  self->reactions = (hfx_reaction *)(void *)(at += parts[1]);
  self->reaches = (hfx_reach *)(void *)(at += parts[2]);
  self->places = (hfx_chunk *)(void *)(at += parts[3]);
  self->before = (hfx_chunk *)(void *)(at += parts[4]);
  self->boxes = (hfx_boxes *)(void *)(at += parts[5]);
  self->bones = (hfx_bone_pose *)(void *)(at += parts[6]);
  self->rest = (hfx_rest *)(void *)(at += parts[7]);
  self->pulls = (hfx_pull *)(void *)(at += parts[8]);
  self->near = (hfx_near *)(void *)(at += parts[9]);
  weights = (float *)(void *)(at += parts[10]);
  self->scratch = (float *)(void *)(at += parts[11] + parts[12]);
  self->scratch_peaks = (float *)(void *)(at += parts[13]);
  self->chunk_bones = (uint32_t *)(void *)(at + parts[14]);
  self->body = body;
  self->frame = 0;
  self->chunks = (uint32_t)(parts[4] / sizeof(hfx_chunk));
  self->is_posed = self->was_posed = 0;
  self->time_s = 0.0;
  self->pose_before = self->pose + hfx_clip_bones(clip, body) + 1;
  hfx_read_skin(self);
  hfx_find_bone_extents(self);
  hfx_read_reactions(self);
  for (k = 0; k < hfx_clip_effects(effects); k++) {
    hfx_felt *felt = &self->felt[k];
    weights = hfx_begin_felt(self, felt, k, weights);
    if (hfx_u32(felt->effect + 4)) hfx_paint(self, felt, 0.0, 0.0, 1.0);
    else felt->level = hfx_f32(felt->effect + 36);
    felt->number = k;
    if (self->last) self->last->next = felt;
    self->last = self->recent = felt;
  }
  self->next_number = k;
  return 0;
}

HFX_API int hfx_body_open(hfx_body *self, const hfx_clip *clip, uint32_t body, void *memory,
                          size_t size) {
  return hfx_body_open_effects(self, clip, body, clip, memory, size);
}

HFX_API size_t hfx_body_effects_volume_bytes(const hfx_clip *clip, uint32_t body,
                                             const hfx_clip *effects, uint32_t effect) {
  const unsigned char *at;
  uint64_t bytes;
  uint32_t model;
  if (body >= hfx_clip_bodies(clip) || effect >= hfx_clip_effects(effects)) return 0;
  at = hfx_record(effects, HFX_EFCT, effect);
  model = hfx_model_of(clip, body, effects, at);
  if (hfx_u32(at + 4)) return 0;
  bytes = (uint64_t)hfx_chunks_of(clip, model) + hfx_held_of(clip, model, effects, at);
  bytes = sizeof(hfx_felt) + 4 * (HFX_CHUNK + 1) * bytes;
  return bytes < (uint64_t)(size_t)-1 ? (size_t)bytes : 0;
}

HFX_API size_t hfx_body_volume_bytes(const hfx_clip *clip, uint32_t body, uint32_t effect) {
  return hfx_body_effects_volume_bytes(clip, body, clip, effect);
}

HFX_API uint32_t hfx_body_add_volume(hfx_body *self, uint32_t effect, void *memory, size_t size) {
  const size_t needed =
      hfx_body_effects_volume_bytes(&self->clip, self->body, self->effects, effect);
  hfx_felt *felt = (hfx_felt *)memory;
  size_t i;
  if (!memory || !needed || size < needed || self->next_number == HFX_NONE) return HFX_NONE;
  for (i = 0; i < needed; i++) ((unsigned char *)memory)[i] = 0;
  hfx_begin_felt(self, felt, effect, (float *)(void *)(felt + 1));
  felt->number = self->next_number++;
  self->last->next = felt;
  self->last = felt;
  return felt->number;
}

HFX_API void *hfx_body_remove_volume(hfx_body *self, uint32_t number) {
  hfx_felt *felt = self->felt;
  if (number < hfx_clip_effects(self->effects)) return NULL;
  while (felt && felt->next && felt->next->number != number) felt = felt->next;
  if (!felt || !felt->next) return NULL;
  self->recent = felt;
  felt = felt->next;
  self->recent->next = felt->next;
  if (self->last == felt) self->last = self->recent;
  return felt;
}

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
    float gains[HFX_CHUNK];
    int i;
    if (!(felt->peaks[reach->chunk] * reach->most > strongest)) continue;
    for (i = 0; i < HFX_CHUNK; i++) gains[i] = weights[i] * reach->factors[i];
    if (is_mean) {
      sum += hfx_total(gains);
    } else {
      const float gain = hfx_largest(gains);
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
