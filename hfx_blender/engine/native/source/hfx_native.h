// SPDX-License-Identifier: GPL-3.0-or-later
// Definitions that all sources of the library share.

#ifndef HFX_NATIVE_H
#define HFX_NATIVE_H

#include <stdint.h>

#if defined(_WIN32)
#define HFX_EXPORT __declspec(dllexport)
// The headers for Windows make library calls of these.
#include <math.h>
#undef isfinite
#undef isnan
#define isfinite(x) __builtin_isfinite(x)
#define isnan(x) __builtin_isnan(x)
#else
#define HFX_EXPORT __attribute__((visibility("default")))
#endif

#endif
