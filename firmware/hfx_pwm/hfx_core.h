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
/* Longest time that a channel is on without a moment of silence, whatever the host allows. */
#ifndef HFX_MAX_ON_MS
#define HFX_MAX_ON_MS 30000UL
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
    uint32_t most_on_ms;
    bool has_sequence;
    uint16_t sequence;
    uint32_t heard_ms;
    uint32_t live_ms;
    uint16_t asked[HFX_MAX_CHANNELS];
    uint32_t on_since_ms[HFX_MAX_CHANNELS];
    uint8_t state[HFX_MAX_CHANNELS]; /* off, on, or held off until asked for silence */
} hfx_core;

void hfx_begin(hfx_core *core, uint8_t channels, hfx_write_fn write);
/* Take one byte from the host. */
void hfx_receive(hfx_core *core, uint8_t byte, uint32_t now_ms);
/* Call often: applies time to live, dead-man and longest time on. */
void hfx_tick(hfx_core *core, uint32_t now_ms);

#ifdef __cplusplus
}
#endif
#endif
