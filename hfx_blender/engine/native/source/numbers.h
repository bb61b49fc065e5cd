// SPDX-License-Identifier: GPL-3.0-or-later
// Minimum and maximum of two numbers.

#ifndef HFX_NUMBERS_H
#define HFX_NUMBERS_H

// NaN where either is, as numpy's and not as C's.
static inline double hfx_smaller(double a, double b) { return (a <= b || a != a) ? a : b; }
static inline double hfx_larger(double a, double b) { return (a >= b || a != a) ? a : b; }

// The second one where they do not compare: an instruction each, which the C library's are not.
static inline double lesser(double one, double other) { return one < other ? one : other; }
static inline double greater(double one, double other) { return one > other ? one : other; }

#endif
