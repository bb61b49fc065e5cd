/* SPDX-License-Identifier: MIT
 *
 * Skin of a body: places of its vertices, in chunks that are posed when they are needed. Included
 * by hfx_player.h. */
#ifndef HFX_SKIN_H
#define HFX_SKIN_H

#ifdef __cplusplus
extern "C" {
#endif

#define HFX_FARTHEST 3.4e38f
#define HFX_UNKNOWN_SLACK 1e30f /* slack of a chunk whose place is not known */

#define HFX_ROUNDING 4e-6f /* of places in the world: far more than a sum of products has */

/* A loop that gcc makes one vector instruction of, if it does not unroll it before. */
#if defined(__GNUC__) && !defined(__clang__)
#define HFX_KEEP_LOOP _Pragma("GCC unroll 1")
#else
#define HFX_KEEP_LOOP
#endif

/* Poses one vertex; the fourth number of its place means nothing. */
static inline void hfx_pose_vertex(const hfx_clip *clip, const float *matrices,
                                   const unsigned char *at, float *place) {
  const unsigned char *weight = hfx_record(clip, HFX_WGHT, hfx_u32(at + 16));
  const unsigned char *end = weight + 4 * (size_t)hfx_u32(at + 20);
  const float x = hfx_f32(at), y = hfx_f32(at + 4), z = hfx_f32(at + 8);
  float sum[4] = {0.0f, 0.0f, 0.0f, 0.0f};
  int c;
  place[0] = x, place[1] = y, place[2] = z;
  if (weight == end) return;
  for (; weight < end; weight += 4) {
    const float *m = matrices + sizeof(hfx_bone_pose) / sizeof(float) * hfx_u16(weight);
    const float share = (float)hfx_u16(weight + 2);
    HFX_KEEP_LOOP
    for (c = 0; c < 4; c++) sum[c] += share * (m[c] * x + m[4 + c] * y + m[8 + c] * z + m[12 + c]);
  }
  for (c = 0; c < 4; c++) place[c] = sum[c] * (1.0f / 65535.0f);
}

/* Poses a chunk of `count` or more vertices from the record `at` on; `box`: its lowest and highest
 * corner. */
static inline void hfx_pose_chunk(const hfx_clip *clip, const float *matrices,
                                  const unsigned char *at, uint32_t count, hfx_chunk *chunk,
                                  float *box) {
  float low[4], high[4], place[4] = {0.0f, 0.0f, 0.0f, 0.0f};
  uint32_t i;
  int c;
  for (c = 0; c < 4; c++) low[c] = HFX_FARTHEST, high[c] = -HFX_FARTHEST;
  for (i = 0; i < HFX_CHUNK; i++, at += 24) {
    if (i < count) hfx_pose_vertex(clip, matrices, at, place);
    for (c = 0; c < 4; c++) {
      low[c] = place[c] < low[c] ? place[c] : low[c];
      high[c] = place[c] > high[c] ? place[c] : high[c];
    }
    chunk->x[i] = place[0], chunk->y[i] = place[1], chunk->z[i] = place[2];
  }
  for (c = 0; c < 4; c++) box[c] = low[c], box[4 + c] = high[c];
}

static inline uint32_t hfx_chunk_count(uint32_t vertices) {
  return vertices / HFX_CHUNK + (vertices % HFX_CHUNK > 0);
}

/* Finds the boxes in rest space of the vertices that follow each bone. */
static inline void hfx_find_bone_extents(hfx_body *self) {
  const hfx_clip *clip = &self->clip;
  const unsigned char *body = hfx_record(clip, HFX_BODY, self->body);
  uint32_t i, k, m;
  int c;
  for (i = 0; i < hfx_u32(body + 8); i++)
    for (c = 0; c < 4; c++)
      self->bones[i].low[c] = HFX_FARTHEST, self->bones[i].high[c] = -HFX_FARTHEST;
  for (m = 0; m < hfx_u32(body + 16); m++) {
    const unsigned char *model = hfx_record(clip, HFX_MODL, hfx_u32(body + 12) + m);
    for (i = 0; i < hfx_u32(model + 16); i++) {
      const unsigned char *at = hfx_record(clip, HFX_VERT, hfx_u32(model + 12) + i);
      for (k = 0; k < hfx_u32(at + 20); k++) {
        hfx_bone_pose *bone =
            self->bones + hfx_u16(hfx_record(clip, HFX_WGHT, hfx_u32(at + 16) + k));
        for (c = 0; c < 3; c++) {
          const float place = hfx_f32(at + 4 * c);
          if (place < bone->low[c]) bone->low[c] = place;
          if (place > bone->high[c]) bone->high[c] = place;
        }
      }
    }
  }
}

/* Upper bound of a vertex's motion along any axis since the frame before, metres. */
static inline float hfx_largest_motion(const hfx_body *self, uint32_t bones) {
  float most[4] = {0.0f, 0.0f, 0.0f, 0.0f}, longest;
  uint32_t i;
  int c;
  for (i = 0; i < bones; i++) {
    const hfx_bone_pose *bone = self->bones + i;
    float middle[3], half[3];
    if (bone->low[0] > bone->high[0]) continue; /* nothing follows it */
    for (c = 0; c < 3; c++) {
      middle[c] = 0.5f * bone->low[c] + 0.5f * bone->high[c];
      half[c] = 0.5f * bone->high[c] - 0.5f * bone->low[c];
    }
    for (c = 0; c < 4; c++) {
      const float x = bone->now[c] - bone->before[c], y = bone->now[4 + c] - bone->before[4 + c];
      const float z = bone->now[8 + c] - bone->before[8 + c];
      const float t = bone->now[12 + c] - bone->before[12 + c];
      const float way = fabsf(x * middle[0] + y * middle[1] + z * middle[2] + t) +
                        fabsf(x) * half[0] + fabsf(y) * half[1] + fabsf(z) * half[2];
      most[c] = way <= most[c] ? most[c] : way; /* NaN, too */
    }
  }
  longest = most[0] <= most[1] ? most[1] : most[0];
  longest = longest <= most[2] ? most[2] : longest;
  return longest < HFX_UNKNOWN_SLACK ? longest : HFX_UNKNOWN_SLACK;
}

/* Begins a frame: all chunks may have moved, and none is posed. */
static inline void hfx_begin_pose(hfx_body *self) {
  const uint32_t bones = hfx_clip_bones(&self->clip, self->body);
  const float way = self->was_posed ? hfx_largest_motion(self, bones) : HFX_UNKNOWN_SLACK;
  hfx_chunk *spare = self->before;
  uint32_t k;
  int i;
  self->before = self->places;
  self->places = spare;
  self->frame++;
  for (k = 0; k < hfx_chunk_count(self->chunks); k++)
    for (i = 0; i < HFX_CHUNK; i++) {
      const float slack = self->boxes[k].slack[i] + way;
      self->boxes[k].slack[i] = slack < HFX_UNKNOWN_SLACK ? slack : HFX_UNKNOWN_SLACK;
    }
}

#ifdef __cplusplus
}
#endif

#endif
