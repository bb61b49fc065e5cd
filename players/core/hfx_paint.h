/* SPDX-License-Identifier: MIT
 *
 * Painted areas: their weights on a body, also of another clip, turned and raised. Included by
 * hfx_player.h. */
#ifndef HFX_PAINT_H
#define HFX_PAINT_H

#ifdef __cplusplus
extern "C" {
#endif

#define HFX_NEAREST 0.06 /* of the body's size: a vertex that is farther away gives no weight */
#define HFX_NO_PAINT -1.0f /* weight of a vertex that the other clip's model does not have */

/* Test that the effects of a body are those of its own clip. */
static inline int hfx_is_own(const hfx_clip *clip, const hfx_clip *effects) {
  return effects->parts[HFX_TEXT].at == clip->parts[HFX_TEXT].at;
}

/* The model of an id on a body; HFX_NONE: there is none. */
static inline uint32_t hfx_model_named(const hfx_clip *clip, uint32_t body, const char *id) {
  const unsigned char *at = hfx_record(clip, HFX_BODY, body);
  uint32_t k;
  for (k = hfx_u32(at + 12); k < hfx_u32(at + 12) + hfx_u32(at + 16); k++)
    if (hfx_same(hfx_text(clip, hfx_record(clip, HFX_MODL, k)), id)) return k;
  return HFX_NONE;
}

/* The model of a body that an effect is felt on; HFX_NONE: there is none. Effects of another clip
 * are felt whichever body they were made for. */
static inline uint32_t hfx_model_of(const hfx_clip *clip, uint32_t body, const hfx_clip *effects,
                                    const unsigned char *effect) {
  const uint32_t of = hfx_u32(effect + 12);
  if (hfx_is_own(clip, effects) && of != HFX_NONE && of != body) return HFX_NONE;
  return hfx_model_named(clip, body, hfx_text(effects, effect + 16));
}

static inline uint32_t hfx_vertices_of(const hfx_clip *clip, uint32_t model) {
  return model == HFX_NONE ? 0 : hfx_u32(hfx_record(clip, HFX_MODL, model) + 16);
}

static inline uint32_t hfx_chunks_of(const hfx_clip *clip, uint32_t model) {
  return hfx_chunk_count(hfx_vertices_of(clip, model));
}

static inline const unsigned char *hfx_vertex(const hfx_clip *clip, uint32_t model,
                                              uint32_t index) {
  return hfx_record(clip, HFX_VERT, hfx_u32(hfx_record(clip, HFX_MODL, model) + 12) + index);
}

/* Index of the vertex of a number in a model, searched from `from` on; HFX_NONE: there is none.
 * Models of one level have their vertices in one order. */
static inline uint32_t hfx_find_vertex(const hfx_clip *clip, uint32_t model, uint32_t number,
                                       uint32_t from) {
  const uint32_t count = hfx_vertices_of(clip, model);
  uint32_t k;
  if (from >= count) from = 0;
  for (k = 0; k < count; k++, from = from + 1 < count ? from + 1 : 0)
    if (hfx_u32(hfx_vertex(clip, model, from) + 12) == number) return from;
  return HFX_NONE;
}

/* Weights of a painted area as it was made, at the vertices of its model; a coarser model of
 * another clip leaves HFX_NO_PAINT at vertices that it does not have. Tells whether it did. */
static inline int hfx_made_weights(const hfx_body *self, const hfx_felt *felt, float *weights) {
  const hfx_clip *clip = &self->clip, *effects = self->effects;
  const uint32_t count = hfx_vertices_of(clip, felt->model), of = hfx_u32(felt->effect + 12);
  const unsigned char *painted = hfx_record(effects, HFX_PNTD, hfx_u32(felt->effect + 68));
  const unsigned char *end = painted + 8 * (size_t)hfx_u32(felt->effect + 72);
  uint32_t model = HFX_NONE, at = 0, k;
  int is_coarser;
  if (of != HFX_NONE) model = hfx_model_named(effects, of, hfx_text(effects, felt->effect + 16));
  is_coarser = !hfx_is_own(clip, effects) && model != HFX_NONE &&
               hfx_u32(hfx_record(effects, HFX_MODL, model) + 8) >
                   hfx_u32(hfx_record(clip, HFX_MODL, felt->model) + 8);
  for (k = 0; k < count; k++) weights[k] = is_coarser ? HFX_NO_PAINT : 0.0f;
  for (k = 0; is_coarser && k < hfx_vertices_of(effects, model); k++) {
    const uint32_t number = hfx_u32(hfx_vertex(effects, model, k) + 12);
    const uint32_t found = hfx_find_vertex(clip, felt->model, number, at);
    if (found != HFX_NONE) weights[at = found] = 0.0f;
  }
  for (; painted < end; painted += 8) {
    uint32_t vertex = hfx_u32(painted);
    if (of == HFX_NONE) { /* of no body: numbers of the model */
      vertex = hfx_find_vertex(clip, felt->model, vertex, at);
    } else if (!hfx_is_own(clip, effects)) {
      if (vertex >= hfx_vertices_of(effects, model)) continue;
      vertex = hfx_find_vertex(clip, felt->model, hfx_u32(hfx_vertex(effects, model, vertex) + 12),
                               vertex);
    }
    if (vertex < count) weights[at = vertex] = hfx_f32(painted + 4);
  }
  return is_coarser;
}

/* Box round the skin that bones of a human name move, at rest; "": all bones. 0: there is none. */
static inline int hfx_skin_box(const hfx_body *self, const char *human, double low[3],
                               double high[3]) {
  hfx_bone bone;
  uint32_t k;
  int c, is_any = 0;
  for (k = 0; hfx_clip_bone(&self->clip, self->body, k, &bone) == 0; k++) {
    const hfx_bone_pose *pose = self->bones + k;
    if ((*human && !hfx_same(bone.human, human)) || pose->low[0] > pose->high[0]) continue;
    for (c = 0; c < 3; c++) {
      if (!is_any || pose->low[c] < low[c]) low[c] = pose->low[c];
      if (!is_any || pose->high[c] > high[c]) high[c] = pose->high[c];
    }
    is_any = 1;
  }
  return is_any;
}

typedef struct hfx_turn { /* the way from a vertex to where its weight comes from */
  double sine, cosine, raise_m, stretch, middle_m, centre[3], reach_m;
  int up, right, ahead; /* axes of rest space: height, and two that turn */
} hfx_turn;

/* The axis of a body: through the middle of its hips, along the axis of rest space that leads to
 * its head; without these along Z, through the middle of all. */
static inline void hfx_find_axis(const hfx_body *self, double turn_degrees, hfx_turn *turn) {
  double low[3] = {0, 0, 0}, high[3] = {0, 0, 0}, head[3] = {0, 0, 0}, top[3] = {0, 0, 0};
  double size = 0.0, way = 1.0;
  int c, is_head;
  hfx_skin_box(self, "", low, high);
  for (c = 0; c < 3; c++) size = high[c] - low[c] > size ? high[c] - low[c] : size;
  is_head = hfx_skin_box(self, "head", head, top) && hfx_skin_box(self, "hips", low, high);
  turn->up = 2;
  for (c = 0; c < 3; c++) {
    turn->centre[c] = 0.5 * (low[c] + high[c]);
    head[c] = 0.5 * (head[c] + top[c]) - turn->centre[c];
  }
  for (c = 0; c < 2 && is_head; c++)
    if (fabs(head[c]) > fabs(head[turn->up])) turn->up = c;
  if (is_head && head[turn->up] < 0.0) way = -1.0;
  turn->right = (turn->up + 1) % 3;
  turn->ahead = (turn->up + 2) % 3;
  turn->sine = way * sin(turn_degrees / HFX_DEGREES);
  turn->cosine = sin((turn_degrees + 90.0) / HFX_DEGREES);
  turn->raise_m *= way;
  turn->reach_m = HFX_NEAREST * size;
}

/* The place whose weight a place takes. */
static inline void hfx_turn_back(const hfx_turn *turn, const float *place, float *found) {
  const double x = place[turn->right] - turn->centre[turn->right];
  const double y = place[turn->ahead] - turn->centre[turn->ahead];
  const double up = (place[turn->up] - turn->middle_m - turn->raise_m) / turn->stretch;
  found[turn->right] = (float)(turn->centre[turn->right] + turn->cosine * x + turn->sine * y);
  found[turn->ahead] = (float)(turn->centre[turn->ahead] + turn->cosine * y - turn->sine * x);
  found[turn->up] = (float)(turn->middle_m + up);
}

/* Grows a box, of which `at[0]` to `at[2]` are the lowest and the rest the highest corner. */
static inline void hfx_grow_box(float *at, const hfx_rest *chunk, int i) {
  const float place[3] = {chunk->x[i], chunk->y[i], chunk->z[i]};
  int c;
  for (c = 0; c < 3; c++) {
    if (i == 0 || place[c] < at[c]) at[c] = place[c];
    if (i == 0 || place[c] > at[3 + c]) at[3 + c] = place[c];
  }
}

/* Square of the distance of a place from a box. */
static inline float hfx_box_distance(const float *at, const float *place) {
  float sum = 0.0f;
  int c;
  for (c = 0; c < 3; c++) {
    const float below = at[c] - place[c], above = place[c] - at[3 + c];
    const float away = below > 0.0f ? below : above > 0.0f ? above : 0.0f;
    sum += away * away;
  }
  return sum;
}

/* Lists the chunks of a model with vertices within twice a reach of a box, at rest, and the box of
 * each in its `away_m`. */
static inline uint32_t hfx_list_near(hfx_body *self, const hfx_rest *rest, uint32_t chunks,
                                     const double *low, const double *high, double reach_m) {
  uint32_t k, count = 0;
  for (k = 0; k < chunks; k++) {
    int i, is_near = 0;
    for (i = 0; i < HFX_CHUNK; i++) {
      hfx_grow_box(self->near[count].away_m, rest + k, i);
      is_near |= hfx_is_within(rest[k].x[i], low[0] - 2.0 * reach_m, high[0] + 2.0 * reach_m) &&
                 hfx_is_within(rest[k].y[i], low[1] - 2.0 * reach_m, high[1] + 2.0 * reach_m) &&
                 hfx_is_within(rest[k].z[i], low[2] - 2.0 * reach_m, high[2] + 2.0 * reach_m);
    }
    if (is_near) self->near[count++].chunk = k;
  }
  return count;
}

/* Weight of the vertex of the listed chunks that is nearest to a place; 0: none is within reach.
 * `start`: chunk of the list where the search begins, and the one that was found. */
static inline float hfx_nearest_weight(const hfx_body *self, const hfx_rest *rest, uint32_t count,
                                       const float *place, double reach_m, uint32_t *start) {
  float least = (float)(reach_m * reach_m), weight = 0.0f, away[HFX_CHUNK];
  uint32_t k, n = *start;
  int i;
  for (k = 0; k < count; k++, n = n + 1 < count ? n + 1 : 0) {
    const hfx_rest *chunk = rest + self->near[n].chunk;
    const float *weights = self->scratch + HFX_CHUNK * (size_t)self->near[n].chunk;
    if (hfx_box_distance(self->near[n].away_m, place) > least) continue;
    for (i = 0; i < HFX_CHUNK; i++) {
      const float x = chunk->x[i] - place[0], y = chunk->y[i] - place[1];
      const float z = chunk->z[i] - place[2];
      away[i] = x * x + y * y + z * z;
    }
    for (i = 0; i < HFX_CHUNK; i++)
      if (away[i] < least && weights[i] != HFX_NO_PAINT)
        least = away[i], weight = weights[i], *start = n;
  }
  return weight;
}

/* Sets the weights of a painted area, turned and raised. */
static inline void hfx_paint(hfx_body *self, hfx_felt *felt, double turn_degrees, double raise_m,
                             double stretch) {
  const uint32_t count = hfx_vertices_of(&self->clip, felt->model), chunks = hfx_chunk_count(count);
  const int is_placed = turn_degrees != 0.0 || raise_m != 0.0 || stretch != 1.0;
  const hfx_rest *rest = self->rest + felt->first_chunk;
  double low[3] = {0, 0, 0}, high[3] = {0, 0, 0};
  uint32_t k, listed = 0, start = 0;
  hfx_turn turn;
  int c, is_moved, is_any = 0;
  if (!count) return; /* of a model that the body does not have */
  is_moved = hfx_made_weights(self, felt, self->scratch) || is_placed;
  for (k = 0; k < count && is_moved; k++) {
    const hfx_rest *chunk = rest + k / HFX_CHUNK;
    const double place[3] = {chunk->x[k % HFX_CHUNK], chunk->y[k % HFX_CHUNK],
                             chunk->z[k % HFX_CHUNK]};
    if (!(self->scratch[k] > 0.0f)) continue;
    for (c = 0; c < 3; c++) {
      if (!is_any || place[c] < low[c]) low[c] = place[c];
      if (!is_any || place[c] > high[c]) high[c] = place[c];
    }
    is_any = 1;
  }
  turn.raise_m = raise_m;
  turn.stretch = stretch;
  hfx_find_axis(self, turn_degrees, &turn);
  turn.middle_m = 0.5 * (low[turn.up] + high[turn.up]);
  if (is_any) listed = hfx_list_near(self, rest, chunks, low, high, turn.reach_m);
  for (k = 0; k < chunks; k++) felt->peaks[k] = 0.0f;
  felt->chunk_bits = 0;
  for (k = 0; k < count; k++) {
    const hfx_rest *chunk = rest + k / HFX_CHUNK;
    const float place[3] = {chunk->x[k % HFX_CHUNK], chunk->y[k % HFX_CHUNK],
                            chunk->z[k % HFX_CHUNK]};
    float from[3], weight = self->scratch[k];
    int is_near = is_any;
    if (is_moved) {
      hfx_turn_back(&turn, place, from);
      for (c = 0; c < 3; c++)
        if (!hfx_is_within(from[c], low[c] - turn.reach_m, high[c] + turn.reach_m)) is_near = 0;
      weight = is_near ? hfx_nearest_weight(self, rest, listed, from, turn.reach_m, &start) : 0.0f;
    }
    felt->weights[k] = weight;
    if (weight > felt->peaks[k / HFX_CHUNK]) felt->peaks[k / HFX_CHUNK] = weight;
    if (weight > 0.0f) felt->chunk_bits |= (uint64_t)1 << k / HFX_CHUNK % 64;
  }
  felt->to = chunks;
  for (k = 0; k < count; k++) self->scratch[k] = 0.0f; /* for the next effect */
}

#ifdef __cplusplus
}
#endif

#endif
