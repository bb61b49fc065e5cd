/* SPDX-License-Identifier: MIT
 *
 * Skin of a body: places of its vertices, in chunks that are posed when they are needed. Included
 * by hfx_player.h. */
#ifndef HFX_SKIN_H
#define HFX_SKIN_H

#ifdef __cplusplus
extern "C" {
#endif

#define HFX_UNKNOWN_SLACK 1e30f /* slack of a chunk whose place is not known */

#define HFX_ROUNDING 4e-6f /* of places in the world: far more than a sum of products has */

/* Poses a chunk. */
static inline void hfx_pose_chunk(const hfx_rest *rest, const hfx_pull *pulls,
                                  const hfx_lanes *pose, hfx_chunk *chunk) {
  int g, i;
  for (g = 0; g < HFX_CHUNK / HFX_LANES; g++) {
    const float *x = rest->x + HFX_LANES * g, *y = rest->y + HFX_LANES * g;
    const float *z = rest->z + HFX_LANES * g;
    const hfx_pull *pull = pulls + rest->first[g], *end = pulls + rest->first[g + 1];
    float a[HFX_LANES] = {0.0f}, b[HFX_LANES] = {0.0f}, d[HFX_LANES] = {0.0f};
    for (; pull < end; pull++) {
      const float(*m)[HFX_LANES] = pose[pull->bone].at, *share = pull->shares;
      HFX_KEEP_LOOP
      for (i = 0; i < HFX_LANES; i++) {
        a[i] += share[i] * (m[0][i] * x[i] + m[1][i] * y[i] + m[2][i] * z[i] + m[3][i]);
        b[i] += share[i] * (m[4][i] * x[i] + m[5][i] * y[i] + m[6][i] * z[i] + m[7][i]);
        d[i] += share[i] * (m[8][i] * x[i] + m[9][i] * y[i] + m[10][i] * z[i] + m[11][i]);
      }
    }
    for (i = 0; i < HFX_LANES; i++) {
      chunk->x[HFX_LANES * g + i] = a[i];
      chunk->y[HFX_LANES * g + i] = b[i];
      chunk->z[HFX_LANES * g + i] = d[i];
    }
  }
}

#define HFX_REMEMBERED 16 /* bones of HFX_LANES vertices; one that comes again later has 2 pulls */

/* Number of pulls on the HFX_LANES vertices from number `i` of a model on, its last one repeated;
 * they are written to `found` unless it is NULL. `still`: number of the pose of a vertex without
 * bones. */
static inline uint32_t hfx_find_pulls(const hfx_clip *clip, const unsigned char *model, uint32_t i,
                                      uint32_t still, hfx_pull *found) {
  uint32_t bones[HFX_REMEMBERED], count = 0, k, n;
  int lane, c;
  for (lane = 0; lane < HFX_LANES; lane++) {
    const uint32_t last = hfx_u32(model + 16) - 1, own = i + (uint32_t)lane;
    const uint32_t at = hfx_u32(model + 12) + (own < last ? own : last);
    const unsigned char *vertex = hfx_record(clip, HFX_VERT, at);
    const uint32_t weights = hfx_u32(vertex + 20);
    for (k = 0; k < (weights ? weights : 1); k++) {
      const unsigned char *weight = hfx_record(clip, HFX_WGHT, hfx_u32(vertex + 16) + k);
      const uint32_t bone = weights ? hfx_u16(weight) : still;
      const uint32_t oldest = count > HFX_REMEMBERED ? count - HFX_REMEMBERED : 0;
      for (n = oldest; n < count && bones[n % HFX_REMEMBERED] != bone; n++) {}
      if (n == count) {
        bones[count++ % HFX_REMEMBERED] = bone;
        if (found) found[n].bone = bone;
        for (c = 0; found && c < HFX_LANES; c++) found[n].shares[c] = 0.0f;
      }
      if (found) found[n].shares[lane] += weights ? (float)hfx_u16(weight + 2) / 65535.0f : 1.0f;
    }
  }
  return count;
}

static inline uint32_t hfx_chunk_count(uint32_t vertices) {
  return vertices / HFX_CHUNK + (vertices % HFX_CHUNK > 0);
}

/* Number of pulls on all vertices of a model. */
static inline uint64_t hfx_count_pulls(const hfx_clip *clip, const unsigned char *model) {
  uint64_t sum = 0;
  uint32_t i;
  for (i = 0; i < HFX_CHUNK * hfx_chunk_count(hfx_u32(model + 16)); i += HFX_LANES)
    sum += hfx_find_pulls(clip, model, i, 0, NULL);
  return sum;
}

/* Reads rest places and pulls of all models of a body. */
static inline void hfx_read_skin(hfx_body *self) {
  const hfx_clip *clip = &self->clip;
  const unsigned char *body = hfx_record(clip, HFX_BODY, self->body);
  hfx_rest *rest = self->rest;
  const uint32_t still = hfx_u32(body + 8);
  uint32_t m, k, i, first = 0;
  for (i = 0; i < 12; i += 5) /* of memory of zeros */
    for (k = 0; k < HFX_LANES; k++)
      self->pose[still].at[i][k] = self->pose_before[still].at[i][k] = 1.0f;
  for (m = 0; m < hfx_u32(body + 16); m++) {
    const unsigned char *model = hfx_record(clip, HFX_MODL, hfx_u32(body + 12) + m);
    const uint32_t vertices = hfx_u32(model + 16);
    for (k = 0; k < hfx_chunk_count(vertices); k++, rest++)
      for (i = 0; i < HFX_CHUNK; i++) {
        const uint32_t at = HFX_CHUNK * k + i < vertices ? HFX_CHUNK * k + i : vertices - 1;
        const unsigned char *vertex = hfx_record(clip, HFX_VERT, hfx_u32(model + 12) + at);
        rest->x[i] = hfx_f32(vertex);
        rest->y[i] = hfx_f32(vertex + 4);
        rest->z[i] = hfx_f32(vertex + 8);
        if (i % HFX_LANES) continue;
        rest->first[i / HFX_LANES] = first;
        first += hfx_find_pulls(clip, model, HFX_CHUNK * k + i, still, self->pulls + first);
        rest->first[i / HFX_LANES + 1] = first;
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

/* Widens boxes by the way that vertices may have moved. */
static inline void hfx_widen_boxes(hfx_boxes *boxes, float way) {
  const float *centre[3], *half[3];
  int c, i;
  centre[0] = boxes->centre.x, centre[1] = boxes->centre.y, centre[2] = boxes->centre.z;
  half[0] = boxes->half.x, half[1] = boxes->half.y, half[2] = boxes->half.z;
  for (i = 0; i < HFX_CHUNK; i++) {
    const float slack = boxes->slack[i] + way;
    boxes->slack[i] = slack < HFX_UNKNOWN_SLACK ? slack : HFX_UNKNOWN_SLACK;
  }
  for (c = 0; c < 3; c++) {
    float low[HFX_CHUNK], high[HFX_CHUNK];
    for (i = 0; i < HFX_CHUNK; i++) {
      low[i] = centre[c][i] - (half[c][i] + boxes->slack[i]);
      high[i] = centre[c][i] + (half[c][i] + boxes->slack[i]);
    }
    boxes->low[c] = hfx_smallest(low);
    boxes->high[c] = hfx_largest(high);
  }
}

/* Begins a frame: all chunks may have moved, and none is posed. */
static inline void hfx_begin_pose(hfx_body *self) {
  const uint32_t bones = hfx_clip_bones(&self->clip, self->body);
  const float way = self->was_posed ? hfx_largest_motion(self, bones) : HFX_UNKNOWN_SLACK;
  hfx_chunk *spare = self->before;
  hfx_lanes *spare_pose = self->pose_before;
  uint32_t k;
  int c, i;
  self->before = self->places;
  self->places = spare;
  self->pose_before = self->pose;
  self->pose = spare_pose;
  for (k = 0; k < bones; k++)
    for (c = 0; c < 12; c++)
      for (i = 0; i < HFX_LANES; i++)
        self->pose[k].at[c][i] = self->bones[k].now[4 * (c % 4) + c / 4];
  self->frame++;
  for (k = 0; k < hfx_chunk_count(self->chunks); k++) hfx_widen_boxes(self->boxes + k, way);
}

#ifdef __cplusplus
}
#endif

#endif
