// SPDX-License-Identifier: GPL-3.0-or-later
// Two numbers at once, each computed as one alone would be.

#ifndef HFX_PAIRS_OF_NUMBERS_H
#define HFX_PAIRS_OF_NUMBERS_H

#include <math.h>
#include <stdint.h>

typedef double hfx_two __attribute__((vector_size(16)));
typedef int64_t hfx_mask __attribute__((vector_size(16)));

// Two doubles as in arrays, which need not be aligned.
typedef double hfx_loose __attribute__((vector_size(16), aligned(8), may_alias));

static inline hfx_two hfx_sizes(hfx_two values) {
  return (hfx_two)((hfx_mask)values & (hfx_mask){INT64_MAX, INT64_MAX});
}

static inline hfx_two hfx_chosen(hfx_mask is_one, hfx_two one, hfx_two other) {
  return (hfx_two)((is_one & (hfx_mask)one) | (~is_one & (hfx_mask)other));
}

// NaN where either is, as hfx_larger.
static inline hfx_two hfx_larger_two(hfx_two a, hfx_two b) {
  return hfx_chosen((hfx_mask)(a >= b) | (hfx_mask)(a != a), a, b);
}

static inline hfx_two hfx_roots(hfx_two values) { return (hfx_two){sqrt(values[0]), sqrt(values[1])}; }

#endif
