/* SPDX-License-Identifier: GPL-3.0-or-later
 *
 * Processor time of evaluating a body of a clip, as a ratio to a plain loop that poses the same
 * vertices: "cost CLIP MATRICES", where MATRICES are float32 of each frame's bones. */
#include "hfx_player.h"

#include <stdio.h>
#include <stdlib.h>
#include <time.h>

static void *read_file(const char *path, size_t *size) {
  FILE *file = fopen(path, "rb");
  char *content;
  if (!file || fseek(file, 0, SEEK_END)) exit(2);
  *size = (size_t)ftell(file);
  rewind(file);
  content = (char *)malloc(*size + 1);
  if (!content || fread(content, 1, *size, file) != *size) exit(2);
  fclose(file);
  return content;
}

typedef struct plain {
  uint32_t count, *offsets, *bones;
  float *weights, *rest, *posed;
} plain;

static plain made_plain(const hfx_clip *clip) {
  plain made;
  uint32_t i, total = clip->parts[HFX_WGHT].count;
  made.count = clip->parts[HFX_VERT].count;
  made.offsets = (uint32_t *)malloc(4 * (size_t)(made.count + 1));
  made.bones = (uint32_t *)malloc(4 * (size_t)total + 4);
  made.weights = (float *)malloc(4 * (size_t)total + 4);
  made.rest = (float *)malloc(12 * (size_t)made.count + 4);
  made.posed = (float *)malloc(12 * (size_t)made.count + 4);
  for (i = 0; i < made.count; i++) {
    made.offsets[i] = hfx_u32(hfx_record(clip, HFX_VERT, i) + 16);
    hfx_floats(hfx_record(clip, HFX_VERT, i), 3, made.rest + 3 * (size_t)i);
  }
  made.offsets[made.count] = total;
  for (i = 0; i < total; i++) {
    made.bones[i] = hfx_u16(hfx_record(clip, HFX_WGHT, i));
    made.weights[i] = (float)hfx_u16(hfx_record(clip, HFX_WGHT, i) + 2) / 65535.0f;
  }
  return made;
}

static void pose_plainly(const plain *of, const float *matrices) {
  uint32_t i, k;
  for (i = 0; i < of->count; i++) {
    const float x = of->rest[3 * i], y = of->rest[3 * i + 1], z = of->rest[3 * i + 2];
    float sum[3] = {0.0f, 0.0f, 0.0f};
    for (k = of->offsets[i]; k < of->offsets[i + 1]; k++) {
      const float *m = matrices + 12 * (size_t)of->bones[k];
      const float w = of->weights[k];
      sum[0] += w * (m[0] * x + m[1] * y + m[2] * z + m[3]);
      sum[1] += w * (m[4] * x + m[5] * y + m[6] * z + m[7]);
      sum[2] += w * (m[8] * x + m[9] * y + m[10] * z + m[11]);
    }
    of->posed[3 * i] = sum[0], of->posed[3 * i + 1] = sum[1], of->posed[3 * i + 2] = sum[2];
  }
}

int main(int count, char **given) {
  static hfx_clip clip;
  static hfx_body body;
  size_t size, bytes, frames, frame;
  double best_ours = 1e9, best_plain = 1e9, seen = 0.0;
  float *matrices, *out;
  void *memory;
  plain of;
  int turn;
  if (count < 3) return 2;
  memory = read_file(given[1], &size);
  if (hfx_clip_open(&clip, memory, size)) return 2;
  matrices = (float *)read_file(given[2], &bytes);
  frames = bytes / (48 * (size_t)hfx_clip_bones(&clip, 0));
  size = hfx_body_bytes(&clip, 0);
  memory = malloc(size);
  out = (float *)malloc(4 * (size_t)hfx_clip_columns(&clip) + 4);
  if (hfx_body_open(&body, &clip, 0, memory, size)) return 2;
  of = made_plain(&clip);
  for (turn = 0; turn < 20; turn++) {
    clock_t start = clock();
    double seconds;
    for (frame = 0; frame < frames; frame++) {
      hfx_body_set_bones(&body, matrices + 12 * frame * hfx_clip_bones(&clip, 0));
      hfx_body_evaluate(&body, 1.0 / 90.0, out);
      seen += out[0];
    }
    seconds = (double)(clock() - start) / CLOCKS_PER_SEC;
    if (seconds < best_ours) best_ours = seconds;
    start = clock();
    for (frame = 0; frame < frames; frame++) {
      pose_plainly(&of, matrices + 12 * frame * hfx_clip_bones(&clip, 0));
      seen += of.posed[frame % of.count];
    }
    seconds = (double)(clock() - start) / CLOCKS_PER_SEC;
    if (seconds < best_plain) best_plain = seconds;
  }
  printf("%u vertices, %u effects: %.1f us a frame, ratio to posing alone %.2f%s\n", of.count,
         hfx_clip_effects(&clip), best_ours / (double)frames * 1e6, best_ours / best_plain,
         seen == 0.5 ? "." : "");
  return 0;
}
