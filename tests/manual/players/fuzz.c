/* SPDX-License-Identifier: GPL-3.0-or-later
 *
 * Throws damaged clips at the core: "fuzz SEED INPUTS CLIP..." changes the clips, sets size and
 * checksum right, opens and plays each, refused ones too, and evaluates a body of it. Compiled with the address and
 * undefined-behaviour sanitizers, which end the program at the first finding. */
#include "hfx_player.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static uint64_t state;

static uint32_t drawn(uint32_t below) { /* xorshift64* of Vigna */
  state ^= state >> 12;
  state ^= state << 25;
  state ^= state >> 27;
  return (uint32_t)((state * 2685821657736338717ull) >> 33) % (below ? below : 1);
}

static void put(unsigned char *at, uint32_t number) {
  int i;
  for (i = 0; i < 4; i++) at[i] = (unsigned char)(number >> 8 * i);
}

static double odd(void) { /* a number that a script may give */
  static const double strange[] = {-1.0, -1e300, 1e30, 1e300, 1e9, 0.0, -0.0, 5e-324, 1.0, 0.02};
  const uint32_t chosen = drawn(24);
  if (chosen < 10) return strange[chosen];
  if (chosen < 13) return chosen == 10 ? NAN : chosen == 11 ? INFINITY : -INFINITY;
  return drawn(5000) * 0.001;
}

/* Puts extreme but finite numbers into the filters and the parameters of effects. */
static void exaggerate(unsigned char *found) {
  static const uint32_t extreme[] = {0, 0x80000000, 1, 0x7F7FFFFF, 0xFF7FFFFF, 0x3F800000,
                                     0xBF800000, 0x3A83126F, 0x477FFF00, 0x00800000};
  uint32_t section, i, k;
  for (section = 0; section < hfx_u32(found + 20); section++) {
    const unsigned char *at = found + 24 + 16 * section;
    unsigned char *record = found + hfx_u32(at + 4);
    const int is_filter = !memcmp(at, "FLTR", 4), is_effect = !memcmp(at, "EFCT", 4);
    const uint32_t size = is_filter ? 32 : 128, first = is_filter ? 3 : 10, count = is_filter ? 5 : 4;
    if (!is_filter && !is_effect) continue;
    for (i = 0; i < hfx_u32(at + 8) / size; i++)
      for (k = first; k < first + count; k++)
        if (drawn(3) == 0) put(record + size * i + 4 * k, extreme[drawn(10)]);
  }
}

static size_t damaged(const unsigned char *clip, size_t size, unsigned char *found) {
  static const uint32_t strange[] = {0, 1, 2, 3, 7, 8, 0x7F, 0x80, 0xFF, 0xFFFF, 0x10000,
                                     0x7FFFFFFF, 0x80000000, 0xFFFFFFFE, 0xFFFFFFFF, 0x7FC00000,
                                     0x7F800000, 0xFF800000, 0x7F7FFFFF, 0x3F800000};
  uint32_t changes = 1 + drawn(3);
  memcpy(found, clip, size);
  if (drawn(8) == 0) exaggerate(found), changes = drawn(2);
  for (; changes; changes--) {
    const uint32_t way = drawn(16);
    size_t at = 20 + drawn((uint32_t)size - 23);
    if (way < 2) found[at] = (unsigned char)drawn(256);
    else if (way == 2 && size > 48) size = 24 + drawn((uint32_t)size - 24);
    else {
      at -= at % 4;
      if (way < 8) put(found + at, strange[drawn(sizeof strange / sizeof *strange)]);
      else if (way < 13) put(found + at, hfx_u32(found + at) + drawn(9) - 4);
      else put(found + at, hfx_u32(found + 24 + 4 * drawn((uint32_t)(size - 24) / 4)));
    }
    if (size < 32) break;
  }
  put(found + 12, (uint32_t)size);
  put(found + 16, hfx_crc32(found + 20, size - 20));
  return size;
}

static void play(const hfx_clip *clip) {
  const uint32_t columns = hfx_clip_columns(clip);
  float *out = (float *)malloc(4 * (size_t)columns + 1);
  hfx_player player;
  hfx_named_clip named;
  hfx_device device;
  hfx_actuator actuator;
  hfx_column column;
  hfx_bone bone;
  hfx_effect effect;
  uint32_t i, sum = 0;
  for (i = 0; !hfx_clip_device(clip, i, &device); i++) sum += (uint32_t)strlen(device.body);
  for (i = 0; !hfx_clip_actuator(clip, i, &actuator); i++) sum += (uint32_t)strlen(actuator.bone);
  for (i = 0; !hfx_clip_column(clip, i, &column); i++) sum += (uint32_t)strlen(column.unit);
  for (i = 0; !hfx_clip_bone(clip, 0, i, &bone); i++) sum += (uint32_t)strlen(bone.human);
  for (i = 0; !hfx_clip_effect(clip, i, &effect); i++) sum += (uint32_t)strlen(effect.name);
  hfx_player_play(&player, clip);
  hfx_player_loop(&player, (int)drawn(2));
  hfx_player_gain(&player, odd());
  if (columns) hfx_player_set_parameter(&player, column.parameter, odd());
  if (drawn(2)) hfx_player_place(&player, odd(), odd(), odd());
  else hfx_player_place(&player, drawn(400), 0.001 * drawn(500), 0.01 * drawn(300));
  for (i = 0; i < 4; i++) hfx_player_advance(&player, odd(), out);
  hfx_player_seek(&player, odd());
  hfx_player_advance(&player, 1e300, out);
  if (!hfx_clip_named_clip(clip, 0, &named)) hfx_player_play_named(&player, clip, named.name);
  hfx_player_advance(&player, 0.05, out);
  hfx_player_silence(&player, out);
  for (i = 0; i < columns; i++)
    if (!(out[i] - out[i] == 0.0f)) abort(); /* no finite number */
  free(out);
  (void)sum;
}

static void feel(const hfx_clip *clip, const hfx_clip *effects) {
  const size_t size = hfx_body_effects_bytes(clip, 0, effects);
  const uint32_t bones = hfx_clip_bones(clip, 0), columns = hfx_clip_columns(clip);
  float *matrices, *out, turned[12] = {0};
  uint32_t i, k, count;
  void *memory, *block;
  size_t needed;
  hfx_body body;
  if (!size || size > 1 << 26) return;
  memory = malloc(size);
  out = (float *)malloc(4 * (size_t)columns + 1);
  matrices = (float *)calloc(12 * (size_t)bones + 1, 4);
  if (!hfx_body_open_effects(&body, clip, 0, effects, memory, size)) {
    const uint32_t number = hfx_clip_effects(effects);
    uint32_t added[3];
    for (k = 0; k < 3; k++) {
      const uint32_t effect = number ? drawn(number) : 0;
      needed = hfx_body_effects_volume_bytes(clip, 0, effects, effect);
      block = needed && needed < 1 << 26 ? malloc(needed) : NULL;
      added[k] = hfx_body_add_volume(&body, effect, block, needed);
      if (added[k] == HFX_NONE) free(block);
      hfx_body_trigger(&body, added[k], odd());
      hfx_body_set_volume(&body, added[k], turned);
      if (drawn(3) == 0) free(hfx_body_remove_volume(&body, added[drawn(k + 1)]));
      for (i = 0; i < 12 * bones; i++)
        matrices[i] = (i % 12) % 5 == 0 && i % 12 < 11 ? 1.0f : 0.01f * (float)drawn(10);
      hfx_body_set_bones(&body, matrices);
      for (i = 0; i < 12; i++) turned[i] = (float)drawn(2000) * 0.001f - 1.0f;
      if (number) hfx_body_set_volume(&body, drawn(number), turned);
      for (i = 0; i < number; i++) hfx_body_trigger(&body, i, drawn(8) ? 1.0 : odd());
      if (drawn(8) == 0) matrices[drawn(12 * bones)] = (float)hfx_clamped(odd(), -3e38, 3e38);
      if (drawn(8) == 0) hfx_body_set_bones(&body, matrices);
      if (number && drawn(3) == 0)
        hfx_body_place(&body, drawn(number), drawn(2) ? odd() : drawn(400), odd(), drawn(2) ? odd() : 1.0);
      hfx_body_evaluate(&body, drawn(8) ? 0.02 : odd(), out);
      for (i = 0; i < number; i++) hfx_body_weights(&body, i, &count);
      for (i = 0; i < columns; i++)
        if (!(out[i] - out[i] == 0.0f)) abort();
    }
    for (k = 0; k < 3; k++) free(hfx_body_remove_volume(&body, added[k]));
  }
  free(memory);
  free(out);
  free(matrices);
}

static void explore(const hfx_clip *clip) {
  hfx_stroke stroke = {0, 0, 0, 0};
  hfx_surface surface;
  float out[2];
  uint32_t i, sum = 0;
  for (i = 0; !hfx_clip_surface(clip, i, &surface); i++) sum += (uint32_t)strlen(surface.name);
  for (i = 0; i < 6; i++) {
    const uint32_t count = hfx_clip_surfaces(clip), index = count ? drawn(count + 1) : 0;
    const double u = drawn(4) ? odd() : drawn(200) * 0.01, v = drawn(4) ? odd() : drawn(200) * 0.01;
    hfx_surface_feel(clip, index, &stroke, u, v, drawn(2) ? -1.0 : odd(), odd(), out);
    if (!(out[0] - out[0] == 0.0f && out[1] - out[1] == 0.0f)) abort(); /* no finite number */
    if (drawn(8) == 0) hfx_surface_lift(&stroke);
  }
  (void)sum;
}

int main(int count, char **given) {
  unsigned long inputs, done, opened = 0;
  unsigned char *clips[64];
  size_t sizes[64];
  int known = 0, k;
  if (count < 4) return 2;
  state = strtoull(given[1], NULL, 10) * 2 + 88172645463325253ull;
  inputs = strtoul(given[2], NULL, 10);
  for (k = 3; k < count && known < 64; k++, known++) {
    FILE *file = fopen(given[k], "rb");
    if (!file) return 2;
    clips[known] = (unsigned char *)malloc(1 << 22);
    sizes[known] = fread(clips[known], 1, 1 << 22, file);
    fclose(file);
  }
  for (done = 0; done < inputs; done++) {
    const uint32_t chosen = drawn((uint32_t)known);
    uint32_t other;
    /* of just its size, so that each byte past it is found */
    unsigned char *found = (unsigned char *)malloc(sizes[chosen]), *exact;
    const size_t size = damaged(clips[chosen], sizes[chosen], found);
    hfx_clip clip, whole;
    exact = (unsigned char *)malloc(size);
    memcpy(exact, found, size);
    free(found);
    opened += hfx_clip_open(&clip, exact, size) == 0;
    play(&clip);
    feel(&clip, &clip);
    other = drawn((uint32_t)known);
    if (drawn(4) == 0 && !hfx_clip_open(&whole, clips[other], sizes[other])) {
      feel(&clip, &whole); /* damaged body or devices, damaged effects */
      feel(&whole, &clip);
    }
    explore(&clip);
    free(exact);
  }
  for (k = 0; k < known; k++) free(clips[k]);
  printf("%lu %lu\n", done, opened);
  return 0;
}
