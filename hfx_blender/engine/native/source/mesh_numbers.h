// SPDX-License-Identifier: GPL-3.0-or-later
// The lesser and the greater of two numbers, the second where they do not compare: an instruction
// each, which the C library's are not.

#ifndef HFX_MESH_NUMBERS_H
#define HFX_MESH_NUMBERS_H

static inline double lesser(double one, double other) { return one < other ? one : other; }

static inline double greater(double one, double other) { return one > other ? one : other; }

#endif
