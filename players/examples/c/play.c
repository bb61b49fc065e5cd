/* SPDX-License-Identifier: MIT
 *
 * hfx_play CLIP [NAME]: plays a clip or a named clip at 60 frames a second of its own time, and
 * prints the values of all columns as CSV. A game sends them to the hardware instead. */
#include <stdio.h>
#include <stdlib.h>

#include "hfx_player.h"

#define FRAME_S (1.0 / 60.0)

/* Bytes of a file, for free(); NULL: it cannot be read. */
static void *read_file(const char *path, size_t *size) {
  FILE *file = fopen(path, "rb");
  char *bytes = NULL;
  long length = -1;
  if (!file) return NULL;
  if (fseek(file, 0, SEEK_END) == 0) length = ftell(file);
  if (length > 0 && fseek(file, 0, SEEK_SET) == 0) bytes = (char *)malloc((size_t)length);
  if (bytes && fread(bytes, 1, (size_t)length, file) != (size_t)length) {
    free(bytes);
    bytes = NULL;
  }
  fclose(file);
  *size = bytes ? (size_t)length : 0;
  return bytes;
}

static void print_header(const hfx_clip *clip) {
  hfx_column column;
  hfx_actuator actuator;
  uint32_t k;
  printf("time_s");
  for (k = 0; hfx_clip_column(clip, k, &column) == 0; k++) {
    hfx_clip_actuator(clip, column.actuator, &actuator);
    printf(",%s %s", actuator.id, column.parameter);
  }
  printf("\n");
}

int main(int count, char **arguments) {
  hfx_clip clip;
  hfx_player player;
  float *values;
  uint32_t k;
  size_t size = 0;
  void *bytes = count > 1 ? read_file(arguments[1], &size) : NULL;
  int error;
  if (!bytes) {
    fprintf(stderr, "usage: hfx_play CLIP [NAME]; the clip has to be a file that can be read\n");
    return 2;
  }
  error = hfx_clip_open(&clip, bytes, size);
  if (!error && count > 2) error = hfx_player_play_named(&player, &clip, arguments[2]);
  else hfx_player_play(&player, &clip);
  hfx_player_loop(&player, 0); /* an end, also for a named clip that is meant to loop */
  values = (float *)malloc(sizeof *values * (hfx_clip_columns(&clip) + 1));
  if (error || !values) {
    fprintf(stderr, "%s: %s\n", arguments[1], hfx_error_text(error ? error : HFX_ERROR_MEMORY));
    free(values);
    free(bytes);
    return 3;
  }
  print_header(&clip);
  while (hfx_player_is_playing(&player)) {
    hfx_player_advance(&player, FRAME_S, values);
    printf("%.4f", hfx_player_position(&player));
    for (k = 0; k < hfx_clip_columns(&clip); k++) printf(",%.4f", values[k]);
    printf("\n");
  }
  free(values);
  free(bytes); /* the player must not be used any more */
  return 0;
}
