// SPDX-License-Identifier: GPL-3.0-or-later
// The smaller and the larger of two numbers, and not a number where either is: as numpy's, not C's.

#ifndef HFX_NUMBERS_H
#define HFX_NUMBERS_H

static inline double hfx_smaller(double a, double b) { return (a <= b || a != a) ? a : b; }
static inline double hfx_larger(double a, double b) { return (a >= b || a != a) ? a : b; }

#endif
