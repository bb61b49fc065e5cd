/* SPDX-License-Identifier: MIT
 *
 * The core as a shared library, for programs that load it (ctypes of Python, for one). The build
 * defines HFX_CORE_BUILD, a text by which a file is recognised as of these sources. */
#ifdef _WIN32
#define HFX_API __declspec(dllexport)
#else
#define HFX_API __attribute__((visibility("default")))
#endif

#include "../core/hfx_player.h"

#ifndef HFX_CORE_BUILD
#define HFX_CORE_BUILD "hfx_player_core"
#endif

HFX_API const char *hfx_core_build(void);
HFX_API size_t hfx_core_bytes(int which);

const char *hfx_core_build(void) { return HFX_CORE_BUILD; }

/* Bytes of an hfx_clip (0) and an hfx_body (1), which a caller without this header allocates. */
size_t hfx_core_bytes(int which) { return which ? sizeof(hfx_body) : sizeof(hfx_clip); }
