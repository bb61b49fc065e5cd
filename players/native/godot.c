/* SPDX-License-Identifier: MIT
 *
 * Godot's door to the core: the class HapticBodyCore, which haptic_body.gd uses. */
#include "gdextension.h"
#include "live_body.h"

#include <stdlib.h>
#include <string.h>

typedef struct {
  hfx_live_body *body;
} core;

typedef struct {
  const char *name;
  gd_method run;
  int32_t result, arguments[4];
  uint32_t count;
} method;

static struct {
  void *library;
  void (*name_new)(void *result, const char *text, uint8_t is_static);
  void (*name_destroy)(void *name);
  void (*text_new)(void *result, const char *text);
  void (*text_destroy)(void *text);
  void *(*construct)(const void *class_name);
  void (*set_instance)(void *object, const void *class_name, void *instance);
  const uint8_t *(*byte_at)(const void *array, int64_t index);
  float *(*float_at)(void *array, int64_t index);
  const float *(*const_float_at)(const void *array, int64_t index);
  int32_t (*type_of)(const void *variant);
  void (*from_type[40])(void *variant, void *value);
  void (*to_type[40])(void *value, void *variant);
  void (*destroy[40])(void *value);
  void (*new_floats)(void *array, const void *const *arguments);
  void (*resize)(void *array, const void *const *arguments, void *result, int32_t count);
  void (*size[40])(void *array, const void *const *arguments, void *result, int32_t count);
  void (*add_class)(void *library, const void *name, const void *parent, const gd_class_info *info);
  void (*add_method)(void *library, const void *class_name, const gd_method_info *info);
  void (*remove_class)(void *library, const void *name);
} gd;

static const int32_t TYPES[] = {TYPE_INT, TYPE_FLOAT, TYPE_BYTES, TYPE_FLOATS};
static gd_name class_name;

static uint32_t size_of(int32_t type, const void *array) {
  int64_t size = 0;
  gd.size[type]((void *)array, NULL, &size, 0);
  return size > 0 && size < 0x7FFFFFFF ? (uint32_t)size : 0;
}

/* The floats of an array, and how many there are. */
static const float *floats_of(const void *array, uint32_t *count) {
  *count = size_of(TYPE_FLOATS, array);
  return *count ? gd.const_float_at(array, 0) : NULL;
}

/* Makes an array as long as this; its floats, NULL where it has none. */
static float *resized(void *array, uint32_t count) {
  const int64_t size = count;
  const void *arguments[1] = {&size};
  int64_t error = 0;
  gd.resize(array, arguments, &error, 1);
  return count && size_of(TYPE_FLOATS, array) == count ? gd.float_at(array, 0) : NULL;
}

static uint32_t number_at(const void *argument) { /* below 0 and too much: nothing has this number */
  const int64_t number = *(const int64_t *)argument;
  return number >= 0 && number < 0x7FFFFFFF ? (uint32_t)number : 0x7FFFFFFFu;
}

#define RUN(name) \
  static void name(void *userdata, void *instance, const void *const *arguments, void *result)
#define BODY (((core *)instance)->body)

/* open(bytes: PackedByteArray, body: int, effects: PackedByteArray) -> int: 0, or a reason below
 * it; effects: bytes of the clip that has them, empty for the same. */
RUN(run_open) {
  const uint32_t size = size_of(TYPE_BYTES, arguments[0]);
  const uint32_t effects = size_of(TYPE_BYTES, arguments[2]);
  int32_t error = 0;
  (void)userdata;
  hfx_live_close(BODY);
  BODY = hfx_live_open_effects(size ? gd.byte_at(arguments[0], 0) : NULL, size,
                               number_at(arguments[1]),
                               effects ? gd.byte_at(arguments[2], 0) : NULL, effects, &error);
  *(int64_t *)result = error;
}

/* set_bones(matrices: PackedFloat32Array) -> int: 12 numbers for each bone */
RUN(run_set_bones) {
  uint32_t count;
  const float *matrices = floats_of(arguments[0], &count);
  (void)userdata;
  *(int64_t *)result = hfx_live_set_bones(BODY, matrices, count);
}

/* set_volume(effect: int, matrix: PackedFloat32Array) -> int */
RUN(run_set_volume) {
  uint32_t count;
  const float *matrix = floats_of(arguments[1], &count);
  (void)userdata;
  *(int64_t *)result = hfx_live_set_volume(BODY, number_at(arguments[0]), matrix, count);
}

/* set_parameter(effect: int, parameter: int, value: float) -> int */
RUN(run_set_parameter) {
  (void)userdata;
  *(int64_t *)result = hfx_live_set_parameter(BODY, number_at(arguments[0]), number_at(arguments[1]),
                                              *(const double *)arguments[2]);
}

/* trigger(effect: int, level: float) -> int */
RUN(run_trigger) {
  (void)userdata;
  *(int64_t *)result =
      hfx_live_trigger(BODY, number_at(arguments[0]), *(const double *)arguments[1]);
}

/* place(effect: int, turn_degrees: float, raise_m: float, stretch: float) -> int: a painted area */
RUN(run_place) {
  (void)userdata;
  *(int64_t *)result =
      hfx_live_place(BODY, number_at(arguments[0]), *(const double *)arguments[1],
                     *(const double *)arguments[2], *(const double *)arguments[3]);
}

/* add_volume(effect: int) -> int: its number, or a reason below 0 */
RUN(run_add_volume) {
  (void)userdata;
  *(int64_t *)result = hfx_live_add_volume(BODY, number_at(arguments[0]));
}

/* remove_volume(number: int) -> int */
RUN(run_remove_volume) {
  (void)userdata;
  *(int64_t *)result = hfx_live_remove_volume(BODY, number_at(arguments[0]));
}

/* moves_skin(bone: int) -> int: 1 or 0 */
RUN(run_moves_skin) {
  (void)userdata;
  *(int64_t *)result = hfx_live_moves_skin(BODY, number_at(arguments[0]));
}

/* evaluate(seconds: float) -> PackedFloat32Array: all columns, as of hfx_player_advance */
RUN(run_evaluate) {
  const uint32_t count = hfx_live_columns(BODY);
  float *out = resized(result, count);
  (void)userdata;
  hfx_live_evaluate(BODY, *(const double *)arguments[0], out, count);
}

/* get_weights(effect: int) -> PackedFloat32Array: of the last evaluation */
RUN(run_get_weights) {
  const uint32_t effect = number_at(arguments[0]), count = hfx_live_weights(BODY, effect, NULL, 0);
  (void)userdata;
  hfx_live_weights(BODY, effect, resized(result, count), count);
}

/* get_level(effect: int) -> float: of the last evaluation, with the response to the touch */
RUN(run_get_level) {
  (void)userdata;
  *(double *)result = hfx_live_level(BODY, number_at(arguments[0]));
}

static const method METHODS[] = {
    {"open", run_open, TYPE_INT, {TYPE_BYTES, TYPE_INT, TYPE_BYTES}, 3},
    {"set_bones", run_set_bones, TYPE_INT, {TYPE_FLOATS}, 1},
    {"set_volume", run_set_volume, TYPE_INT, {TYPE_INT, TYPE_FLOATS}, 2},
    {"set_parameter", run_set_parameter, TYPE_INT, {TYPE_INT, TYPE_INT, TYPE_FLOAT}, 3},
    {"trigger", run_trigger, TYPE_INT, {TYPE_INT, TYPE_FLOAT}, 2},
    {"place", run_place, TYPE_INT, {TYPE_INT, TYPE_FLOAT, TYPE_FLOAT, TYPE_FLOAT}, 4},
    {"add_volume", run_add_volume, TYPE_INT, {TYPE_INT}, 1},
    {"remove_volume", run_remove_volume, TYPE_INT, {TYPE_INT}, 1},
    {"moves_skin", run_moves_skin, TYPE_INT, {TYPE_INT}, 1},
    {"evaluate", run_evaluate, TYPE_FLOATS, {TYPE_FLOAT}, 1},
    {"get_weights", run_get_weights, TYPE_FLOATS, {TYPE_INT}, 1},
    {"get_level", run_get_level, TYPE_FLOAT, {TYPE_INT}, 1},
};

typedef union {
  int64_t whole;
  double real;
  gd_array array;
} value;

static int is_number(int32_t type) { return type == TYPE_INT || type == TYPE_FLOAT; }

/* A variant as a type; Godot converts nothing here: 0 and 1 for a level are whole numbers. */
static int taken(int32_t type, const void *variant, value *found) {
  const int32_t given = gd.type_of(variant);
  if (given != type && !(is_number(given) && is_number(type))) return 0;
  gd.to_type[given](found, (void *)variant);
  if (given == TYPE_INT && type == TYPE_FLOAT) found->real = (double)found->whole;
  if (given == TYPE_FLOAT && type == TYPE_INT)
    found->whole = found->real >= 0.0 && found->real < 1e9 ? (int64_t)found->real : -1;
  return 1;
}

static void drop(int32_t type, value *each) {
  if (gd.destroy[type]) gd.destroy[type](each);
}

/* A call with variants, as GDScript without types makes it. */
static void call(void *userdata, void *instance, const void *const *arguments, int64_t count,
                 void *result, gd_call_error *error) {
  const method *one = (const method *)userdata;
  value values[4], found;
  const void *pointers[4];
  uint32_t k = 0;
  if (count != (int64_t)one->count) {
    error->error = count < (int64_t)one->count ? CALL_TOO_FEW : CALL_TOO_MANY;
    error->expected = (int32_t)one->count;
    return;
  }
  for (; k < one->count && taken(one->arguments[k], arguments[k], &values[k]); k++)
    pointers[k] = &values[k];
  error->error = k < one->count ? CALL_WRONG_ARGUMENT : CALL_OK;
  error->argument = (int32_t)k;
  error->expected = k < one->count ? one->arguments[k] : 0;
  if (k == one->count) {
    if (one->result == TYPE_FLOATS) gd.new_floats(&found, NULL);
    one->run(NULL, instance, pointers, &found);
    gd.from_type[one->result](result, &found);
    drop(one->result, &found);
  }
  while (k--) drop(one->arguments[k], &values[k]);
}

/* A call with values; Godot gives no place for a result that nobody takes. */
static void call_typed(void *userdata, void *instance, const void *const *arguments, void *result) {
  const method *one = (const method *)userdata;
  value unused;
  if (!result && one->result == TYPE_FLOATS) gd.new_floats(&unused, NULL);
  one->run(NULL, instance, arguments, result ? result : &unused);
  if (!result) drop(one->result, &unused);
}

static void *create(void *userdata) {
  gd_name parent;
  void *object, *self = calloc(1, sizeof(core));
  (void)userdata;
  gd.name_new(&parent, "RefCounted", 0);
  object = gd.construct(&parent);
  gd.name_destroy(&parent);
  gd.set_instance(object, &class_name, self);
  return object;
}

static void destroy(void *userdata, void *instance) {
  (void)userdata;
  if (instance) hfx_live_close(BODY);
  free(instance);
}

static void register_method(const method *one) {
  gd_name name, empty;
  gd_text no_text;
  gd_property properties[5];
  int32_t metadata[4] = {0, 0, 0, 0};
  gd_method_info info;
  uint32_t k;
  memset(&info, 0, sizeof info);
  memset(properties, 0, sizeof properties);
  gd.name_new(&name, one->name, 0);
  gd.name_new(&empty, "", 0);
  gd.text_new(&no_text, "");
  for (k = 0; k <= one->count; k++) {
    properties[k].type = k ? one->arguments[k - 1] : one->result;
    properties[k].name = properties[k].class_name = &empty;
    properties[k].hint_string = &no_text;
    properties[k].usage = USAGE_DEFAULT;
  }
  info.name = &name;
  info.userdata = (void *)one;
  info.call = call;
  info.ptrcall = call_typed;
  info.flags = METHOD_NORMAL;
  info.has_result = 1;
  info.result = &properties[0];
  info.argument_count = one->count;
  info.arguments = &properties[1];
  info.argument_metadata = metadata;
  gd.add_method(gd.library, &class_name, &info);
  gd.text_destroy(&no_text);
  gd.name_destroy(&empty);
  gd.name_destroy(&name);
}

static void initialize(void *userdata, int32_t level) {
  gd_class_info info;
  gd_name parent;
  size_t k;
  (void)userdata;
  if (level != LEVEL_SCENE) return;
  memset(&info, 0, sizeof info);
  info.is_exposed = 1;
  info.create = create;
  info.destroy = destroy;
  gd.name_new(&class_name, "HapticBodyCore", 0);
  gd.name_new(&parent, "RefCounted", 0);
  gd.add_class(gd.library, &class_name, &parent, &info);
  gd.name_destroy(&parent);
  for (k = 0; k < sizeof METHODS / sizeof *METHODS; k++) register_method(&METHODS[k]);
}

static void deinitialize(void *userdata, int32_t level) {
  (void)userdata;
  if (level != LEVEL_SCENE) return;
  gd.remove_class(gd.library, &class_name);
  gd.name_destroy(&class_name);
}

/* Sets a pointer to what Godot names so; a pointer to data holds one to a function, as in POSIX. */
static int find(gd_address found, const char *name, void *target) {
  const gd_function function = found(name);
  memcpy(target, &function, sizeof function);
  return function != NULL;
}

HFX_EXPORT uint8_t hfx_haptics_begin(gd_address found, void *library, gd_initialization *how);
HFX_EXPORT uint8_t hfx_haptics_begin(gd_address found, void *library, gd_initialization *how) {
  gd_function (*from)(int32_t), (*to)(int32_t), (*destructor)(int32_t);
  gd_function (*constructor)(int32_t, int32_t), (*builtin)(int32_t, const void *, int64_t), one;
  gd_name size, resize;
  int all = 1, k;
  all &= find(found, "string_name_new_with_latin1_chars", &gd.name_new);
  all &= find(found, "string_new_with_utf8_chars", &gd.text_new);
  all &= find(found, "classdb_construct_object", &gd.construct);
  all &= find(found, "object_set_instance", &gd.set_instance);
  all &= find(found, "packed_byte_array_operator_index_const", &gd.byte_at);
  all &= find(found, "packed_float32_array_operator_index", &gd.float_at);
  all &= find(found, "packed_float32_array_operator_index_const", &gd.const_float_at);
  all &= find(found, "variant_get_type", &gd.type_of);
  all &= find(found, "classdb_register_extension_class2", &gd.add_class);
  all &= find(found, "classdb_register_extension_class_method", &gd.add_method);
  all &= find(found, "classdb_unregister_extension_class", &gd.remove_class);
  all &= find(found, "get_variant_from_type_constructor", &from);
  all &= find(found, "get_variant_to_type_constructor", &to);
  all &= find(found, "variant_get_ptr_destructor", &destructor);
  all &= find(found, "variant_get_ptr_constructor", &constructor);
  all &= find(found, "variant_get_ptr_builtin_method", &builtin);
  if (!all) return 0;
#define KEEP(target, function) (one = (function), memcpy(&(target), &one, sizeof one))
  KEEP(gd.name_destroy, destructor(TYPE_NAME));
  KEEP(gd.text_destroy, destructor(TYPE_TEXT));
  gd.name_new(&size, "size", 0);
  gd.name_new(&resize, "resize", 0);
  for (k = 0; k < 4; k++) {
    const int32_t type = TYPES[k];
    KEEP(gd.from_type[type], from(type));
    KEEP(gd.to_type[type], to(type));
    KEEP(gd.destroy[type], destructor(type));
    if (type >= TYPE_BYTES) KEEP(gd.size[type], builtin(type, &size, HASH_SIZE));
  }
  KEEP(gd.new_floats, constructor(TYPE_FLOATS, 0));
  KEEP(gd.resize, builtin(TYPE_FLOATS, &resize, HASH_RESIZE));
  gd.name_destroy(&size);
  gd.name_destroy(&resize);
  if (!gd.resize || !gd.size[TYPE_FLOATS] || !gd.size[TYPE_BYTES]) return 0;
  gd.library = library;
  how->minimum_level = LEVEL_SCENE;
  how->initialize = initialize;
  how->deinitialize = deinitialize;
  return 1;
}
