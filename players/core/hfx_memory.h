/* SPDX-License-Identifier: MIT
 *
 * Memory of a body and of added volumes. Included by hfx_player.h. */
#ifndef HFX_MEMORY_H
#define HFX_MEMORY_H

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

/* Numbers that an effect keeps: weights, what impacts hold, and the largest of each chunk; rounded
 * up, so that the next are aligned, too. */
static inline uint64_t hfx_felt_floats(const hfx_clip *clip, uint32_t model,
                                       const hfx_clip *effects, const unsigned char *effect) {
  const uint64_t chunks =
      (uint64_t)hfx_chunks_of(clip, model) + hfx_held_of(clip, model, effects, effect);
  return ((HFX_CHUNK + 1) * chunks + 3) / 4 * 4;
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

#define HFX_PARTS 15 /* of a body's memory */

/* Parts of a body's memory, in bytes; their sum. */
static inline uint64_t hfx_parts_of(const hfx_clip *clip, uint32_t body, const hfx_clip *effects,
                                    uint64_t parts[HFX_PARTS]) {
  const unsigned char *at = hfx_record(clip, HFX_BODY, body);
  const uint64_t bones = hfx_u32(at + 8), reactions = clip->parts[HFX_REAC].count;
  uint64_t chunks = 0, linked = 0, pulls = 0, reaches = 0, floats = 0, largest = 0;
  uint64_t sum = 15; /* for an address that is a multiple of 16 */
  uint32_t k;
  for (k = 0; k < hfx_u32(at + 16); k++) {
    const uint32_t count = hfx_chunks_of(clip, hfx_u32(at + 12) + k);
    chunks += count;
    hfx_count_bones(clip, hfx_record(clip, HFX_MODL, hfx_u32(at + 12) + k), hfx_u32(at + 8),
                    &linked, &pulls);
    if (count > largest) largest = count;
  }
  for (k = 0; k < reactions; k++) {
    const unsigned char *reaction = hfx_record(clip, HFX_REAC, k);
    if (hfx_is_reaction_of(clip, body, reaction)) reaches += hfx_find_reaches(clip, reaction, NULL);
  }
  for (k = 0; k < hfx_clip_effects(effects); k++) {
    const unsigned char *effect = hfx_record(effects, HFX_EFCT, k);
    floats += hfx_felt_floats(clip, hfx_model_of(clip, body, effects, effect), effects, effect);
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
  parts[11] = 4 * floats;
  parts[12] = 4 * HFX_CHUNK * largest;
  parts[13] = 4 * largest;
  parts[14] = 4 * linked;
  for (k = 0; k < HFX_PARTS; k++) sum += parts[k] = (parts[k] + 15) / 16 * 16;
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
  felt->held = felt->weights + HFX_CHUNK * (size_t)chunks;
  felt->peaks = felt->held + HFX_CHUNK * (size_t)held;
  felt->held_peaks = felt->peaks + chunks;
  hfx_floats(felt->effect + 40, 4, felt->parameters);
  hfx_floats(felt->effect + 76, 12, felt->matrix);
  felt->is_flat = !hfx_inverse(felt->matrix, felt->to_shape);
  return weights + hfx_felt_floats(&self->clip, felt->model, self->effects, felt->effect);
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
  self->scratch = (float *)(void *)(at += parts[11]);
  self->scratch_peaks = (float *)(void *)(at += parts[12]);
  self->chunk_bones = (uint32_t *)(void *)(at + parts[13]);
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
  bytes = sizeof(hfx_felt) + 4 * hfx_felt_floats(clip, model, effects, at);
  return bytes < (uint64_t)(size_t)-1 ? (size_t)bytes : 0;
}

HFX_API size_t hfx_body_volume_bytes(const hfx_clip *clip, uint32_t body, uint32_t effect) {
  return hfx_body_effects_volume_bytes(clip, body, clip, effect);
}

HFX_API uint32_t hfx_body_add_volume(hfx_body *self, uint32_t effect, void *memory, size_t size) {
  const size_t needed =
      hfx_body_effects_volume_bytes(&self->clip, self->body, self->effects, effect);
  hfx_felt *felt = (hfx_felt *)memory;
  const hfx_felt *other;
  size_t i;
  if (!memory || !needed || size < needed || self->next_number == HFX_NONE) return HFX_NONE;
  /* Memory in use would close the list of volumes to a ring. */
  for (other = self->felt; other; other = other->next)
    if (other == felt) return HFX_NONE;
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

#ifdef __cplusplus
}
#endif

#endif
