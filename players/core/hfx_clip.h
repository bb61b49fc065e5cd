/* SPDX-License-Identifier: MIT
 *
 * Reading of a clip: each rule of docs/formats/clip.md is checked once, when it is opened; what
 * comes later only reads what lies within the sections. Included by hfx_player.h. */
#ifndef HFX_CLIP_H
#define HFX_CLIP_H

#ifdef __cplusplus
extern "C" {
#endif

static inline uint32_t hfx_u16(const unsigned char *at) { return at[0] | (uint32_t)at[1] << 8; }

static inline uint32_t hfx_u32(const unsigned char *at) {
  return hfx_u16(at) | hfx_u16(at + 2) << 16;
}

static inline float hfx_f32(const unsigned char *at) {
  const uint32_t bits = hfx_u32(at);
  const unsigned char *from = (const unsigned char *)&bits;
  float value;
  unsigned char *to = (unsigned char *)&value;
  to[0] = from[0], to[1] = from[1], to[2] = from[2], to[3] = from[3]; /* compiled to one move */
  return value;
}

static inline double hfx_f64(const unsigned char *at) {
  const uint64_t bits = hfx_u32(at) | (uint64_t)hfx_u32(at + 4) << 32;
  double value;
  int i;
  for (i = 0; i < 8; i++) ((unsigned char *)&value)[i] = ((const unsigned char *)&bits)[i];
  return value;
}

static inline void hfx_copy(void *to, const void *from, size_t size) {
  size_t i;
  for (i = 0; i < size; i++) ((unsigned char *)to)[i] = ((const unsigned char *)from)[i];
}

static inline uint32_t hfx_crc32(const unsigned char *at, size_t size) {
  static const uint32_t of_nibble[16] = {
      0x00000000u, 0x1DB71064u, 0x3B6E20C8u, 0x26D930ACu, 0x76DC4190u, 0x6B6B51F4u,
      0x4DB26158u, 0x5005713Cu, 0xEDB88320u, 0xF00F9344u, 0xD6D6A3E8u, 0xCB61B38Cu,
      0x9B64C2B0u, 0x86D3D2D4u, 0xA00AE278u, 0xBDBDF21Cu};
  uint32_t crc = 0xFFFFFFFFu;
  for (; size; size--) {
    crc ^= *at++;
    crc = of_nibble[crc & 15u] ^ crc >> 4;
    crc = of_nibble[crc & 15u] ^ crc >> 4;
  }
  return ~crc;
}

static inline int hfx_same(const char *one, const char *other) {
  for (; *one && *one == *other; one++) other++;
  return *one == *other;
}

static inline int hfx_is_within(double value, double lowest, double highest) {
  return value >= lowest && value <= highest; /* false for NaN */
}

#define HFX_HUGE_F32 3.402823466e38
#define HFX_HUGE_F64 1.7976931348623157e308

/* A section: its name, and the bytes of a record. */
static const struct {
  char name[5];
  uint32_t bytes;
} hfx_sections[HFX_SECTIONS] = {
    {"TEXT", 1},  {"TIME", 24}, {"DEVC", 32}, {"ACTR", 88}, {"COLM", 40},  {"ROWS", 4},
    {"VALU", 2},  {"CLIP", 24}, {"BODY", 24}, {"BONE", 72}, {"MODL", 24},  {"VERT", 24},
    {"WGHT", 4},  {"EFCT", 128}, {"FLTR", 32}, {"PNTD", 8},  {"REAC", 32}, {"RCHV", 8},
    {"SURF", 32}, {"HMAP", 32}, {"TEXL", 4}};

/* Checks of one field of all records of a section. */
enum hfx_check {
  HFX_IS_TEXT,   /* begins within TEXT */
  HFX_IS_INDEX,  /* of a record of the section `of` */
  HFX_IS_RANGE,  /* first and number: the ranges follow each other through all of `of` */
  HFX_AT_MOST,   /* a whole number up to `of` */
  HFX_IS_FINITE, /* `of` numbers in f32 */
  HFX_IS_SHARE,  /* a number in f32, 0 to 1 */
  HFX_IS_COUNT   /* a number in f32, 0 to infinity */
};

static const struct {
  unsigned char section, byte, check, of;
} hfx_checks[] = {
    {HFX_TIME, 20, HFX_IS_TEXT, 0},
    {HFX_DEVC, 0, HFX_IS_TEXT, 0},
    {HFX_DEVC, 4, HFX_IS_TEXT, 0},
    {HFX_DEVC, 8, HFX_IS_TEXT, 0},
    {HFX_DEVC, 12, HFX_IS_RANGE, HFX_ACTR},
    {HFX_DEVC, 20, HFX_IS_RANGE, HFX_COLM},
    {HFX_ACTR, 0, HFX_IS_TEXT, 0},
    {HFX_ACTR, 4, HFX_AT_MOST, HFX_WIND},
    {HFX_ACTR, 8, HFX_IS_RANGE, HFX_COLM},
    {HFX_ACTR, 12, HFX_AT_MOST, 8},
    {HFX_ACTR, 16, HFX_IS_RANGE, HFX_ROWS},
    {HFX_ACTR, 28, HFX_AT_MOST, 2},
    {HFX_ACTR, 32, HFX_AT_MOST, 2},
    {HFX_ACTR, 36, HFX_IS_TEXT, 0},
    {HFX_ACTR, 40, HFX_IS_TEXT, 0},
    {HFX_ACTR, 44, HFX_IS_TEXT, 0},
    {HFX_ACTR, 48, HFX_IS_FINITE, 6},
    {HFX_ACTR, 72, HFX_IS_COUNT, 0},
    {HFX_ACTR, 76, HFX_IS_COUNT, 0},
    {HFX_ACTR, 80, HFX_IS_FINITE, 1},
    {HFX_COLM, 0, HFX_IS_TEXT, 0},
    {HFX_COLM, 4, HFX_IS_TEXT, 0},
    {HFX_COLM, 8, HFX_IS_INDEX, HFX_ACTR},
    {HFX_CLIP, 0, HFX_IS_TEXT, 0},
    {HFX_CLIP, 4, HFX_AT_MOST, 1},
    {HFX_BODY, 0, HFX_IS_TEXT, 0},
    {HFX_BODY, 4, HFX_IS_RANGE, HFX_BONE},
    {HFX_BODY, 12, HFX_IS_RANGE, HFX_MODL},
    {HFX_BONE, 0, HFX_IS_TEXT, 0},
    {HFX_BONE, 4, HFX_IS_TEXT, 0},
    {HFX_BONE, 8, HFX_IS_TEXT, 0},
    {HFX_BONE, 12, HFX_IS_TEXT, 0},
    {HFX_BONE, 20, HFX_IS_FINITE, 13},
    {HFX_MODL, 0, HFX_IS_TEXT, 0},
    {HFX_MODL, 4, HFX_AT_MOST, HFX_TEMPERATURE},
    {HFX_MODL, 12, HFX_IS_RANGE, HFX_VERT},
    {HFX_VERT, 0, HFX_IS_FINITE, 3},
    {HFX_VERT, 16, HFX_IS_RANGE, HFX_WGHT},
    {HFX_EFCT, 0, HFX_IS_TEXT, 0},
    {HFX_EFCT, 4, HFX_AT_MOST, 1},
    {HFX_EFCT, 8, HFX_AT_MOST, HFX_WIND},
    {HFX_EFCT, 16, HFX_IS_TEXT, 0},
    {HFX_EFCT, 20, HFX_AT_MOST, 3},
    {HFX_EFCT, 24, HFX_IS_FINITE, 1},
    {HFX_EFCT, 24, HFX_IS_COUNT, 0},
    {HFX_EFCT, 28, HFX_AT_MOST, 2},
    {HFX_EFCT, 32, HFX_IS_SHARE, 0},
    {HFX_EFCT, 36, HFX_IS_SHARE, 0},
    {HFX_EFCT, 40, HFX_IS_FINITE, 5},
    {HFX_EFCT, 60, HFX_IS_RANGE, HFX_FLTR},
    {HFX_EFCT, 64, HFX_AT_MOST, 16},
    {HFX_EFCT, 68, HFX_IS_RANGE, HFX_PNTD},
    {HFX_EFCT, 76, HFX_IS_FINITE, 12},
    {HFX_FLTR, 0, HFX_AT_MOST, 4},
    {HFX_FLTR, 4, HFX_AT_MOST, 2},
    {HFX_FLTR, 8, HFX_AT_MOST, 2},
    {HFX_FLTR, 12, HFX_IS_FINITE, 5},
    {HFX_PNTD, 4, HFX_IS_SHARE, 0},
    {HFX_REAC, 0, HFX_IS_INDEX, HFX_ACTR},
    {HFX_REAC, 4, HFX_IS_INDEX, HFX_MODL},
    {HFX_REAC, 8, HFX_AT_MOST, HFX_WIND},
    {HFX_REAC, 12, HFX_AT_MOST, 1},
    {HFX_REAC, 16, HFX_IS_FINITE, 2},
    {HFX_REAC, 20, HFX_IS_COUNT, 0},
    {HFX_REAC, 24, HFX_IS_RANGE, HFX_RCHV},
    {HFX_RCHV, 4, HFX_IS_SHARE, 0},
    {HFX_SURF, 0, HFX_IS_TEXT, 0},
    {HFX_SURF, 4, HFX_IS_INDEX, HFX_HMAP},
    {HFX_SURF, 8, HFX_IS_FINITE, 6},
    {HFX_SURF, 24, HFX_IS_COUNT, 0},
    {HFX_SURF, 28, HFX_IS_COUNT, 0},
    {HFX_HMAP, 8, HFX_IS_FINITE, 2},
    {HFX_HMAP, 16, HFX_AT_MOST, 1},
    {HFX_HMAP, 20, HFX_IS_RANGE, HFX_TEXL},
};

static inline const unsigned char *hfx_record(const hfx_clip *clip, int section, uint32_t index) {
  return clip->parts[section].at + (size_t)index * hfx_sections[section].bytes;
}

static inline const char *hfx_text(const hfx_clip *clip, const unsigned char *at) {
  return (const char *)clip->parts[HFX_TEXT].at + hfx_u32(at);
}

static inline int hfx_is_field(const hfx_clip *clip, const unsigned char *at, int check,
                               uint32_t of) {
  switch (check) {
    case HFX_IS_TEXT: return hfx_u32(at) < clip->parts[HFX_TEXT].count;
    case HFX_IS_INDEX: return hfx_u32(at) < clip->parts[of].count;
    case HFX_AT_MOST: return hfx_u32(at) <= of;
    case HFX_IS_SHARE: return hfx_is_within(hfx_f32(at), 0.0, 1.0);
    case HFX_IS_COUNT: return hfx_f32(at) >= 0.0f;
    default:
      for (; of; of--, at += 4)
        if (!hfx_is_within(hfx_f32(at), -HFX_HUGE_F32, HFX_HUGE_F32)) return 0;
      return 1;
  }
}

static inline int hfx_are_fields(const hfx_clip *clip) {
  size_t k;
  for (k = 0; k < sizeof hfx_checks / sizeof *hfx_checks; k++) {
    const int section = hfx_checks[k].section, check = hfx_checks[k].check;
    const uint32_t of = hfx_checks[k].of, count = clip->parts[section].count;
    uint64_t next = 0;
    uint32_t i;
    for (i = 0; i < count; i++) {
      const unsigned char *at = hfx_record(clip, section, i) + hfx_checks[k].byte;
      if (check != HFX_IS_RANGE) {
        if (!hfx_is_field(clip, at, check, of)) return 0;
        continue;
      }
      if (hfx_u32(at) != next) return 0;
      next += hfx_u32(at + 4);
      if (next > clip->parts[of].count) return 0;
    }
    if (check == HFX_IS_RANGE && next != clip->parts[of].count) return 0;
  }
  return 1;
}

static inline int hfx_is_time(hfx_clip *clip) {
  const unsigned char *at = clip->parts[HFX_TIME].at;
  if (clip->parts[HFX_TIME].count != 1) return 0;
  clip->rate_hz = hfx_f64(at);
  clip->row_count = hfx_u32(at + 16);
  return hfx_is_within(hfx_f64(at + 8), -HFX_HUGE_F64, HFX_HUGE_F64) && clip->rate_hz > 0.0 &&
         clip->rate_hz <= 1e6 && clip->row_count >= 1 && clip->row_count <= 0x7FFFFFFFu;
}

static inline int hfx_are_rows(const hfx_clip *clip) {
  uint64_t value = 0;
  uint32_t i, k;
  for (i = 0; i < clip->parts[HFX_ACTR].count; i++) {
    const unsigned char *at = hfx_record(clip, HFX_ACTR, i);
    const unsigned char *row = hfx_record(clip, HFX_ROWS, hfx_u32(at + 16));
    const uint32_t columns = hfx_u32(at + 12), count = hfx_u32(at + 20);
    if (columns < 1 || count < 1 || hfx_u32(at + 24) != value || hfx_u32(row) != 0) return 0;
    for (k = 1; k < count; k++)
      if (hfx_u32(row + 4 * (size_t)k) <= hfx_u32(row + 4 * (size_t)k - 4)) return 0;
    if (hfx_u32(row + 4 * (size_t)count - 4) >= clip->row_count) return 0;
    for (k = 0; k < columns; k++)
      if (hfx_u32(hfx_record(clip, HFX_COLM, hfx_u32(at + 8) + k) + 8) != i) return 0;
    value += (uint64_t)count * columns;
  }
  return value == clip->parts[HFX_VALU].count;
}

static inline int hfx_are_columns(const hfx_clip *clip) {
  static const char *const known[] = {"amplitude_m_s2", "frequency_hz", "pressure_kpa",
                                      "temperature_c",  "speed_m_s",    "direction_x",
                                      "direction_y",    "direction_z"};
  uint32_t i, k;
  for (i = 0; i < clip->parts[HFX_COLM].count; i++) {
    const unsigned char *at = hfx_record(clip, HFX_COLM, i);
    const double lowest = hfx_f64(at + 16), highest = hfx_f64(at + 24);
    for (k = 0; k < 8 && !hfx_same(hfx_text(clip, at), known[k]); k++) {}
    if (k == 8 || hfx_u32(at + 12) > 65535u) return 0;
    if (!hfx_is_within(lowest, -HFX_HUGE_F32, highest) || !(highest <= HFX_HUGE_F32)) return 0;
    if (!hfx_is_within(hfx_f64(at + 32), lowest, highest)) return 0;
  }
  for (i = 0; i < clip->parts[HFX_CLIP].count; i++) {
    const unsigned char *at = hfx_record(clip, HFX_CLIP, i);
    const double end_s = hfx_f64(at + 16);
    if (!(hfx_f64(at + 8) >= 0.0 && hfx_f64(at + 8) < end_s)) return 0;
    if (!(end_s <= clip->row_count / clip->rate_hz)) return 0;
  }
  return 1;
}

static inline int hfx_is_skin(const hfx_clip *clip, uint32_t model, uint32_t bones) {
  const unsigned char *at = hfx_record(clip, HFX_MODL, model);
  uint32_t i, k;
  for (i = 0; i < hfx_u32(at + 16); i++) {
    const unsigned char *vertex = hfx_record(clip, HFX_VERT, hfx_u32(at + 12) + i);
    const uint32_t count = hfx_u32(vertex + 20);
    uint32_t sum = 0;
    for (k = 0; k < count; k++) {
      const unsigned char *weight = hfx_record(clip, HFX_WGHT, hfx_u32(vertex + 16) + k);
      if (hfx_u16(weight) >= bones) return 0;
      sum += hfx_u16(weight + 2);
    }
    if (count > 65535u || (count && sum != 65535u)) return 0;
  }
  return 1;
}

static inline int hfx_are_bodies(const hfx_clip *clip) {
  uint32_t i, k;
  for (i = 0; i < clip->parts[HFX_BODY].count; i++) {
    const unsigned char *at = hfx_record(clip, HFX_BODY, i);
    const uint32_t bones = hfx_u32(at + 8);
    if (bones > 65535u) return 0;
    for (k = 0; k < bones; k++) {
      const uint32_t parent = hfx_u32(hfx_record(clip, HFX_BONE, hfx_u32(at + 4) + k) + 16);
      if (parent != HFX_NONE && parent >= k) return 0;
    }
    for (k = 0; k < hfx_u32(at + 16); k++)
      if (!hfx_is_skin(clip, hfx_u32(at + 12) + k, bones)) return 0;
  }
  for (i = 0; i < clip->parts[HFX_EFCT].count; i++) {
    const uint32_t body = hfx_u32(hfx_record(clip, HFX_EFCT, i) + 12);
    if (body != HFX_NONE && body >= clip->parts[HFX_BODY].count) return 0;
  }
  for (i = 0; i < clip->parts[HFX_REAC].count; i++) {
    const unsigned char *at = hfx_record(clip, HFX_REAC, i);
    const uint32_t vertices = hfx_u32(hfx_record(clip, HFX_MODL, hfx_u32(at + 4)) + 16);
    if (i && hfx_u32(at) < hfx_u32(hfx_record(clip, HFX_REAC, i - 1))) return 0;
    for (k = 0; k < hfx_u32(at + 28); k++)
      if (hfx_u32(hfx_record(clip, HFX_RCHV, hfx_u32(at + 24) + k)) >= vertices) return 0;
  }
  return 1;
}

static inline int hfx_are_surfaces(const hfx_clip *clip) {
  uint32_t i;
  for (i = 0; i < clip->parts[HFX_HMAP].count; i++) {
    const unsigned char *at = hfx_record(clip, HFX_HMAP, i);
    const uint32_t columns = hfx_u32(at), rows = hfx_u32(at + 4);
    if (columns < 1 || columns > 65535u || rows < 1 || rows > 65535u) return 0;
    if ((uint64_t)columns * rows != hfx_u32(at + 24)) return 0;
    if (!(hfx_f32(at + 8) > 0.0f && hfx_f32(at + 12) > 0.0f)) return 0;
  }
  for (i = 0; i < clip->parts[HFX_SURF].count; i++) {
    const unsigned char *at = hfx_record(clip, HFX_SURF, i);
    if (!hfx_is_within(hfx_f32(at + 8), 0.0, hfx_f32(at + 12))) return 0;
    if (!hfx_is_within(hfx_f32(at + 16), 0.0, hfx_f32(at + 20))) return 0;
  }
  return 1;
}

static inline int hfx_find_sections(hfx_clip *clip, const unsigned char *bytes, uint32_t size) {
  const uint32_t count = hfx_u32(bytes + 20);
  uint32_t i;
  int k;
  if (count > 64 || size < 24 + 16 * count) return 0;
  for (i = 0; i < count; i++) {
    const unsigned char *at = bytes + 24 + 16 * i;
    const uint32_t first = hfx_u32(at + 4), length = hfx_u32(at + 8);
    for (k = 0; k < HFX_SECTIONS; k++) {
      const char *name = hfx_sections[k].name;
      if (at[0] != name[0] || at[1] != name[1] || at[2] != name[2] || at[3] != name[3]) continue;
      if (first % 8 || first > size || length > size - first) return 0;
      if (clip->parts[k].count || length % hfx_sections[k].bytes) return 0; /* or twice */
      clip->parts[k].at = bytes + first;
      clip->parts[k].count = length / hfx_sections[k].bytes;
    }
  }
  return 1;
}

/* Tells whether bytes are UTF-8: no longer forms, no surrogates, nothing above 10FFFF. */
static inline int hfx_is_utf8(const unsigned char *at, uint32_t size) {
  uint32_t i = 0;
  while (i < size) {
    const unsigned char lead = at[i++];
    const uint32_t more = lead < 0x80u ? 0 : lead < 0xE0u ? 1 : lead < 0xF0u ? 2 : 3;
    uint32_t lowest = 0x80u, highest = 0xBFu, k;
    if ((lead >= 0x80u && lead < 0xC2u) || lead > 0xF4u || more > size - i) return 0;
    if (lead == 0xE0u) lowest = 0xA0u;
    if (lead == 0xEDu) highest = 0x9Fu;
    if (lead == 0xF0u) lowest = 0x90u;
    if (lead == 0xF4u) highest = 0x8Fu;
    for (k = 0; k < more; k++, lowest = 0x80u, highest = 0xBFu)
      if (at[i + k] < lowest || at[i + k] > highest) return 0;
    i += more;
  }
  return 1;
}

HFX_API int hfx_clip_open(hfx_clip *clip, const void *bytes, size_t size) {
  static const unsigned char mark[8] = {'H', 'F', 'X', 'C', 'L', 'I', 'P', '\n'};
  const unsigned char *at = (const unsigned char *)bytes;
  int error = 0, k;
  for (k = 0; k < 8; k++)
    if (!at || (size_t)k >= size || at[k] != mark[k]) error = HFX_ERROR_KIND;
  if (!error && size < 24) error = HFX_ERROR_SIZE;
  if (!error && (hfx_u32(at + 8) < 1 || hfx_u32(at + 8) > HFX_VERSION)) error = HFX_ERROR_VERSION;
  if (!error && (hfx_u32(at + 12) != size || size > 0x7FFFFFFFu)) error = HFX_ERROR_SIZE;
  if (!error && hfx_crc32(at + 20, size - 20) != hfx_u32(at + 16)) error = HFX_ERROR_CHECKSUM;
  for (k = 0; k < HFX_SECTIONS; k++) clip->parts[k].at = at, clip->parts[k].count = 0;
  if (!error && hfx_find_sections(clip, at, (uint32_t)size)) {
    const hfx_part *text = &clip->parts[HFX_TEXT];
    if (text->count && !text->at[0] && !text->at[text->count - 1] &&
        hfx_is_utf8(text->at, text->count) && hfx_is_time(clip) &&
        hfx_are_fields(clip) && hfx_are_rows(clip) && hfx_are_columns(clip) &&
        hfx_are_bodies(clip) && hfx_are_surfaces(clip))
      return 0;
  }
  clip->rate_hz = 1.0; /* a clip with nothing in it */
  clip->row_count = 0;
  for (k = 0; k < HFX_SECTIONS; k++) clip->parts[k].count = 0;
  return error ? error : HFX_ERROR_CONTENT;
}

HFX_API const char *hfx_error_text(int error) {
  static const char *const texts[] = {
      "There is no error.",
      "The clip is cut off, or longer than it says.",
      "This is no haptic clip.",
      "The clip is of a newer version than this player reads.",
      "The clip is damaged: its checksum differs.",
      "The clip breaks a rule of its format; 'hfx validate' names the field.",
      "There is nothing of this number.",
      "There is nothing of this name.",
      "Too little memory was given for the body."};
  return texts[error <= 0 && error >= HFX_ERROR_MEMORY ? -error : 0];
}

#ifdef __cplusplus
}
#endif

#endif
