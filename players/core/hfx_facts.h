/* SPDX-License-Identifier: MIT
 *
 * Facts about what is in a clip. Included by hfx_player.h. */
#ifndef HFX_FACTS_H
#define HFX_FACTS_H

#ifdef __cplusplus
extern "C" {
#endif

static inline uint32_t hfx_count(const hfx_clip *clip, int section) {
  return clip ? clip->parts[section].count : 0;
}

HFX_API double hfx_clip_seconds(const hfx_clip *clip) {
  return clip && clip->row_count ? clip->row_count / clip->rate_hz : 0.0; /* zeros: no clip yet */
}

HFX_API uint32_t hfx_clip_devices(const hfx_clip *clip) { return hfx_count(clip, HFX_DEVC); }
HFX_API uint32_t hfx_clip_actuators(const hfx_clip *clip) { return hfx_count(clip, HFX_ACTR); }
HFX_API uint32_t hfx_clip_columns(const hfx_clip *clip) { return hfx_count(clip, HFX_COLM); }
HFX_API uint32_t hfx_clip_named_clips(const hfx_clip *clip) { return hfx_count(clip, HFX_CLIP); }
HFX_API uint32_t hfx_clip_bodies(const hfx_clip *clip) { return hfx_count(clip, HFX_BODY); }
HFX_API uint32_t hfx_clip_effects(const hfx_clip *clip) { return hfx_count(clip, HFX_EFCT); }

HFX_API uint32_t hfx_clip_bones(const hfx_clip *clip, uint32_t body) {
  return body < hfx_clip_bodies(clip) ? hfx_u32(hfx_record(clip, HFX_BODY, body) + 8) : 0;
}

static inline void hfx_floats(const unsigned char *at, uint32_t count, float *found) {
  uint32_t i;
  for (i = 0; i < count; i++) found[i] = hfx_f32(at + 4 * i);
}

HFX_API int hfx_clip_device(const hfx_clip *clip, uint32_t index, hfx_device *found) {
  const unsigned char *at;
  if (index >= hfx_clip_devices(clip)) return HFX_ERROR_INDEX;
  at = hfx_record(clip, HFX_DEVC, index);
  found->id = hfx_text(clip, at);
  found->name = hfx_text(clip, at + 4);
  found->body = hfx_text(clip, at + 8);
  found->first_actuator = hfx_u32(at + 12);
  found->actuators = hfx_u32(at + 16);
  found->first_column = hfx_u32(at + 20);
  found->columns = hfx_u32(at + 24);
  found->dead_man_ms = hfx_u32(at + 28);
  return 0;
}

HFX_API int hfx_clip_is_device(const hfx_clip *clip, uint32_t index, const char *name) {
  const char *id;
  if (index >= hfx_clip_devices(clip) || !name) return 0;
  if (!*name) return 1;
  for (id = hfx_text(clip, hfx_record(clip, HFX_DEVC, index)); *name && *name == *id; name++) id++;
  return !*name && (!*id || hfx_same(id, "_left") || hfx_same(id, "_right"));
}

HFX_API int hfx_clip_actuator(const hfx_clip *clip, uint32_t index, hfx_actuator *found) {
  const unsigned char *at;
  if (index >= hfx_clip_actuators(clip)) return HFX_ERROR_INDEX;
  at = hfx_record(clip, HFX_ACTR, index);
  found->id = hfx_text(clip, at);
  found->modality = hfx_u32(at + 4);
  found->first_column = hfx_u32(at + 8);
  found->columns = hfx_u32(at + 12);
  found->place = hfx_u32(at + 28);
  found->side = hfx_u32(at + 32);
  found->parts = hfx_text(clip, at + 36);
  found->bone = hfx_text(clip, at + 40);
  found->human_bone = hfx_text(clip, at + 44);
  hfx_floats(at + 48, 3, found->centre_m);
  found->radius_m = hfx_f32(at + 60);
  found->latency_ms = hfx_f32(at + 64);
  found->update_interval_ms = hfx_f32(at + 68);
  found->slew_per_s = hfx_f32(at + 72);
  found->maximum_on_s = hfx_f32(at + 76);
  found->rest_s = hfx_f32(at + 80);
  return 0;
}

HFX_API int hfx_clip_column(const hfx_clip *clip, uint32_t index, hfx_column *found) {
  const unsigned char *at;
  if (index >= hfx_clip_columns(clip)) return HFX_ERROR_INDEX;
  at = hfx_record(clip, HFX_COLM, index);
  found->parameter = hfx_text(clip, at);
  found->unit = hfx_text(clip, at + 4);
  found->actuator = hfx_u32(at + 8);
  found->lowest = hfx_f64(at + 16);
  found->highest = hfx_f64(at + 24);
  found->neutral = hfx_f64(at + 32);
  return 0;
}

HFX_API int hfx_clip_named_clip(const hfx_clip *clip, uint32_t index, hfx_named_clip *found) {
  const unsigned char *at;
  if (index >= hfx_clip_named_clips(clip)) return HFX_ERROR_INDEX;
  at = hfx_record(clip, HFX_CLIP, index);
  found->name = hfx_text(clip, at);
  found->loops = (int)hfx_u32(at + 4);
  found->start_s = hfx_f64(at + 8);
  found->end_s = hfx_f64(at + 16);
  return 0;
}

HFX_API int hfx_clip_bone(const hfx_clip *clip, uint32_t body, uint32_t index, hfx_bone *found) {
  const unsigned char *at;
  if (index >= hfx_clip_bones(clip, body)) return HFX_ERROR_INDEX;
  at = hfx_record(clip, HFX_BONE, hfx_u32(hfx_record(clip, HFX_BODY, body) + 4) + index);
  found->name = hfx_text(clip, at);
  found->human = hfx_text(clip, at + 4);
  found->mixamo = hfx_text(clip, at + 8);
  found->unreal = hfx_text(clip, at + 12);
  found->parent = hfx_u32(at + 16);
  found->length_m = hfx_f32(at + 20);
  hfx_floats(at + 24, 12, found->rest);
  return 0;
}

HFX_API int hfx_clip_effect(const hfx_clip *clip, uint32_t index, hfx_effect *found) {
  const unsigned char *at;
  if (index >= hfx_clip_effects(clip)) return HFX_ERROR_INDEX;
  at = hfx_record(clip, HFX_EFCT, index);
  found->name = hfx_text(clip, at);
  found->is_painted = (int)hfx_u32(at + 4);
  found->modality = hfx_u32(at + 8);
  found->body = hfx_u32(at + 12);
  found->shape = hfx_u32(at + 20);
  found->half_segment = hfx_f32(at + 24);
  found->level = hfx_f32(at + 36);
  hfx_floats(at + 40, 4, found->parameters);
  hfx_floats(at + 76, 12, found->matrix);
  return 0;
}

#ifdef __cplusplus
}
#endif

#endif
