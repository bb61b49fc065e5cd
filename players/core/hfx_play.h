/* SPDX-License-Identifier: MIT
 *
 * Playing of the baked part: docs/formats/clip.md, "Playing". Included by hfx_player.h. */
#ifndef HFX_PLAY_H
#define HFX_PLAY_H

#ifdef __cplusplus
extern "C" {
#endif

#define HFX_EARLY 1e-6 /* of a row: times of frames are sums, and rounded */

static inline double hfx_positive(double value) {
  return value > 0.0 ? (value < HFX_HUGE_F32 ? value : HFX_HUGE_F32) : 0.0; /* NaN: 0 */
}

static inline double hfx_clamped(double value, double lowest, double highest) {
  return value < lowest ? lowest : value > highest ? highest : value;
}

/* Seconds between two frames, at most 30 years, which no sum of times survives. */
static inline double hfx_elapsed(double seconds) {
  return hfx_clamped(hfx_positive(seconds), 0.0, 1e9);
}

/* Row of a time, among those of the part that is played. */
static inline int64_t hfx_row_of(const hfx_player *player, double seconds) {
  const double rate = player->clip.rate_hz;
  const double last = ceil(player->end_s * rate - HFX_EARLY) - 1.0;
  const double first = hfx_clamped(floor(player->start_s * rate + HFX_EARLY), 0.0, last);
  return (int64_t)hfx_clamped(floor(seconds * rate + HFX_EARLY), first, last);
}

/* The entry of an actuator that holds at a row. */
static inline uint32_t hfx_entry_at(const unsigned char *rows, uint32_t count, int64_t row) {
  uint32_t low = 0, high = count; /* rows[low] <= row < rows[high] */
  while (high - low > 1) {
    const uint32_t middle = low + (high - low) / 2;
    if ((int64_t)hfx_u32(rows + 4 * (size_t)middle) <= row) low = middle;
    else high = middle;
  }
  return low;
}

static inline double hfx_decoded(const unsigned char *column, uint32_t number) {
  const double lowest = hfx_f64(column + 16), highest = hfx_f64(column + 24);
  if (number == hfx_u32(column + 12)) return hfx_f64(column + 32);
  return lowest + (highest - lowest) * number / 65535.0;
}

static inline int hfx_parameter(char letter) { /* names of columns begin with different ones */
  return letter == 'a' ? 0 : letter == 'f' ? 1 : letter == 'p' ? 2 : letter == 't' ? 3
       : letter == 's' ? 4 : HFX_PARAMETERS;
}

/* A value with gain and factors; the column's limits hold where these change it. */
static inline double hfx_scaled(const hfx_player *player, uint32_t column, double value,
                                int is_strength) {
  const unsigned char *at = hfx_record(&player->clip, HFX_COLM, column);
  const int parameter = hfx_parameter(hfx_text(&player->clip, at)[0]);
  const double factor = parameter < HFX_PARAMETERS ? player->factors[parameter] : 1.0;
  const double neutral = is_strength ? hfx_f64(at + 32) : 0.0;
  const double scale = is_strength ? player->gain * factor : factor;
  if (scale == 1.0) return value;
  return hfx_clamped(neutral + scale * (value - neutral), hfx_f64(at + 16), hfx_f64(at + 24));
}

static inline void hfx_neutral(const hfx_clip *clip, float *out) {
  uint32_t i;
  for (i = 0; i < hfx_clip_columns(clip); i++)
    out[i] = (float)hfx_f64(hfx_record(clip, HFX_COLM, i) + 32);
}

/* Values of the strongest row of an actuator of one or two spans of rows, both ends included. */
static inline const unsigned char *hfx_strongest_values(const hfx_player *player, uint32_t actuator,
                                                        int64_t spans[2][2]) {
  const hfx_clip *clip = &player->clip;
  const unsigned char *at = hfx_record(clip, HFX_ACTR, actuator);
  const uint32_t columns = hfx_u32(at + 12), count = hfx_u32(at + 20);
  const unsigned char *rows = hfx_record(clip, HFX_ROWS, hfx_u32(at + 16));
  const unsigned char *values = hfx_record(clip, HFX_VALU, hfx_u32(at + 24)), *strongest = values;
  const uint32_t neutral = hfx_u32(hfx_record(clip, HFX_COLM, hfx_u32(at + 8)) + 12);
  uint32_t farthest = 0;
  int s;
  for (s = 0; s < 2; s++) {
    uint32_t entry, last;
    if (spans[s][0] > spans[s][1]) continue;
    entry = hfx_entry_at(rows, count, spans[s][0]);
    last = hfx_entry_at(rows, count, spans[s][1]);
    for (; entry <= last; entry++) {
      const unsigned char *value = values + 2 * (size_t)entry * columns;
      const uint32_t number = hfx_u16(value);
      const uint32_t away = number > neutral ? number - neutral : neutral - number;
      if (away >= farthest) farthest = away, strongest = value;
    }
  }
  return strongest;
}

static inline int hfx_is_placed(const hfx_player *player);
static inline void hfx_give_placed(const hfx_player *player, const unsigned char *device,
                                   uint32_t actuator, int64_t spans[2][2], float *out);

/* Strongest row of each actuator. */
static inline void hfx_strongest(const hfx_player *player, int64_t spans[2][2], float *out) {
  const hfx_clip *clip = &player->clip;
  const int is_placed = hfx_is_placed(player);
  uint32_t d, i, k;
  for (d = 0; d < hfx_clip_devices(clip); d++) {
    const unsigned char *device = hfx_record(clip, HFX_DEVC, d);
    const uint32_t end = hfx_u32(device + 12) + hfx_u32(device + 16);
    for (i = hfx_u32(device + 12); i < end; i++) {
      const unsigned char *at = hfx_record(clip, HFX_ACTR, i), *values;
      const uint32_t column = hfx_u32(at + 8), columns = hfx_u32(at + 12);
      if (is_placed) {
        hfx_give_placed(player, device, i, spans, out);
        continue;
      }
      values = hfx_strongest_values(player, i, spans);
      for (k = 0; k < columns; k++) {
        const unsigned char *of = hfx_record(clip, HFX_COLM, column + k);
        out[column + k] =
            (float)hfx_scaled(player, column + k, hfx_decoded(of, hfx_u16(values + 2 * k)), k == 0);
      }
    }
  }
}

/* Begins a part of the clip. */
static inline void hfx_begin(hfx_player *player, double start_s, double end_s, int loops) {
  player->position_s = player->start_s = start_s;
  player->end_s = end_s;
  player->is_playing = end_s > start_s;
  player->is_paused = 0;
  player->loops = loops;
  hfx_player_seek(player, start_s);
}

HFX_API void hfx_player_play(hfx_player *player, const hfx_clip *clip) {
  int k;
  if (clip != &player->clip) player->clip = *clip;
  player->gain = 1.0;
  for (k = 0; k < HFX_PARAMETERS; k++) player->factors[k] = 1.0;
  player->loops_whole = 0;
  hfx_player_place(player, 0.0, 0.0, 1.0);
  hfx_begin(player, 0.0, hfx_clip_seconds(clip), 0);
}

HFX_API int hfx_player_play_named(hfx_player *player, const hfx_clip *clip, const char *name) {
  hfx_player_play(player, clip);
  if (name && *name) return hfx_player_replay(player, name);
  hfx_begin(player, 0.0, 0.0, 0); /* silence */
  return HFX_ERROR_NAME;
}

HFX_API int hfx_player_replay(hfx_player *player, const char *name) {
  hfx_named_clip found;
  uint32_t i;
  if (!name || !*name) {
    hfx_begin(player, 0.0, hfx_clip_seconds(&player->clip), player->loops_whole);
    return 0;
  }
  for (i = 0; hfx_clip_named_clip(&player->clip, i, &found) == 0; i++) {
    if (!hfx_same(found.name, name)) continue;
    hfx_begin(player, found.start_s, found.end_s, found.loops);
    return 0;
  }
  hfx_begin(player, 0.0, 0.0, 0); /* silence */
  return HFX_ERROR_NAME;
}

HFX_API void hfx_player_advance(hfx_player *player, double seconds, float *out) {
  int64_t spans[2][2] = {{0, -1}, {0, -1}};
  int64_t now;
  if (!player->is_playing || player->is_paused) {
    hfx_neutral(&player->clip, out);
    return;
  }
  player->position_s += hfx_elapsed(seconds);
  now = hfx_row_of(player, player->position_s);
  spans[0][0] = player->shown_row + 1;
  spans[0][1] = now;
  if (player->position_s < player->end_s) {
    if (spans[0][0] > now) spans[0][0] = now;
  } else if (player->loops) {
    const double length_s = player->end_s - player->start_s;
    const double past_s = player->position_s - player->end_s;
    player->position_s = player->start_s + (past_s - length_s * floor(past_s / length_s));
    now = hfx_row_of(player, past_s < length_s ? player->position_s : player->end_s);
    spans[1][0] = hfx_row_of(player, player->start_s);
    spans[1][1] = now;
    now = hfx_row_of(player, player->position_s);
  } else {
    hfx_player_stop(player);
    player->position_s = player->end_s;
    if (spans[0][0] > now) { /* all of it has been felt */
      hfx_neutral(&player->clip, out);
      return;
    }
  }
  player->shown_row = now;
  hfx_strongest(player, spans, out);
}

HFX_API void hfx_player_pause(hfx_player *player, int is_paused) { player->is_paused = is_paused; }
HFX_API void hfx_player_loop(hfx_player *player, int loops) {
  player->loops = player->loops_whole = loops;
}
HFX_API void hfx_player_gain(hfx_player *player, double gain) { player->gain = hfx_positive(gain); }
HFX_API int hfx_player_is_playing(const hfx_player *player) { return player->is_playing; }
HFX_API double hfx_player_position(const hfx_player *player) { return player->position_s; }

HFX_API void hfx_player_stop(hfx_player *player) {
  player->is_playing = 0;
  hfx_player_seek(player, player->start_s);
}

HFX_API void hfx_player_seek(hfx_player *player, double seconds) {
  if (!player->clip.row_count) return;
  player->position_s = hfx_clamped(hfx_positive(seconds), player->start_s, player->end_s);
  player->shown_row = hfx_row_of(player, player->position_s) - 1;
}

HFX_API int hfx_player_set_parameter(hfx_player *player, const char *parameter, double factor) {
  const int known = parameter ? hfx_parameter(parameter[0]) : HFX_PARAMETERS;
  uint32_t i;
  for (i = 0; i < hfx_clip_columns(&player->clip); i++) {
    const unsigned char *at = hfx_record(&player->clip, HFX_COLM, i);
    if (known == HFX_PARAMETERS || !hfx_same(hfx_text(&player->clip, at), parameter)) continue;
    player->factors[known] = hfx_positive(factor);
    return 0;
  }
  return HFX_ERROR_NAME;
}

HFX_API void hfx_player_silence(hfx_player *player, float *out) {
  hfx_player_pause(player, 1);
  hfx_neutral(&player->clip, out);
}

#ifdef __cplusplus
}
#endif

#endif
