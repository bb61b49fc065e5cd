/* SPDX-License-Identifier: MIT
 *
 * Playing of the baked part turned about the body, higher or lower: docs/formats/clip.md, "Turned
 * and raised". Included by hfx_player.h. */
#ifndef HFX_PLACED_H
#define HFX_PLACED_H

#ifdef __cplusplus
extern "C" {
#endif

#define HFX_TAU 6.283185307179586
#define HFX_DEGREES (360.0 / HFX_TAU)
#define HFX_AXIS_Y_M (-0.045) /* the vertical axis of the canonical body; x is 0 */
#define HFX_LEVEL_M 0.01      /* height of a level */

typedef struct hfx_level { /* actuators of one modality of a device, about as high as each other */
  double low_m, high_m, left[2], right[2]; /* heights; corners of a box: x, y */
  int sides;                               /* bits: 1 any, 2 left, 4 right */
} hfx_level;

typedef struct hfx_share { /* part that an actuator takes of another's values */
  uint32_t actuator;
  double weight;
} hfx_share;

static inline int hfx_is_placed(const hfx_player *player) {
  return player->turn_degrees != 0.0 || player->raise_m != 0.0 ||
         (player->stretch > 0.0 && player->stretch != 1.0);
}

/* Degrees from 0 to below 360. */
static inline double hfx_wrapped(double degrees) {
  const double within = degrees - 360.0 * floor(degrees / 360.0);
  return within < 360.0 ? within : 0.0;
}

/* Angle of a direction, degrees, as of atan2, which not each platform's library has to have. */
static inline double hfx_angle(double y, double x) {
  const double size = fabs(x) + fabs(y);
  double angle = size > 0.0 ? 0.25 * HFX_TAU * (1.0 - x / size) : 0.0; /* within 5 degrees */
  int k;
  if (y < 0.0) angle = -angle;
  for (k = 0; k < 2 && size > 0.0; k++) { /* Newton's method; its error is cubed each time */
    const double sine = sin(angle), cosine = sin(angle + 0.25 * HFX_TAU);
    angle -= (sine * x - cosine * y) / (cosine * x + sine * y);
  }
  return angle * HFX_DEGREES;
}

/* Place of an actuator on the canonical body, metres; 0: it is in the room or of another
 * modality. */
static inline int hfx_centre(const hfx_clip *clip, uint32_t actuator, uint32_t modality,
                             double centre_m[3]) {
  const unsigned char *at = hfx_record(clip, HFX_ACTR, actuator);
  int c;
  for (c = 0; c < 3; c++) centre_m[c] = hfx_f32(at + 48 + 4 * c);
  return hfx_u32(at + 28) != 2 && hfx_u32(at + 4) == modality;
}

/* Finds the lowest level above a height; 0: there is none. */
static inline int hfx_level_above(const hfx_clip *clip, const unsigned char *device,
                                  uint32_t modality, double above_m, hfx_level *level) {
  const uint32_t first = hfx_u32(device + 12), end = first + hfx_u32(device + 16);
  double centre_m[3];
  uint32_t k;
  int c;
  level->low_m = HFX_HUGE_F64;
  for (k = first; k < end; k++)
    if (hfx_centre(clip, k, modality, centre_m) && centre_m[2] > above_m &&
        centre_m[2] < level->low_m)
      level->low_m = centre_m[2];
  if (level->low_m == HFX_HUGE_F64) return 0;
  level->high_m = level->low_m;
  level->sides = 0;
  for (k = first; k < end; k++) {
    if (!hfx_centre(clip, k, modality, centre_m) || centre_m[2] < level->low_m ||
        centre_m[2] > level->low_m + HFX_LEVEL_M)
      continue;
    if (centre_m[2] > level->high_m) level->high_m = centre_m[2];
    for (c = 0; c < 2; c++) {
      if (!level->sides || centre_m[c] < level->left[c]) level->left[c] = centre_m[c];
      if (!level->sides || centre_m[c] > level->right[c]) level->right[c] = centre_m[c];
    }
    level->sides |= 1 << hfx_u32(hfx_record(clip, HFX_ACTR, k) + 32);
  }
  return 1;
}

static inline double hfx_height(const hfx_level *level) {
  return 0.5 * (level->low_m + level->high_m);
}

/* Test that a level goes round the body: the body's axis is in its box, or it is on both sides. */
static inline int hfx_is_round(const hfx_level *level) {
  return level->sides == 6 || (level->left[0] <= 0.0 && level->right[0] >= 0.0 &&
                               level->left[1] <= HFX_AXIS_Y_M && level->right[1] >= HFX_AXIS_Y_M);
}

/* Adds the one or two neighbours of a place on a level, by angle where it goes round, else by x. */
static inline uint32_t hfx_add_neighbours(const hfx_clip *clip, const unsigned char *device,
                                          uint32_t modality, const hfx_level *level,
                                          const double place_m[3], double turn_degrees,
                                          double weight, hfx_share *shares) {
  const uint32_t first = hfx_u32(device + 12), end = first + hfx_u32(device + 16);
  const int is_round = hfx_is_round(level);
  const double x = 0.5 * (level->left[0] + level->right[0]);
  const double y = 0.5 * (level->left[1] + level->right[1]);
  const double at = is_round ? hfx_angle(place_m[1] - y, place_m[0] - x) - turn_degrees
                             : place_m[0];
  double before = HFX_HUGE_F64, after = HFX_HUGE_F64, centre_m[3];
  uint32_t k, previous = HFX_NONE, next = HFX_NONE;
  for (k = first; k < end; k++) {
    double back, ahead;
    if (!hfx_centre(clip, k, modality, centre_m) || centre_m[2] < level->low_m ||
        centre_m[2] > level->high_m)
      continue;
    if (is_round) {
      const double angle = hfx_angle(centre_m[1] - y, centre_m[0] - x);
      back = hfx_wrapped(at - angle);
      ahead = hfx_wrapped(angle - at);
    } else {
      back = at - centre_m[0];
      ahead = -back;
    }
    if (back >= 0.0 && back < before) before = back, previous = k;
    if (ahead >= 0.0 && ahead < after) after = ahead, next = k;
  }
  if (previous == HFX_NONE) previous = next, before = 0.0;
  if (next == HFX_NONE) next = previous, after = 0.0;
  shares[0].actuator = previous;
  shares[0].weight = previous == next || before <= 0.0 ? weight : weight * after / (before + after);
  shares[1].actuator = next;
  shares[1].weight = weight - shares[0].weight;
  return shares[1].weight > 0.0 ? 2 : 1;
}

/* Height whose values an actuator takes. A device of one level is neither raised nor stretched. */
static inline double hfx_wanted_height(const hfx_player *player, const unsigned char *device,
                                       uint32_t modality, const double place_m[3]) {
  const double stretch = player->stretch > 0.0 ? player->stretch : 1.0;
  double lowest_m = 0.0, highest_m = 0.0, own_m = 0.0;
  hfx_level level;
  int count = 0;
  level.high_m = -HFX_HUGE_F64;
  for (; hfx_level_above(&player->clip, device, modality, level.high_m, &level); count++) {
    highest_m = hfx_height(&level);
    if (!count) lowest_m = highest_m;
    if (place_m[2] >= level.low_m && place_m[2] <= level.high_m) own_m = highest_m;
  }
  if (count < 2) return own_m;
  return 0.5 * (lowest_m + highest_m) +
         (own_m - 0.5 * (lowest_m + highest_m) - player->raise_m) / stretch;
}

/* Actuators whose values an actuator of a device takes, up to four, and their weights. Beyond the
 * lowest and the highest level, values fall to neutral over the distance to the next level. */
static inline uint32_t hfx_find_shares(const hfx_player *player, const unsigned char *device,
                                       uint32_t actuator, hfx_share shares[4]) {
  const hfx_clip *clip = &player->clip;
  const uint32_t modality = hfx_u32(hfx_record(clip, HFX_ACTR, actuator) + 4);
  double place_m[3], wanted_m, below_m = -HFX_HUGE_F64;
  uint32_t count = 0;
  hfx_level level, above;
  int is_level, is_above;
  shares[0].actuator = actuator;
  shares[0].weight = 1.0;
  if (!hfx_centre(clip, actuator, modality, place_m)) return 1;
  wanted_m = hfx_wanted_height(player, device, modality, place_m);
  is_level = hfx_level_above(clip, device, modality, -HFX_HUGE_F64, &level);
  for (; is_level && count < 3; is_level = is_above, level = above) {
    const double height_m = hfx_height(&level), away_m = wanted_m - height_m;
    const int is_own = place_m[2] >= level.low_m && place_m[2] <= level.high_m;
    const double gap_below_m = height_m - below_m;
    double weight, gap_m;
    is_above = hfx_level_above(clip, device, modality, level.high_m, &above);
    gap_m = is_above ? hfx_height(&above) - height_m : gap_below_m;
    if (away_m < 0.0 && below_m > -HFX_HUGE_F64) gap_m = gap_below_m;
    weight = 1.0 - fabs(away_m) / gap_m;
    below_m = height_m;
    if (!(weight > 0.0)) continue;
    if (is_own && (!hfx_is_round(&level) || player->turn_degrees == 0.0)) {
      shares[count].actuator = actuator;
      shares[count++].weight = weight;
    } else {
      count += hfx_add_neighbours(clip, device, modality, &level, place_m, player->turn_degrees,
                                  weight, shares + count);
    }
  }
  return count;
}

/* Values of an actuator of a device where the clip is turned, raised or stretched. */
static inline void hfx_give_placed(const hfx_player *player, const unsigned char *device,
                                   uint32_t actuator, int64_t spans[2][2], float *out) {
  const hfx_clip *clip = &player->clip;
  const unsigned char *at = hfx_record(clip, HFX_ACTR, actuator), *main = NULL;
  const uint32_t column = hfx_u32(at + 8), columns = hfx_u32(at + 12);
  const unsigned char *own = hfx_record(clip, HFX_COLM, column);
  uint32_t main_column = 0, main_columns = 0, i, k;
  double sum = 0.0, most = -1.0;
  hfx_share shares[4];
  const uint32_t count = hfx_find_shares(player, device, actuator, shares);
  for (i = 0; i < count; i++) {
    const unsigned char *from = hfx_record(clip, HFX_ACTR, shares[i].actuator);
    const unsigned char *strength = hfx_record(clip, HFX_COLM, hfx_u32(from + 8));
    const unsigned char *values = hfx_strongest_values(player, shares[i].actuator, spans);
    const double away = hfx_decoded(strength, hfx_u16(values)) - hfx_f64(strength + 32);
    sum += shares[i].weight * away;
    if (!(shares[i].weight * fabs(away) > most)) continue;
    most = shares[i].weight * fabs(away);
    main = values;
    main_column = hfx_u32(from + 8);
    main_columns = hfx_u32(from + 12);
  }
  for (k = 0; k < columns; k++) {
    const unsigned char *limits = hfx_record(clip, HFX_COLM, column + k);
    double value = k ? hfx_f64(limits + 32) : hfx_f64(own + 32) + sum;
    if (k && main && k < main_columns)
      value = hfx_decoded(hfx_record(clip, HFX_COLM, main_column + k), hfx_u16(main + 2 * k));
    value = hfx_scaled(player, column + k, value, k == 0);
    out[column + k] = (float)hfx_clamped(value, hfx_f64(limits + 16), hfx_f64(limits + 24));
  }
}

HFX_API void hfx_player_place(hfx_player *player, double turn_degrees, double raise_m,
                              double stretch) {
  const int is_angle = hfx_is_within(turn_degrees, -1e9, 1e9);
  player->turn_degrees = is_angle ? hfx_wrapped(turn_degrees) : 0.0;
  player->raise_m = hfx_is_within(raise_m, -1e9, 1e9) ? raise_m : 0.0;
  player->stretch = hfx_is_within(stretch, 1e-9, 1e9) ? stretch : 1.0;
}

#ifdef __cplusplus
}
#endif

#endif
