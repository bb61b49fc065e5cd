/* SPDX-License-Identifier: MIT
 *
 * As much of Godot's extension interface (4.2 and later) as godot.c uses. */
#ifndef GDEXTENSION_H
#define GDEXTENSION_H

#include <stdint.h>

enum {
  TYPE_NIL = 0,
  TYPE_INT = 2,
  TYPE_FLOAT = 3,
  TYPE_TEXT = 4,
  TYPE_NAME = 21,
  TYPE_BYTES = 29,
  TYPE_FLOATS = 32
};
enum { CALL_OK = 0, CALL_WRONG_ARGUMENT = 2, CALL_TOO_MANY = 3, CALL_TOO_FEW = 4 };
enum { METHOD_NORMAL = 1, LEVEL_SCENE = 2, USAGE_DEFAULT = 6 };
#define HASH_SIZE 3173160232
#define HASH_RESIZE 848867239

typedef void (*gd_function)(void);
typedef gd_function (*gd_address)(const char *name);

typedef struct { /* opaque, as large as Godot's own in 64 bits: these three */
  uint64_t at[2];
} gd_array;
typedef struct {
  uint64_t at;
} gd_name;
typedef struct {
  uint64_t at;
} gd_text;

typedef struct {
  int32_t error, argument, expected;
} gd_call_error;

typedef struct {
  int32_t type;
  void *name, *class_name;
  uint32_t hint;
  void *hint_string;
  uint32_t usage;
} gd_property;

typedef void (*gd_method)(void *userdata, void *instance, const void *const *arguments, void *result);
typedef void (*gd_variant_method)(void *userdata, void *instance, const void *const *arguments,
                                  int64_t count, void *result, gd_call_error *error);

typedef struct {
  void *name, *userdata;
  gd_variant_method call;
  gd_method ptrcall;
  uint32_t flags;
  uint8_t has_result;
  gd_property *result;
  int32_t result_metadata;
  uint32_t argument_count;
  gd_property *arguments;
  int32_t *argument_metadata;
  uint32_t default_count;
  void **defaults;
} gd_method_info;

typedef struct {
  uint8_t is_virtual, is_abstract, is_exposed;
  void *set, *get, *list, *free_list, *can_revert, *get_revert, *validate, *notification;
  void *to_string, *reference, *unreference;
  void *(*create)(void *userdata);
  void (*destroy)(void *userdata, void *instance);
  void *recreate, *get_virtual, *get_virtual_data, *call_virtual, *get_rid, *userdata;
} gd_class_info;

typedef struct {
  int32_t minimum_level;
  void *userdata;
  void (*initialize)(void *userdata, int32_t level);
  void (*deinitialize)(void *userdata, int32_t level);
} gd_initialization;

#endif
