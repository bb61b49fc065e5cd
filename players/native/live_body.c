/* SPDX-License-Identifier: MIT */
#include "live_body.h"

#include <stdlib.h>
#include <string.h>

#include "../core/hfx_player.h"

struct hfx_live_body {
  void *bytes, *effect_bytes, *memory; /* effect_bytes: NULL without effects of another clip */
  hfx_clip clip, effects;
  hfx_body body;
};

/* Opens a copy of a clip's bytes. */
static int opened_copy(hfx_clip *clip, void **copy, const void *bytes, size_t size) {
  *copy = bytes && size ? malloc(size) : NULL;
  if (!*copy) return HFX_ERROR_KIND;
  memcpy(*copy, bytes, size);
  return hfx_clip_open(clip, *copy, size);
}

static int opened(hfx_live_body *self, const void *bytes, size_t size, uint32_t body,
                  const void *effects, size_t effects_size) {
  int error = opened_copy(&self->clip, &self->bytes, bytes, size);
  size_t needed;
  self->effects = self->clip;
  if (!error && effects && effects_size)
    error = opened_copy(&self->effects, &self->effect_bytes, effects, effects_size);
  if (error) return error;
  needed = hfx_body_effects_bytes(&self->clip, body, &self->effects);
  if (!needed) return HFX_ERROR_INDEX;
  self->memory = malloc(needed);
  return hfx_body_open_effects(&self->body, &self->clip, body, &self->effects, self->memory,
                               needed);
}

hfx_live_body *hfx_live_open_effects(const void *bytes, size_t size, uint32_t body,
                                     const void *effects, size_t effects_size, int32_t *error) {
  hfx_live_body *self = (hfx_live_body *)calloc(1, sizeof *self);
  const int found =
      self ? opened(self, bytes, size, body, effects, effects_size) : HFX_ERROR_MEMORY;
  if (error) *error = found;
  if (!found) return self;
  hfx_live_close(self);
  return NULL;
}

hfx_live_body *hfx_live_open(const void *bytes, size_t size, uint32_t body, int32_t *error) {
  return hfx_live_open_effects(bytes, size, body, NULL, 0, error);
}

/* Frees all added volumes, and the rest. */
void hfx_live_close(hfx_live_body *self) {
  if (!self) return;
  while (self->body.last && hfx_live_remove_volume(self, self->body.last->number) == 0) continue;
  free(self->memory);
  free(self->bytes);
  free(self->effect_bytes);
  free(self);
}

const char *hfx_live_error(int32_t error) { return hfx_error_text(error); }

uint32_t hfx_live_columns(const hfx_live_body *self) {
  return self ? hfx_clip_columns(&self->clip) : 0;
}

int32_t hfx_live_set_bones(hfx_live_body *self, const float *matrices, uint32_t count) {
  if (!self || !matrices || count != 12 * hfx_clip_bones(&self->clip, self->body.body))
    return HFX_ERROR_SIZE;
  hfx_body_set_bones(&self->body, matrices);
  return 0;
}

int32_t hfx_live_set_volume(hfx_live_body *self, uint32_t effect, const float *matrix, uint32_t count) {
  if (!self || !matrix || count != 12) return HFX_ERROR_SIZE;
  return hfx_body_set_volume(&self->body, effect, matrix);
}

int32_t hfx_live_set_parameter(hfx_live_body *self, uint32_t effect, uint32_t parameter, double value) {
  return self ? hfx_body_set_parameter(&self->body, effect, parameter, value) : HFX_ERROR_INDEX;
}

int32_t hfx_live_trigger(hfx_live_body *self, uint32_t effect, double factor) {
  return self ? hfx_body_trigger(&self->body, effect, factor) : HFX_ERROR_INDEX;
}

int32_t hfx_live_place(hfx_live_body *self, uint32_t effect, double turn_degrees, double raise_m,
                       double stretch) {
  if (!self) return HFX_ERROR_INDEX;
  return hfx_body_place(&self->body, effect, turn_degrees, raise_m, stretch);
}

int32_t hfx_live_add_volume(hfx_live_body *self, uint32_t effect) {
  const size_t needed = self ? hfx_body_effects_volume_bytes(&self->clip, self->body.body,
                                                             &self->effects, effect)
                             : 0;
  void *memory = needed ? malloc(needed) : NULL;
  uint32_t number = HFX_NONE;
  if (!needed) return HFX_ERROR_INDEX;
  if (memory) number = hfx_body_add_volume(&self->body, effect, memory, needed);
  if (number <= 0x7FFFFFFFu) return (int32_t)number;
  if (number != HFX_NONE) hfx_body_remove_volume(&self->body, number);
  free(memory);
  return HFX_ERROR_MEMORY;
}

int32_t hfx_live_remove_volume(hfx_live_body *self, uint32_t number) {
  void *memory = self ? hfx_body_remove_volume(&self->body, number) : NULL;
  free(memory);
  return memory ? 0 : HFX_ERROR_INDEX;
}

int32_t hfx_live_evaluate(hfx_live_body *self, double seconds, float *out, uint32_t count) {
  if (!self || !out || count != hfx_clip_columns(&self->clip)) return HFX_ERROR_SIZE;
  hfx_body_evaluate(&self->body, seconds, out);
  return 0;
}

uint32_t hfx_live_weights(const hfx_live_body *self, uint32_t effect, float *out, uint32_t count) {
  uint32_t there = 0;
  const float *found = self ? hfx_body_weights(&self->body, effect, &there) : NULL;
  if (found && out && count == there) memcpy(out, found, sizeof *out * there);
  return there;
}

int32_t hfx_live_moves_skin(const hfx_live_body *self, uint32_t bone) {
  return self && bone < hfx_clip_bones(&self->clip, self->body.body) &&
         self->body.bones[bone].low[0] <= self->body.bones[bone].high[0];
}

double hfx_live_level(const hfx_live_body *self, uint32_t effect) {
  return self ? hfx_body_level(&self->body, effect) : 0.0;
}
