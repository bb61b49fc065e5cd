/* SPDX-License-Identifier: MIT
 *
 * A player of the baked part of a clip behind one pointer, for programs and languages that call a
 * library: it owns a copy of the clip's bytes. Every function may be given NULL, and checks sizes
 * and indices. Different players may be used by different threads at the same time, one player by
 * one thread at a time. Texts are UTF-8 and stay until the player is closed. */
#ifndef HFX_LIVE_PLAYER_H
#define HFX_LIVE_PLAYER_H

#include "live_body.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct hfx_live_player hfx_live_player;

/* Version of the library: 65536 * major + 256 * minor + patch. */
HFX_EXPORT uint32_t hfx_live_version(void);
/* Opens a clip, not playing yet, with gain and factors of 1 and no loop; NULL: `error`, which may
 * be NULL, gets a number for hfx_live_error. */
HFX_EXPORT hfx_live_player *hfx_live_player_open(const void *bytes, size_t size, int32_t *error);
HFX_EXPORT void hfx_live_player_close(hfx_live_player *self);

/* Length of the clip, seconds. */
HFX_EXPORT double hfx_live_player_seconds(const hfx_live_player *self);
/* Numbers of columns, devices and named clips. */
HFX_EXPORT uint32_t hfx_live_player_columns(const hfx_live_player *self);
HFX_EXPORT uint32_t hfx_live_player_devices(const hfx_live_player *self);
HFX_EXPORT uint32_t hfx_live_player_named_clips(const hfx_live_player *self);
/* Facts about one; 0, or HFX_ERROR_INDEX. Each pointer may be NULL. */
HFX_EXPORT int32_t hfx_live_player_column(const hfx_live_player *self, uint32_t index,
                                          const char **actuator, const char **parameter,
                                          const char **unit, double *lowest, double *highest,
                                          double *neutral);
HFX_EXPORT int32_t hfx_live_player_device(const hfx_live_player *self, uint32_t index,
                                          const char **id, uint32_t *first_column,
                                          uint32_t *columns, uint32_t *dead_man_ms);
HFX_EXPORT int32_t hfx_live_player_named_clip(const hfx_live_player *self, uint32_t index,
                                              const char **name, double *start_s, double *end_s);

/* As of hfx_player_...: 0, or an hfx_error. */

/* Begins with the whole clip (NULL or "") or a named one; gain, factors and loop stay. An unknown
 * name is HFX_ERROR_NAME, and silence. */
HFX_EXPORT int32_t hfx_live_player_play(hfx_live_player *self, const char *name);
/* Goes on by seconds. `out` gets the values of all columns, `count` is their number. */
HFX_EXPORT int32_t hfx_live_player_advance(hfx_live_player *self, double seconds, float *out,
                                           uint32_t count);
/* Neutral values, and pause. */
HFX_EXPORT int32_t hfx_live_player_silence(hfx_live_player *self, float *out, uint32_t count);
HFX_EXPORT int32_t hfx_live_player_pause(hfx_live_player *self, int32_t is_paused);
HFX_EXPORT int32_t hfx_live_player_stop(hfx_live_player *self);
HFX_EXPORT int32_t hfx_live_player_seek(hfx_live_player *self, double seconds);
HFX_EXPORT int32_t hfx_live_player_loop(hfx_live_player *self, int32_t loops);
HFX_EXPORT int32_t hfx_live_player_gain(hfx_live_player *self, double gain);
HFX_EXPORT int32_t hfx_live_player_place(hfx_live_player *self, double turn_degrees,
                                         double raise_m, double stretch);
HFX_EXPORT int32_t hfx_live_player_set_parameter(hfx_live_player *self, const char *parameter,
                                                 double factor);
HFX_EXPORT int32_t hfx_live_player_is_playing(const hfx_live_player *self); /* 0 or 1 */
HFX_EXPORT double hfx_live_player_position(const hfx_live_player *self);    /* seconds */

#ifdef __cplusplus
}
#endif

#endif
