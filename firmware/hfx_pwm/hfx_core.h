/* SPDX-License-Identifier: GPL-3.0-or-later
 * The board's side of our protocol (docs/wire-protocol.md): plain C, no hardware, no heap.
 * The sketch hands in bytes and the time, and sets the levels that come out.
 */
#ifndef HFX_CORE_H
#define HFX_CORE_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define HFX_VERSION 1
#define HFX_MAX_CHANNELS 32
#define HFX_MAX_FRAME 96
#define HFX_DEAD_MAN_MS 250UL
/* Longest time that a channel is on without a rest, and how long it rests when it was on for so
 * long: whatever the host allows. */
#ifndef HFX_MAX_ON_MS
#define HFX_MAX_ON_MS 30000UL
#endif
#ifndef HFX_REST_MS
#define HFX_REST_MS 2000UL
#endif

typedef void (*hfx_write_fn)(const uint8_t *bytes, uint8_t count);

typedef struct {
    uint8_t channels; /* of the board */
    hfx_write_fn write;
    uint16_t levels[HFX_MAX_CHANNELS]; /* what the pins are to get, 0..65535 */

    uint8_t received[HFX_MAX_FRAME];
    uint8_t count;
    bool is_skipping;

    bool is_armed;
    uint32_t configuration; /* CRC-32 of the configuration in force */
    uint8_t used;           /* channels of it */
    uint32_t dead_man_ms;
    bool has_sequence;
    uint16_t sequence;
    uint32_t heard_ms;
    uint32_t live_ms;
    uint16_t asked[HFX_MAX_CHANNELS];

    /* Accounts of time on: being on fills them, nothing but rest empties them. */
    uint32_t filled[HFX_MAX_CHANNELS]; /* HFX_FULL is full */
    uint8_t is_resting[HFX_MAX_CHANNELS]; /* until it is empty */
    uint32_t settled_ms;                  /* when they were brought up to date */
    uint32_t fills_per_ms, empties_per_ms;
    uint32_t check; /* whether they are still what they were, after a restart */
} hfx_core;

#define HFX_FULL (1UL << 30)

/* Begin, as after the power came on: every account is empty. */
void hfx_begin(hfx_core *core, uint8_t channels, hfx_write_fn write);
/* Begin after a restart, with accounts of before if memory still holds them. */
void hfx_begin_again(hfx_core *core, uint8_t channels, hfx_write_fn write);
/* Take one byte from the host. */
void hfx_receive(hfx_core *core, uint8_t byte, uint32_t now_ms);
/* Call often: applies time to live, dead-man and longest time on. */
void hfx_tick(hfx_core *core, uint32_t now_ms);

#ifdef __cplusplus
}
#endif
#endif
