// SPDX-License-Identifier: GPL-3.0-or-later
// Linear blend skinning of clusters, and bounds of what is not posed.

#include <math.h>

#include "hfx_native.h"
#include "skin.h"
#include "skin_posing.h"

// See products.py and SkinnedModel.bone_matrices: rest to target space, (rows, count, 3, 4), and no
// less than what each stretches. Bones that a pose has not, rest.
HFX_EXPORT void hfx_bone_matrices(int64_t rows, int64_t count, int64_t all, const double *posed,
                                  const int64_t *row, const int64_t *bones, const double *to_target,
                                  double *matrices, double *stretches) {
  for (int64_t n = 0; n < rows; n++)
    for (int64_t b = 0; b < count; b++, matrices += 12) {
      hfx_find_matrix(posed + 12 * row[n] * all, all, bones[b], to_target + 16 * n, matrices);
      *stretches++ = hfx_stretch(matrices, 4);
    }
}

// See CellSizes.means: no less than the mean distance of any cell's skin from its vertex, at some
// rows of the matrices, (rows, asked).
HFX_EXPORT void hfx_cell_means(const hfx_bones *bones, const hfx_groups *groups, int64_t rows,
                               const int64_t *row, int64_t asked, const int64_t *clusters,
                               double *means) {
  for (int64_t n = 0; n < rows; n++)
    for (int64_t k = 0; k < asked; k++)
      *means++ = hfx_cell_mean(bones, groups + clusters[k], row[n]);
}
