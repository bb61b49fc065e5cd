/* SPDX-License-Identifier: MIT
 *
 * The core as a WebAssembly module. Its memory belongs to src/core.js, which asks for sizes. */
#define HFX_API __attribute__((visibility("default")))
#include "../core/hfx_player.h"

HFX_API size_t hfx_clip_size(void);
HFX_API size_t hfx_player_size(void);
HFX_API size_t hfx_body_size(void);
HFX_API size_t hfx_stroke_size(void);

size_t hfx_clip_size(void) { return sizeof(hfx_clip); }
size_t hfx_player_size(void) { return sizeof(hfx_player); }
size_t hfx_body_size(void) { return sizeof(hfx_body); }
size_t hfx_stroke_size(void) { return sizeof(hfx_stroke); }
