/* SPDX-License-Identifier: MIT
 *
 * Plays haptic clips (.hfxclip) in games: C99 and C++17, one include, no allocation, and of the
 * C library only math.h (sqrt, floor, ceil, fabs, exp, log, pow, sin,
 * sqrtf, fabsf).
 *
 *   hfx_clip clip;                    // may move or end once a player or a body has it
 *   hfx_player player;
 *   float out[64];                    // hfx_clip_columns(&clip) values
 *   const int error = hfx_clip_open(&clip, bytes, size);   // 0, or see hfx_error_text(error)
 *                                     // the bytes have to stay where they are, unchanged
 *   hfx_player_play(&player, &clip);                       // after an error: of nothing
 *   hfx_player_advance(&player, seconds_since_last_frame, out);   // each frame
 *
 * Numbers that may come from a script (seconds, gain, level, ...) may be anything: what is not a
 * number or below 0 counts as 0. All functions may be given results of a failed call. A player or
 * a body of zeros feels nothing; one that was set to nothing at all must not be used.
 *
 * Threads: the core has no state of its own. Any number of threads may read one clip and its bytes;
 * a player or a body is used by one thread at a time.
 */
#ifndef HFX_PLAYER_H
#define HFX_PLAYER_H

#include <math.h>
#include <stddef.h>
#include <stdint.h>

#define HFX_PLAYER_VERSION_MAJOR 0
#define HFX_PLAYER_VERSION_MINOR 1
#define HFX_PLAYER_VERSION_PATCH 0

#ifndef HFX_API /* a library that exports them defines it before it includes this file */
#define HFX_API static inline
#endif

#ifdef __cplusplus
extern "C" {
#endif

/* ---- Reading a clip ------------------------------------------------------------------------ */

#define HFX_VERSION 1u /* of the format: newer clips are refused */
#define HFX_NONE 0xFFFFFFFFu
#define HFX_PARAMETERS 5

enum hfx_error {
  HFX_ERROR_SIZE = -1,     /* it is cut off, or longer than it says */
  HFX_ERROR_KIND = -2,     /* it is no clip */
  HFX_ERROR_VERSION = -3,  /* it is of a newer version */
  HFX_ERROR_CHECKSUM = -4, /* it is damaged */
  HFX_ERROR_CONTENT = -5,  /* a record breaks a rule of the format */
  HFX_ERROR_INDEX = -6,    /* there is no such device, actuator, effect, ... */
  HFX_ERROR_NAME = -7,     /* there is nothing of this name */
  HFX_ERROR_MEMORY = -8    /* less memory was given than hfx_body_bytes says */
};

enum hfx_modality { HFX_VIBRATION, HFX_PRESSURE, HFX_TEMPERATURE, HFX_WIND };

enum hfx_section {
  HFX_TEXT, HFX_TIME, HFX_DEVC, HFX_ACTR, HFX_COLM, HFX_ROWS, HFX_VALU, HFX_CLIP, HFX_BODY,
  HFX_BONE, HFX_MODL, HFX_VERT, HFX_WGHT, HFX_EFCT, HFX_FLTR, HFX_PNTD, HFX_REAC, HFX_RCHV,
  HFX_SURF, HFX_HMAP, HFX_TEXL, HFX_SECTIONS
};

typedef struct hfx_part { /* the records of one section */
  const unsigned char *at;
  uint32_t count;
} hfx_part;

typedef struct hfx_clip {
  hfx_part parts[HFX_SECTIONS];
  double rate_hz;
  uint32_t row_count;
} hfx_clip;

/* Texts are UTF-8 and lie in the clip. */
typedef struct hfx_device {
  const char *id, *name, *body;
  uint32_t first_actuator, actuators, first_column, columns;
  uint32_t dead_man_ms; /* without a value for so long, the output falls silent by itself */
} hfx_device;

typedef struct hfx_actuator {
  const char *id, *parts, *bone, *human_bone;
  uint32_t modality, first_column, columns, place, side;
  float centre_m[3], radius_m;
  float latency_ms; /* applied already */
  float update_interval_ms, slew_per_s, maximum_on_s, rest_s;
} hfx_actuator;

typedef struct hfx_column {
  const char *parameter, *unit;
  uint32_t actuator;
  double lowest, highest, neutral;
} hfx_column;

typedef struct hfx_named_clip {
  const char *name;
  double start_s, end_s;
  int loops;
} hfx_named_clip;

typedef struct hfx_bone {
  const char *name, *human, *mixamo, *unreal; /* VRM 1.0, Mixamo, Unreal; may be empty */
  uint32_t parent;                            /* HFX_NONE: it has none */
  float length_m, rest[12];
} hfx_bone;

typedef struct hfx_effect {
  const char *name;
  int is_painted;
  uint32_t modality, body, shape;
  float half_segment, level, parameters[4], matrix[12];
} hfx_effect;

typedef struct hfx_surface { /* a haptic surface with its map */
  const char *name;
  float lowest_m_s2, highest_m_s2; /* peak amplitude at intensity just above 0, and at 1 */
  float lowest_hz, highest_hz;     /* at sharpness 0 and 1 */
  uint32_t columns, rows;
  float width_mm, height_mm; /* of the map: u, v = 0 to 1 */
  float uv_width_mm, uv_height_mm; /* of 1 in the object's texture coordinates; 0: it has none */
  int tiles;                 /* 1: the map repeats beyond 0 to 1; 0: its border continues */
} hfx_surface;

/* Opens a clip that lies in memory; 0, or an hfx_error. Looks at all of it once. */
HFX_API int hfx_clip_open(hfx_clip *clip, const void *bytes, size_t size);
/* One sentence about an error, in English. */
HFX_API const char *hfx_error_text(int error);
HFX_API double hfx_clip_seconds(const hfx_clip *clip);
/* Numbers of each. */
HFX_API uint32_t hfx_clip_devices(const hfx_clip *clip);
HFX_API uint32_t hfx_clip_actuators(const hfx_clip *clip);
HFX_API uint32_t hfx_clip_columns(const hfx_clip *clip);
HFX_API uint32_t hfx_clip_named_clips(const hfx_clip *clip);
HFX_API uint32_t hfx_clip_bodies(const hfx_clip *clip);
HFX_API uint32_t hfx_clip_bones(const hfx_clip *clip, uint32_t body);
HFX_API uint32_t hfx_clip_effects(const hfx_clip *clip);
HFX_API uint32_t hfx_clip_surfaces(const hfx_clip *clip);
/* Facts about one; 0 or HFX_ERROR_INDEX. */
HFX_API int hfx_clip_device(const hfx_clip *clip, uint32_t index, hfx_device *found);
/* Tells whether a device is one of a name: "" is any, "glove" is glove, glove_left, glove_right. */
HFX_API int hfx_clip_is_device(const hfx_clip *clip, uint32_t index, const char *name);
HFX_API int hfx_clip_actuator(const hfx_clip *clip, uint32_t index, hfx_actuator *found);
HFX_API int hfx_clip_column(const hfx_clip *clip, uint32_t index, hfx_column *found);
HFX_API int hfx_clip_named_clip(const hfx_clip *clip, uint32_t index, hfx_named_clip *found);
HFX_API int hfx_clip_bone(const hfx_clip *clip, uint32_t body, uint32_t index, hfx_bone *found);
HFX_API int hfx_clip_effect(const hfx_clip *clip, uint32_t index, hfx_effect *found);
HFX_API int hfx_clip_surface(const hfx_clip *clip, uint32_t index, hfx_surface *found);

/* ---- Playing the baked part ---------------------------------------------------------------- */

typedef struct hfx_player {
  hfx_clip clip; /* a copy: only the bytes have to stay */
  double position_s, start_s, end_s, gain, factors[HFX_PARAMETERS];
  double turn_degrees, raise_m, stretch; /* of hfx_player_place */
  int64_t shown_row; /* last row that was given; -1: none */
  int is_playing, is_paused, loops; /* loops: what plays now */
  int loops_whole;                  /* of hfx_player_loop: applies to the whole clip */
} hfx_player;

/* Sets a player up, with gain and factors of 1, no loop, not placed elsewhere, and begins at the
 * beginning. */
HFX_API void hfx_player_play(hfx_player *player, const hfx_clip *clip);
/* The same with a named clip, which loops if it is meant to; 0, or HFX_ERROR_NAME and silence. */
HFX_API int hfx_player_play_named(hfx_player *player, const hfx_clip *clip, const char *name);
/* Begins again with the whole clip (NULL or ""), which loops as hfx_player_loop said, or with a
 * named clip, which loops if it is meant to. Gain, factors, loop and place stay, a pause ends; 0,
 * or HFX_ERROR_NAME and silence. The player has to be set up. */
HFX_API int hfx_player_replay(hfx_player *player, const char *name);
/* Goes on by the seconds since the last call. `out` gets hfx_clip_columns values in the units of
 * the columns: of each actuator the strongest of all rows since then. */
HFX_API void hfx_player_advance(hfx_player *player, double seconds, float *out);
/* While it is paused, advance gives neutral values and stands still; 0 goes on. */
HFX_API void hfx_player_pause(hfx_player *player, int is_paused);
/* Ends in silence, at the beginning of what was played. Where a clip ends by itself, the position
 * stays at its end. */
HFX_API void hfx_player_stop(hfx_player *player);
/* Jumps, seconds from the beginning of the clip; what lies between is not felt. */
HFX_API void hfx_player_seek(hfx_player *player, double seconds);
/* Sets whether the whole clip, and what plays now, begins again at its end. */
HFX_API void hfx_player_loop(hfx_player *player, int loops);
/* Scales how far all strengths are from neutral; 1 as made. The column's limits hold. */
HFX_API void hfx_player_gain(hfx_player *player, double gain);
/* Scales one parameter (`amplitude_m_s2`, `frequency_hz`, `pressure_kpa`, `temperature_c`,
 * `speed_m_s`): its deviation from neutral, a frequency itself; 0 or HFX_ERROR_NAME. */
HFX_API int hfx_player_set_parameter(hfx_player *player, const char *parameter, double factor);
/* Plays everything turned about the body's vertical axis (to the left, seen from above
 * counterclockwise), higher by metres, and with heights about the middle of each device times
 * `stretch`; 0, 0, 1 as made. Between actuators, strengths are interpolated. Devices that do not go
 * round the body, and are not on both sides of it, are not turned; what is in the room stays. What
 * is no number counts as made. */
HFX_API void hfx_player_place(hfx_player *player, double turn_degrees, double raise_m,
                              double stretch);
/* Neutral values at once, and pause: for a lost focus, a menu, a headset taken off. */
HFX_API void hfx_player_silence(hfx_player *player, float *out);
HFX_API int hfx_player_is_playing(const hfx_player *player); /* also while it is paused */
HFX_API double hfx_player_position(const hfx_player *player);

/* ---- Exploring a haptic surface ------------------------------------------------------------- */

typedef struct hfx_stroke { /* of one finger or pointer; begins as zeros */
  double u, v; /* place of the last call */
  uint32_t surface;
  int is_touching;
} hfx_stroke;

/* Vibration of a finger that has moved to (u, v) since the last call, `seconds` ago: out[0] peak
 * amplitude in m/s^2, out[1] frequency in Hz, of the strongest texel on the path. u and v are
 * shares of the map's width and height from its lower left corner, beyond 0 to 1 too: texture
 * coordinates of the object, V upwards, times uv_width_mm / width_mm and the same of the heights.
 * `speed_mm_s` is the speed relative to the material; below 0: that of the path. At most 0.1 mm/s
 * is rest, with amplitude 0, and so is the first call of a touch. Where u or v is no number, or
 * beyond +-1,000,000, nothing is touched. 0, or HFX_ERROR_INDEX and silence. */
HFX_API int hfx_surface_feel(const hfx_clip *clip, uint32_t surface, hfx_stroke *stroke, double u,
                             double v, double speed_mm_s, double seconds, float *out);
/* Ends the touch: the next call begins a new one. */
HFX_API void hfx_surface_lift(hfx_stroke *stroke);

/* ---- Evaluating the spatial part on a live avatar ------------------------------------------- */

/* Space is the clip's: metres, right-handed, Z up; docs/formats/clip.md says how engines differ.
 * Matrices are 3 x 4, row after row. */

#define HFX_IMPACTS 4 /* that ring at once, of an effect */

typedef struct hfx_impact {
  double time_s, strength, attack_s, decay_s, peaks_s, ends_s;
  uint32_t filter, place; /* place: of what it holds */
} hfx_impact;

typedef struct hfx_tone { /* a vibration in a sum */
  float strength, hertz;
  struct hfx_tone *next; /* of the same or a higher frequency */
} hfx_tone;

typedef struct hfx_felt { /* a volume or a painted area on a body */
  double level, response, speeds[16]; /* level: the factor times the level in the clip */
  const unsigned char *effect;
  struct hfx_felt *next;        /* in the order of `number` */
  struct hfx_felt *next_acting; /* of those of one modality with a response */
  float *weights, *held;        /* of the model's vertices; what impacts hold */
  float *peaks, *held_peaks;    /* at least the largest of each chunk; at 0, held may be anything */
  hfx_tone tone;
  float matrix[12], parameters[4];
  float to_shape[12], to_shape_before[12]; /* inverse matrices; before: in the last evaluation */
  uint32_t number;             /* of the effect, or of hfx_body_add_volume */
  uint32_t model, first_chunk; /* HFX_NONE: not felt by this body */
  uint32_t from, to;           /* chunks outside of these have no weight */
  uint32_t held_from, held_to; /* chunks outside of these have no held weight */
  uint64_t chunk_bits;         /* of chunks with weights: bit `chunk % 64`, and maybe others */
  int is_flat, was_flat;       /* the matrix has no inverse */
  int was_on, was_touched, impact_count;
  hfx_impact impacts[HFX_IMPACTS];
} hfx_felt;

#define HFX_CHUNK 32 /* neighbouring vertices of a model that share a box */
#define HFX_LANES 4  /* neighbouring vertices that are computed together */

typedef struct hfx_chunk { /* places of its vertices, the last of a model repeated to fill it */
  float x[HFX_CHUNK], y[HFX_CHUNK], z[HFX_CHUNK];
  uint32_t frame, unused[3]; /* frame: in which it was posed */
} hfx_chunk;

typedef struct hfx_pull { /* of a bone on HFX_LANES vertices */
  float shares[HFX_LANES];
  uint32_t bone;
} hfx_pull;

typedef struct hfx_rest { /* a chunk in rest space */
  float x[HFX_CHUNK], y[HFX_CHUNK], z[HFX_CHUNK];
  uint32_t first[HFX_CHUNK / HFX_LANES + 1]; /* pull of each HFX_LANES vertices; where they end */
  uint32_t first_bone, end_bone, unused;     /* of hfx_body.chunk_bones */
} hfx_rest;

typedef struct hfx_lanes { /* a 3 x 4 matrix, each number once for each lane */
  float at[12][HFX_LANES];
} hfx_lanes;

typedef struct hfx_boxes { /* of as many chunks */
  hfx_chunk centre, half; /* where vertices may have moved to since they were posed */
  float low[4], high[4];  /* corners of a box round all in this frame */
} hfx_boxes;

typedef struct hfx_bone_pose {
  float now[16], before[16]; /* matrices: 4 columns of 3 numbers and a 0 */
  float low[4], high[4];     /* box in rest space round the vertices that follow the bone */
  float least[4], most[4];   /* motion of these along each axis since the frame before, metres */
} hfx_bone_pose;

typedef struct hfx_near { /* a chunk within reach of a volume */
  float away_m[HFX_CHUNK], least_m; /* distances of its vertices, for proximity alone */
  uint32_t chunk, unused[2];
} hfx_near;

typedef struct hfx_reach { /* factors of an actuator for the vertices of a chunk */
  float factors[HFX_CHUNK], most; /* most: the largest */
  uint32_t chunk, unused[2];
} hfx_reach;

typedef struct hfx_reaction {
  hfx_tone tone;
  uint32_t first, end; /* reaches */
  uint64_t chunk_bits; /* of all of their chunks, as in hfx_felt */
} hfx_reaction;

typedef struct hfx_body { /* what is behind these pointers lies in the memory that was given */
  hfx_clip clip;           /* of the body and its devices */
  const hfx_clip *effects; /* of what is felt, often the same; a copy */
  uint32_t body, frame, chunks, next_number;
  int is_posed, was_posed;
  double time_s;
  hfx_felt *felt, *last, *recent; /* of each effect; the newest added volume; the last one found */
  hfx_felt *acting[HFX_WIND + 1]; /* the first of each modality with a response */
  hfx_reaction *reactions;
  hfx_reach *reaches;
  hfx_bone_pose *bones;
  hfx_lanes *pose, *pose_before; /* of each bone, and one that leaves vertices where they are */
  hfx_rest *rest;
  hfx_pull *pulls;
  uint32_t *chunk_bones; /* that move any vertex of a chunk */
  hfx_chunk *places, *before;
  hfx_boxes *boxes;
  hfx_near *near;                /* of one model, as the following */
  float *scratch, *scratch_peaks; /* weights, and the largest of each chunk; 0 between effects */
} hfx_body;

/* Memory that a body needs, aligned as malloc's; 0: there is no such body. */
HFX_API size_t hfx_body_bytes(const hfx_clip *clip, uint32_t body);
/* Begins with volumes where and as strong as in the clip, painted areas off; 0 or an hfx_error. */
HFX_API int hfx_body_open(hfx_body *self, const hfx_clip *clip, uint32_t body, void *memory,
                          size_t size);
/* A library of effects (hits, rain, a heartbeat) is felt on the body of another clip: with bones,
 * vertices and devices of `clip`, and volumes and painted areas of `effects`, whose bodies,
 * devices and baked part do not count. Painted areas go by model and by number of the vertex,
 * which all bodies share. The same memory and errors as above; all other functions of a body take
 * effects of `effects`. */
HFX_API size_t hfx_body_effects_bytes(const hfx_clip *clip, uint32_t body, const hfx_clip *effects);
HFX_API int hfx_body_open_effects(hfx_body *self, const hfx_clip *clip, uint32_t body,
                                  const hfx_clip *effects, void *memory, size_t size);
/* Poses the body: for each bone the matrix that takes rest space to the world. Each frame, before
 * evaluate: speeds of skin are measured from one pose to the next. */
HFX_API void hfx_body_set_bones(hfx_body *self, const float *matrices);
/* Places a volume: shape space to world; 0 or HFX_ERROR_INDEX. */
HFX_API int hfx_body_set_volume(hfx_body *self, uint32_t effect, const float *matrix);
/* Changes a parameter of an effect (0: its strength), in its unit; 0 or HFX_ERROR_INDEX. */
HFX_API int hfx_body_set_parameter(hfx_body *self, uint32_t effect, uint32_t parameter,
                                   double value);
/* Turns an effect on at a factor of 0 (off) to 1 of its level in the clip, hfx_effect.level;
 * 0 or HFX_ERROR_INDEX. */
HFX_API int hfx_body_trigger(hfx_body *self, uint32_t effect, double factor);

/* Turns a painted area about the body's axis (to the left, seen from above counterclockwise), and
 * puts it higher by metres, with heights about its own middle times `stretch`: each vertex has the
 * weight of the vertex that is nearest to where it comes from, at rest. 0, 0, 1 as made. Takes as
 * long as some frames: for the beginning of an effect. Volumes are placed by their matrix.
 * 0, or HFX_ERROR_INDEX: there is no such painted area. */
HFX_API int hfx_body_place(hfx_body *self, uint32_t effect, double turn_degrees, double raise_m,
                           double stretch);

/* A volume effect can be in several places at once (rain, bullets): each further volume has a
 * matrix, factor, parameters and contact response of its own, and is felt in addition. */

/* Memory that one further volume needs, aligned as malloc's; 0: there is no such volume effect. */
HFX_API size_t hfx_body_volume_bytes(const hfx_clip *clip, uint32_t body, uint32_t effect);
/* The same for a body with effects of another clip. */
HFX_API size_t hfx_body_effects_volume_bytes(const hfx_clip *clip, uint32_t body,
                                             const hfx_clip *effects, uint32_t effect);
/* Adds a volume, off, with matrix and parameters as in the clip. Returns its number, which the
 * functions above and below take in place of an effect; HFX_NONE: there is no such volume effect,
 * too little memory, or memory of an added volume. The memory stays in use until the volume is removed. */
HFX_API uint32_t hfx_body_add_volume(hfx_body *self, uint32_t effect, void *memory, size_t size);
/* Removes an added volume. Returns the memory that it had; NULL: no added volume has the number. */
HFX_API void *hfx_body_remove_volume(hfx_body *self, uint32_t number);

/* Evaluates the body now. `out` gets hfx_clip_columns values, as of hfx_player_advance: those of
 * the devices that this body wears, neutral ones for the others. */
HFX_API void hfx_body_evaluate(hfx_body *self, double seconds, float *out);
/* Weights 0 to 1 of the last evaluation at the vertices of the effect's model on this body. */
HFX_API const float *hfx_body_weights(const hfx_body *self, uint32_t effect, uint32_t *count);
/* Level of the last evaluation: factor, level in the clip and response to the touch, multiplied. */
HFX_API double hfx_body_level(const hfx_body *self, uint32_t effect);

#ifdef __cplusplus
}
#endif

#include "hfx_clip.h"
#include "hfx_facts.h"
#include "hfx_play.h"
#include "hfx_placed.h"
#include "hfx_surface.h"
#include "hfx_volume.h"
#include "hfx_skin.h"
#include "hfx_touch.h"
#include "hfx_filters.h"
#include "hfx_impact.h"
#include "hfx_response.h"
#include "hfx_paint.h"
#include "hfx_memory.h"
#include "hfx_body.h"

#endif
