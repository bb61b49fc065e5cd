// SPDX-License-Identifier: GPL-3.0-or-later
// Which interface the library has, and of what it was built.

#include "hfx_native.h"

// The digest of the sources and the target; a build by hand does not say.
#ifndef HFX_BUILD
#define HFX_BUILD ""
#endif

HFX_EXPORT int64_t hfx_interface(void) { return HFX_INTERFACE; }

HFX_EXPORT const char *hfx_build(void) { return HFX_BUILD; }
