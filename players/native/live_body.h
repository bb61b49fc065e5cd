/* SPDX-License-Identifier: MIT
 *
 * A body of a clip behind one pointer, for engines that call a library: it owns copies of the
 * clip's bytes and all memory. Every function may be given NULL, and checks sizes and indices. */
#ifndef HFX_LIVE_BODY_H
#define HFX_LIVE_BODY_H

#include <stddef.h>
#include <stdint.h>

#ifdef _WIN32
#define HFX_EXPORT __declspec(dllexport)
#else
#define HFX_EXPORT __attribute__((visibility("default")))
#endif

typedef struct hfx_live_body hfx_live_body;

/* Opens a body of a clip; NULL: `error` says why, for hfx_live_error. */
HFX_EXPORT hfx_live_body *hfx_live_open(const void *bytes, size_t size, uint32_t body, int32_t *error);
/* The same with the effects of another clip, as of hfx_body_open_effects; no bytes (NULL or 0): of
 * the clip itself. */
HFX_EXPORT hfx_live_body *hfx_live_open_effects(const void *bytes, size_t size, uint32_t body,
                                                const void *effects, size_t effects_size,
                                                int32_t *error);
HFX_EXPORT void hfx_live_close(hfx_live_body *self);
/* One sentence about an error, in English. */
HFX_EXPORT const char *hfx_live_error(int32_t error);
HFX_EXPORT uint32_t hfx_live_columns(const hfx_live_body *self);
/* As of hfx_body_...: 0, or an hfx_error. `count` is the number of floats. */
HFX_EXPORT int32_t hfx_live_set_bones(hfx_live_body *self, const float *matrices, uint32_t count);
HFX_EXPORT int32_t hfx_live_set_volume(hfx_live_body *self, uint32_t effect, const float *matrix,
                                       uint32_t count);
HFX_EXPORT int32_t hfx_live_set_parameter(hfx_live_body *self, uint32_t effect, uint32_t parameter,
                                          double value);
/* Turns, raises and stretches a painted area. */
HFX_EXPORT int32_t hfx_live_place(hfx_live_body *self, uint32_t effect, double turn_degrees,
                                  double raise_m, double stretch);
HFX_EXPORT int32_t hfx_live_trigger(hfx_live_body *self, uint32_t effect, double factor);
/* Adds one more volume of an effect, off; its number, which the other functions take in place of an
 * effect, or an hfx_error below 0. */
HFX_EXPORT int32_t hfx_live_add_volume(hfx_live_body *self, uint32_t effect);
/* Removes an added volume; 0, or HFX_ERROR_INDEX. */
HFX_EXPORT int32_t hfx_live_remove_volume(hfx_live_body *self, uint32_t number);
HFX_EXPORT int32_t hfx_live_evaluate(hfx_live_body *self, double seconds, float *out, uint32_t count);
/* Weights of the last evaluation; how many there are. `out` gets them where `count` is as many. */
HFX_EXPORT uint32_t hfx_live_weights(const hfx_live_body *self, uint32_t effect, float *out,
                                     uint32_t count);
/* Test that a bone of the body moves skin; 0 for a bone that is not there, too. */
HFX_EXPORT int32_t hfx_live_moves_skin(const hfx_live_body *self, uint32_t bone);
HFX_EXPORT double hfx_live_level(const hfx_live_body *self, uint32_t effect);

#endif
