/* SPDX-License-Identifier: MIT
 *
 * Skin of a body: places of its vertices, in chunks that are posed when they are needed. Included
 * by hfx_player.h. */
#ifndef HFX_SKIN_H
#define HFX_SKIN_H

#ifdef __cplusplus
extern "C" {
#endif

#define HFX_UNKNOWN 1e30f /* half a box whose place is not known, metres */

#define HFX_ROUNDING 4e-6f /* of places in the world: far more than a sum of products has */

/* Poses a chunk. `lows` and `highs`: least and largest x, y and z in each lane. */
static inline void hfx_pose_chunk(const hfx_rest *rest, const hfx_pull *pulls,
                                  const hfx_lanes *pose, hfx_chunk *chunk,
                                  float (*HFX_RESTRICT lows)[HFX_LANES],
                                  float (*HFX_RESTRICT highs)[HFX_LANES]) {
  float low[3][HFX_LANES], high[3][HFX_LANES];
  int g, i;
  for (i = 0; i < HFX_LANES; i++) {
    low[0][i] = low[1][i] = low[2][i] = HFX_FARTHEST;
    high[0][i] = high[1][i] = high[2][i] = -HFX_FARTHEST;
  }
  for (g = 0; g < HFX_CHUNK / HFX_LANES; g++) {
    const float *x = rest->x + HFX_LANES * g, *y = rest->y + HFX_LANES * g;
    const float *z = rest->z + HFX_LANES * g;
    const hfx_pull *pull = pulls + rest->first[g], *end = pulls + rest->first[g + 1];
    float a[HFX_LANES] = {0.0f}, b[HFX_LANES] = {0.0f}, d[HFX_LANES] = {0.0f};
    for (; pull < end; pull++) {
      const float(*m)[HFX_LANES] = HFX_ALIGNED(pose[pull->bone].at), *share = pull->shares;
      HFX_KEEP_LOOP
      for (i = 0; i < HFX_LANES; i++) {
        a[i] += share[i] * (m[0][i] * x[i] + m[1][i] * y[i] + m[2][i] * z[i] + m[3][i]);
        b[i] += share[i] * (m[4][i] * x[i] + m[5][i] * y[i] + m[6][i] * z[i] + m[7][i]);
        d[i] += share[i] * (m[8][i] * x[i] + m[9][i] * y[i] + m[10][i] * z[i] + m[11][i]);
      }
    }
    HFX_KEEP_LOOP
    for (i = 0; i < HFX_LANES; i++) {
      low[0][i] = a[i] < low[0][i] ? a[i] : low[0][i];
      low[1][i] = b[i] < low[1][i] ? b[i] : low[1][i];
      low[2][i] = d[i] < low[2][i] ? d[i] : low[2][i];
      high[0][i] = a[i] > high[0][i] ? a[i] : high[0][i];
      high[1][i] = b[i] > high[1][i] ? b[i] : high[1][i];
      high[2][i] = d[i] > high[2][i] ? d[i] : high[2][i];
    }
    for (i = 0; i < HFX_LANES; i++) {
      chunk->x[HFX_LANES * g + i] = a[i];
      chunk->y[HFX_LANES * g + i] = b[i];
      chunk->z[HFX_LANES * g + i] = d[i];
    }
  }
  for (i = 0; i < HFX_LANES; i++) {
    lows[0][i] = low[0][i], lows[1][i] = low[1][i], lows[2][i] = low[2][i];
    highs[0][i] = high[0][i], highs[1][i] = high[1][i], highs[2][i] = high[2][i];
  }
}

#define HFX_REMEMBERED 32 /* bones; one that comes again later counts once more */

/* Number of bones of some vertices of a model, from number `first` on, the model's last one
 * repeated. They are written to `bones`, or with their shares of HFX_LANES vertices to `pulls`,
 * unless these are NULL. `still`: number of the pose of a vertex without bones. */
static inline uint32_t hfx_find_bones(const hfx_clip *clip, const unsigned char *model,
                                      uint32_t first, uint32_t vertices, uint32_t still,
                                      uint32_t *bones, hfx_pull *pulls) {
  uint32_t recent[HFX_REMEMBERED], count = 0, i, k, n;
  int c;
  for (i = 0; i < vertices; i++) {
    const uint32_t last = hfx_u32(model + 16) - 1, at = first + i < last ? first + i : last;
    const unsigned char *vertex = hfx_record(clip, HFX_VERT, hfx_u32(model + 12) + at);
    const uint32_t weights = hfx_u32(vertex + 20);
    for (k = 0; k < (weights ? weights : 1); k++) {
      const unsigned char *weight = hfx_record(clip, HFX_WGHT, hfx_u32(vertex + 16) + k);
      const uint32_t bone = weights ? hfx_u16(weight) : still;
      n = count > HFX_REMEMBERED ? count - HFX_REMEMBERED : 0;
      while (n < count && recent[n % HFX_REMEMBERED] != bone) n++;
      if (n == count) {
        recent[count++ % HFX_REMEMBERED] = bone;
        if (bones) bones[n] = bone;
        if (pulls) pulls[n].bone = bone;
        for (c = 0; pulls && c < HFX_LANES; c++) pulls[n].shares[c] = 0.0f;
      }
      if (pulls) pulls[n].shares[i] += weights ? (float)hfx_u16(weight + 2) / 65535.0f : 1.0f;
    }
  }
  return count;
}

static inline uint32_t hfx_chunk_count(uint32_t vertices) {
  return vertices / HFX_CHUNK + (vertices % HFX_CHUNK > 0);
}

/* Adds the numbers of bones of all chunks of a model, and of pulls on all of its vertices. */
static inline void hfx_count_bones(const hfx_clip *clip, const unsigned char *model,
                                   uint32_t still, uint64_t *bones, uint64_t *pulls) {
  uint32_t i;
  for (i = 0; i < HFX_CHUNK * hfx_chunk_count(hfx_u32(model + 16)); i += HFX_LANES) {
    *pulls += hfx_find_bones(clip, model, i, HFX_LANES, still, NULL, NULL);
    if (i % HFX_CHUNK == 0) *bones += hfx_find_bones(clip, model, i, HFX_CHUNK, still, NULL, NULL);
  }
}

/* Reads rest places and pulls of all models of a body. */
static inline void hfx_read_skin(hfx_body *self) {
  const hfx_clip *clip = &self->clip;
  const unsigned char *body = hfx_record(clip, HFX_BODY, self->body);
  hfx_rest *rest = self->rest;
  const uint32_t still = hfx_u32(body + 8);
  uint32_t m, k, i, first = 0, bone = 0;
  for (i = 0; i < 12; i += 5) /* of memory of zeros */
    for (k = 0; k < HFX_LANES; k++)
      self->pose[still].at[i][k] = self->pose_before[still].at[i][k] = 1.0f;
  for (k = 0; k < self->chunks; k++) {
    hfx_chunk *half = &self->boxes[k / HFX_CHUNK].half;
    i = k % HFX_CHUNK;
    half->x[i] = half->y[i] = half->z[i] = HFX_UNKNOWN;
  }
  for (m = 0; m < hfx_u32(body + 16); m++) {
    const unsigned char *model = hfx_record(clip, HFX_MODL, hfx_u32(body + 12) + m);
    const uint32_t vertices = hfx_u32(model + 16);
    for (k = 0; k < hfx_chunk_count(vertices); k++, rest++) {
      rest->first_bone = bone;
      bone += hfx_find_bones(clip, model, HFX_CHUNK * k, HFX_CHUNK, still,
                             self->chunk_bones + bone, NULL);
      rest->end_bone = bone;
      for (i = 0; i < HFX_CHUNK; i++) {
        const uint32_t at = HFX_CHUNK * k + i < vertices ? HFX_CHUNK * k + i : vertices - 1;
        const unsigned char *vertex = hfx_record(clip, HFX_VERT, hfx_u32(model + 12) + at);
        rest->x[i] = hfx_f32(vertex);
        rest->y[i] = hfx_f32(vertex + 4);
        rest->z[i] = hfx_f32(vertex + 8);
        if (i % HFX_LANES) continue;
        rest->first[i / HFX_LANES] = first;
        first += hfx_find_bones(clip, model, HFX_CHUNK * k + i, HFX_LANES, still, NULL,
                                self->pulls + first);
        rest->first[i / HFX_LANES + 1] = first;
      }
    }
  }
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

/* Finds the least and the most motion along each axis, since the frame before, of the vertices that
 * follow a bone, metres. */
static inline void hfx_find_ways(hfx_bone_pose *bone) {
  float middle[3], half[3];
  int c;
  for (c = 0; c < 3; c++) {
    middle[c] = 0.5f * bone->low[c] + 0.5f * bone->high[c];
    half[c] = 0.5f * bone->high[c] - 0.5f * bone->low[c];
  }
  for (c = 0; c < 4; c++) {
    const float x = bone->now[c] - bone->before[c], y = bone->now[4 + c] - bone->before[4 + c];
    const float z = bone->now[8 + c] - bone->before[8 + c];
    const float way = x * middle[0] + y * middle[1] + z * middle[2] + bone->now[12 + c] -
                      bone->before[12 + c];
    const float more = fabsf(x) * half[0] + fabsf(y) * half[1] + fabsf(z) * half[2];
    const int is_known = fabsf(way) + more < HFX_UNKNOWN;
    bone->least[c] = is_known ? way - more : -HFX_UNKNOWN;
    bone->most[c] = is_known ? way + more : HFX_UNKNOWN;
  }
}

/* Moves and widens up to HFX_CHUNK boxes by what vertices may have moved with their bones. */
static inline void hfx_move_boxes(hfx_boxes *boxes, const hfx_rest *rest, uint32_t count,
                                  const uint32_t *chunk_bones, const hfx_bone_pose *bones) {
  float least[HFX_CHUNK][4], most[HFX_CHUNK][4];
  float low[HFX_CHUNK], high[HFX_CHUNK], *centre[3], *half[3];
  uint32_t k, n;
  int c, i;
  for (k = 0; k < count; k++, rest++) {
    const hfx_bone_pose *first = bones + chunk_bones[rest->first_bone];
    float from[4], to[4];
    HFX_KEEP_LOOP
    for (c = 0; c < 4; c++) from[c] = first->least[c], to[c] = first->most[c];
    for (n = rest->first_bone + 1; n < rest->end_bone; n++) {
      const hfx_bone_pose *bone = bones + chunk_bones[n];
      HFX_KEEP_LOOP
      for (c = 0; c < 4; c++) {
        from[c] = bone->least[c] < from[c] ? bone->least[c] : from[c];
        to[c] = bone->most[c] > to[c] ? bone->most[c] : to[c];
      }
    }
    for (c = 0; c < 4; c++) least[k][c] = from[c], most[k][c] = to[c];
  }
  for (; k < HFX_CHUNK; k++)
    for (c = 0; c < 4; c++) least[k][c] = most[k][c] = 0.0f;
  centre[0] = boxes->centre.x, centre[1] = boxes->centre.y, centre[2] = boxes->centre.z;
  half[0] = boxes->half.x, half[1] = boxes->half.y, half[2] = boxes->half.z;
  for (c = 0; c < 3; c++) {
    for (i = 0; i < HFX_CHUNK; i++) {
      const float middle = centre[c][i] + 0.5f * (least[i][c] + most[i][c]);
      float more = half[c][i] + 0.5f * (most[i][c] - least[i][c]);
      more += 0.25f * HFX_ROUNDING * (fabsf(middle) + more);
      low[i] = more < HFX_UNKNOWN ? more : HFX_UNKNOWN;
      high[i] = more < HFX_UNKNOWN ? middle : 0.0f;
    }
    hfx_copy(half[c], low, sizeof low);
    hfx_copy(centre[c], high, sizeof high);
    for (i = 0; i < HFX_CHUNK; i++) low[i] = centre[c][i] - half[c][i];
    boxes->low[c] = hfx_smallest(low);
    for (i = 0; i < HFX_CHUNK; i++) high[i] = centre[c][i] + half[c][i];
    boxes->high[c] = hfx_largest(high);
  }
}

/* Begins a frame: all chunks may have moved, and none is posed. */
static inline void hfx_begin_pose(hfx_body *self) {
  const uint32_t bones = hfx_clip_bones(&self->clip, self->body);
  hfx_chunk *spare = self->before;
  hfx_lanes *spare_pose = self->pose_before;
  uint32_t k;
  int c, i;
  self->before = self->places;
  self->places = spare;
  self->pose_before = self->pose;
  self->pose = spare_pose;
  for (k = 0; k < bones; k++) {
    const float *now = self->bones[k].now;
    int is_known = 1;
    for (c = 0; c < 16; c++) is_known &= fabsf(now[c]) < HFX_UNKNOWN;
    for (c = 0; c < 12; c++) { /* a bone of no numbers is far away: 0 times that is 0 */
      const float number = is_known ? now[4 * (c % 4) + c / 4] : c % 4 == 3 ? HFX_UNKNOWN : 0.0f;
      for (i = 0; i < HFX_LANES; i++) self->pose[k].at[c][i] = number;
    }
    hfx_find_ways(&self->bones[k]);
  }
  self->frame++;
  for (k = 0; k < self->chunks; k += HFX_CHUNK)
    hfx_move_boxes(self->boxes + k / HFX_CHUNK, self->rest + k,
                   self->chunks - k < HFX_CHUNK ? self->chunks - k : HFX_CHUNK,
                   self->chunk_bones, self->bones);
}

#ifdef __cplusplus
}
#endif

#endif
