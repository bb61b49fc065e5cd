// SPDX-License-Identifier: GPL-3.0-or-later
// Actuator gains from vertex weights.

#include <stdint.h>

#include "hfx_native.h"

// Gain of each actuator for each set of vertices: the largest weight among those
// that it reaches, (sets, actuator_count) zeros at first. Vertex v drives the actuators
// reached[starts[v]] to reached[starts[v + 1]], by `factors` if there are any. What is not a
// number stays so.
HFX_EXPORT void hfx_strongest(int64_t sets, const int64_t *offsets, const int32_t *vertices,
                              const float *weights, int64_t vertex_count, const int64_t *starts,
                              const int32_t *reached, const float *factors,
                              int64_t actuator_count, double *gains) {
  for (int64_t s = 0; s < sets; s++, gains += actuator_count) {
    for (int64_t e = offsets[s]; e < offsets[s + 1]; e++) {
      int64_t v = vertices[e];
      if (v < 0 || v >= vertex_count) continue;
      for (int64_t k = starts[v]; k < starts[v + 1]; k++) {
        double *gain = gains + reached[k];
        float value = factors ? weights[e] * factors[k] : weights[e];
        if (!(value <= *gain) && *gain == *gain) *gain = value;
      }
    }
  }
}
