// SPDX-License-Identifier: GPL-3.0-or-later
// Description of what the library was built of, and of what it exports; by release/native_build.py.

#include "hfx_native.h"

// "hfx_native", digest of the sources, target; empty for a build by hand.
#ifndef HFX_BUILD
#define HFX_BUILD ""
#endif

HFX_EXPORT const char *hfx_build(void) { return HFX_BUILD; }

// Functions and structures as JSON, for engine/native/library.py.
#ifndef HFX_INTERFACE
#define HFX_INTERFACE ""
#endif

HFX_EXPORT const char *hfx_interface(void) { return HFX_INTERFACE; }
