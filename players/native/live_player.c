/* SPDX-License-Identifier: MIT */
#include "live_player.h"

#include <stdlib.h>
#include <string.h>

#include "../core/hfx_player.h"

struct hfx_live_player {
  void *bytes;
  hfx_clip clip;
  hfx_player player;
};

uint32_t hfx_live_version(void) {
  return 65536u * HFX_PLAYER_VERSION_MAJOR + 256u * HFX_PLAYER_VERSION_MINOR +
         HFX_PLAYER_VERSION_PATCH;
}

static int opened_player(hfx_live_player *self, const void *bytes, size_t size) {
  int error;
  if (!bytes || !size) return HFX_ERROR_KIND;
  self->bytes = malloc(size);
  if (!self->bytes) return HFX_ERROR_MEMORY;
  memcpy(self->bytes, bytes, size);
  error = hfx_clip_open(&self->clip, self->bytes, size);
  if (error) return error;
  hfx_player_play(&self->player, &self->clip);
  hfx_player_stop(&self->player);
  return 0;
}

hfx_live_player *hfx_live_player_open(const void *bytes, size_t size, int32_t *error) {
  hfx_live_player *self = (hfx_live_player *)calloc(1, sizeof *self);
  const int found = self ? opened_player(self, bytes, size) : HFX_ERROR_MEMORY;
  if (error) *error = found;
  if (!found) return self;
  hfx_live_player_close(self);
  return NULL;
}

void hfx_live_player_close(hfx_live_player *self) {
  if (!self) return;
  free(self->bytes);
  free(self);
}

double hfx_live_player_seconds(const hfx_live_player *self) {
  return self ? hfx_clip_seconds(&self->clip) : 0.0;
}

uint32_t hfx_live_player_columns(const hfx_live_player *self) {
  return self ? hfx_clip_columns(&self->clip) : 0;
}

uint32_t hfx_live_player_devices(const hfx_live_player *self) {
  return self ? hfx_clip_devices(&self->clip) : 0;
}

uint32_t hfx_live_player_named_clips(const hfx_live_player *self) {
  return self ? hfx_clip_named_clips(&self->clip) : 0;
}

#define HFX_GIVE(target, value) \
  do { \
    if (target) *(target) = (value); \
  } while (0)

int32_t hfx_live_player_column(const hfx_live_player *self, uint32_t index, const char **actuator,
                               const char **parameter, const char **unit, double *lowest,
                               double *highest, double *neutral) {
  hfx_column column;
  hfx_actuator of;
  if (!self || hfx_clip_column(&self->clip, index, &column) ||
      hfx_clip_actuator(&self->clip, column.actuator, &of))
    return HFX_ERROR_INDEX;
  HFX_GIVE(actuator, of.id);
  HFX_GIVE(parameter, column.parameter);
  HFX_GIVE(unit, column.unit);
  HFX_GIVE(lowest, column.lowest);
  HFX_GIVE(highest, column.highest);
  HFX_GIVE(neutral, column.neutral);
  return 0;
}

int32_t hfx_live_player_device(const hfx_live_player *self, uint32_t index, const char **id,
                               uint32_t *first_column, uint32_t *columns, uint32_t *dead_man_ms) {
  hfx_device device;
  if (!self || hfx_clip_device(&self->clip, index, &device)) return HFX_ERROR_INDEX;
  HFX_GIVE(id, device.id);
  HFX_GIVE(first_column, device.first_column);
  HFX_GIVE(columns, device.columns);
  HFX_GIVE(dead_man_ms, device.dead_man_ms);
  return 0;
}

int32_t hfx_live_player_named_clip(const hfx_live_player *self, uint32_t index, const char **name,
                                   double *start_s, double *end_s) {
  hfx_named_clip clip;
  if (!self || hfx_clip_named_clip(&self->clip, index, &clip)) return HFX_ERROR_INDEX;
  HFX_GIVE(name, clip.name);
  HFX_GIVE(start_s, clip.start_s);
  HFX_GIVE(end_s, clip.end_s);
  return 0;
}

int32_t hfx_live_player_play(hfx_live_player *self, const char *name) {
  return self ? hfx_player_replay(&self->player, name) : HFX_ERROR_INDEX;
}

int32_t hfx_live_player_advance(hfx_live_player *self, double seconds, float *out, uint32_t count) {
  if (!self || !out || count != hfx_clip_columns(&self->clip)) return HFX_ERROR_SIZE;
  hfx_player_advance(&self->player, seconds, out);
  return 0;
}

int32_t hfx_live_player_silence(hfx_live_player *self, float *out, uint32_t count) {
  if (!self || !out || count != hfx_clip_columns(&self->clip)) return HFX_ERROR_SIZE;
  hfx_player_silence(&self->player, out);
  return 0;
}

int32_t hfx_live_player_pause(hfx_live_player *self, int32_t is_paused) {
  if (!self) return HFX_ERROR_INDEX;
  hfx_player_pause(&self->player, is_paused);
  return 0;
}

int32_t hfx_live_player_stop(hfx_live_player *self) {
  if (!self) return HFX_ERROR_INDEX;
  hfx_player_stop(&self->player);
  return 0;
}

int32_t hfx_live_player_seek(hfx_live_player *self, double seconds) {
  if (!self) return HFX_ERROR_INDEX;
  hfx_player_seek(&self->player, seconds);
  return 0;
}

int32_t hfx_live_player_loop(hfx_live_player *self, int32_t loops) {
  if (!self) return HFX_ERROR_INDEX;
  hfx_player_loop(&self->player, loops);
  return 0;
}

int32_t hfx_live_player_gain(hfx_live_player *self, double gain) {
  if (!self) return HFX_ERROR_INDEX;
  hfx_player_gain(&self->player, gain);
  return 0;
}

int32_t hfx_live_player_place(hfx_live_player *self, double turn_degrees, double raise_m,
                              double stretch) {
  if (!self) return HFX_ERROR_INDEX;
  hfx_player_place(&self->player, turn_degrees, raise_m, stretch);
  return 0;
}

int32_t hfx_live_player_set_parameter(hfx_live_player *self, const char *parameter, double factor) {
  return self ? hfx_player_set_parameter(&self->player, parameter, factor) : HFX_ERROR_INDEX;
}

int32_t hfx_live_player_is_playing(const hfx_live_player *self) {
  return self ? hfx_player_is_playing(&self->player) : 0;
}

double hfx_live_player_position(const hfx_live_player *self) {
  return self ? hfx_player_position(&self->player) : 0.0;
}
