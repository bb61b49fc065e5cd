/* SPDX-License-Identifier: MIT
 *
 * The core as a WebAssembly module. Its memory belongs to src/core.js, which asks for sizes, and
 * gives JavaScript's Math for the functions that WebAssembly has no instructions for: compiled in,
 * they would be 20 kB. */
#include <math.h>

#define IMPORTED(name) __attribute__((import_module("math"), import_name(name)))
IMPORTED("exp") double math_exp(double x);
IMPORTED("log") double math_log(double x);
IMPORTED("pow") double math_pow(double x, double y);
IMPORTED("sin") double math_sin(double x);
#define exp math_exp
#define log math_log
#define pow math_pow
#define sin math_sin

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
