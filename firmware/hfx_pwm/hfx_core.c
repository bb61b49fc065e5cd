/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "hfx_core.h"

#include <string.h>

enum { CONFIGURE = 0x01, VALUES = 0x02, STOP = 0x03, READY = 0x81, STOPPED = 0x83 };
enum { ASKED = 0, NO_VALUES = 1, REFUSED = 2 };

#define KNOWN 0x48465831UL /* "HFX1" */

#define HEAD 4
#define CRC 4

static uint32_t crc32(const uint8_t *bytes, uint8_t count)
{
    uint32_t crc = 0xFFFFFFFFUL;
    for (uint8_t i = 0; i < count; i++) {
        crc ^= bytes[i];
        for (uint8_t bit = 0; bit < 8; bit++)
            crc = (crc >> 1) ^ (0xEDB88320UL & (uint32_t)(-(int32_t)(crc & 1)));
    }
    return ~crc;
}

static uint16_t read16(const uint8_t *at)
{
    return (uint16_t)(at[0] | ((uint16_t)at[1] << 8));
}

static uint32_t read32(const uint8_t *at)
{
    return (uint32_t)read16(at) | ((uint32_t)read16(at + 2) << 16);
}

static void write32(uint8_t *at, uint32_t value)
{
    for (uint8_t i = 0; i < 4; i++)
        at[i] = (uint8_t)(value >> (8 * i));
}

/* Undo COBS in place; 0: not a frame. The result is never longer than what came. */
static uint8_t unstuff(uint8_t *bytes, uint8_t count)
{
    uint8_t in = 0, out = 0;
    while (in < count) {
        uint8_t length = bytes[in];
        if (length == 0 || (uint16_t)in + length > count)
            return 0;
        in++;
        for (uint8_t i = 1; i < length; i++)
            bytes[out++] = bytes[in++];
        if (length < 255 && in < count)
            bytes[out++] = 0;
    }
    return out;
}

static void reply(hfx_core *core, uint8_t kind, uint16_t sequence, const uint8_t *payload,
                  uint8_t count)
{
    uint8_t plain[HEAD + 8 + CRC];
    uint8_t sent[sizeof plain + 2];
    uint8_t size = (uint8_t)(HEAD + count);
    plain[0] = HFX_VERSION;
    plain[1] = kind;
    plain[2] = (uint8_t)sequence;
    plain[3] = (uint8_t)(sequence >> 8);
    memcpy(plain + HEAD, payload, count);
    write32(plain + size, crc32(plain, size));
    size += CRC;
    uint8_t code = 0, out = 1, length = 1; /* frames are short: no block is full */
    for (uint8_t i = 0; i < size; i++) {
        if (plain[i]) {
            sent[out++] = plain[i];
            length++;
        } else {
            sent[code] = length;
            code = out++;
            length = 1;
        }
    }
    sent[code] = length;
    sent[out++] = 0;
    core->write(sent, out);
}

static uint32_t check_of(const hfx_core *core)
{
    uint32_t sum = KNOWN;
    for (uint8_t i = 0; i < HFX_MAX_CHANNELS; i++)
        sum = ((sum << 1) | (sum >> 31)) ^ core->filled[i] ^ core->is_resting[i];
    return sum;
}

/* Rates at which accounts fill and empty. Rounded so that a channel is rather on for less, never more. */
static void limit(hfx_core *core, uint32_t most_on_ms, uint32_t rest_ms)
{
    uint32_t on_ms = most_on_ms && most_on_ms < HFX_MAX_ON_MS ? most_on_ms : HFX_MAX_ON_MS;
    if (most_on_ms == 0 || rest_ms == 0)
        rest_ms = HFX_REST_MS;
    else /* shorter in the same proportion, but never in a smaller one than our own */
        rest_ms = (uint32_t)(((uint64_t)rest_ms * on_ms + most_on_ms - 1) / most_on_ms);
    uint32_t least_ms =
        (uint32_t)(((uint64_t)on_ms * HFX_REST_MS + HFX_MAX_ON_MS - 1) / HFX_MAX_ON_MS);
    if (rest_ms < least_ms)
        rest_ms = least_ms;
    core->fills_per_ms = (HFX_FULL + on_ms - 1) / on_ms;
    core->empties_per_ms = HFX_FULL / rest_ms;
    if (core->empties_per_ms == 0)
        core->empties_per_ms = 1;
}

/* Rest of an amount of HFX_FULL at most, at least 0. */
static uint32_t less(uint32_t amount, uint32_t passed_ms, uint32_t per_ms)
{
    if (passed_ms > 2 && passed_ms > amount / per_ms) /* the product might not fit; a board */
        return 0;                                     /* that is quick divides nothing */
    uint32_t gone = passed_ms * per_ms;
    return gone < amount ? amount - gone : 0;
}

/* Bring the accounts up to date: what the pins did since the last time. */
static void settle(hfx_core *core, uint32_t now_ms)
{
    uint32_t passed_ms = now_ms - core->settled_ms;
    if (passed_ms == 0)
        return;
    core->settled_ms = now_ms;
    for (uint8_t i = 0; i < HFX_MAX_CHANNELS; i++) {
        uint32_t filled = core->filled[i];
        if (core->levels[i])
            filled = HFX_FULL - less(HFX_FULL - filled, passed_ms, core->fills_per_ms);
        else if (filled)
            filled = less(filled, passed_ms, core->empties_per_ms);
        core->filled[i] = filled;
        if (filled >= HFX_FULL)
            core->is_resting[i] = true;
        else if (filled == 0)
            core->is_resting[i] = false;
    }
    core->check = check_of(core);
}

static void silence(hfx_core *core)
{
    memset(core->levels, 0, sizeof core->levels);
    memset(core->asked, 0, sizeof core->asked);
}

static void disarm(hfx_core *core, uint8_t reason, uint16_t sequence)
{
    silence(core);
    core->is_armed = false;
    reply(core, STOPPED, sequence, &reason, 1);
}

static void configure(hfx_core *core, const uint8_t *payload, uint8_t count, uint16_t sequence,
                      uint32_t now_ms)
{
    if (count != 11 && count != 15)
        return;
    uint32_t crc = crc32(payload, count);
    silence(core);
    core->used = payload[4];
    uint32_t dead_man = read16(payload + 5);
    core->dead_man_ms = dead_man && dead_man < HFX_DEAD_MAN_MS ? dead_man : HFX_DEAD_MAN_MS;
    limit(core, read32(payload + 7), count == 15 ? read32(payload + 11) : 0);
    core->configuration = crc;
    core->is_armed = core->used >= 1 && core->used <= core->channels;
    core->has_sequence = false;
    core->heard_ms = now_ms;
    core->live_ms = 0;
    uint8_t answer[5];
    write32(answer, crc);
    answer[4] = core->channels;
    reply(core, READY, sequence, answer, sizeof answer);
}

static void take_values(hfx_core *core, const uint8_t *payload, uint8_t count, uint16_t sequence,
                        uint32_t now_ms)
{
    if (!core->is_armed || count < 6 || read32(payload) != core->configuration) {
        disarm(core, REFUSED, sequence);
        return;
    }
    if (count != 6 + 2 * core->used)
        return;
    if (core->has_sequence && (int16_t)(sequence - core->sequence) <= 0)
        return; /* older than what is played */
    core->has_sequence = true;
    core->sequence = sequence;
    core->heard_ms = now_ms;
    core->live_ms = read16(payload + 4);
    for (uint8_t i = 0; i < core->used; i++)
        core->asked[i] = read16(payload + 6 + 2 * i);
    hfx_tick(core, now_ms);
}

static void understand(hfx_core *core, uint32_t now_ms)
{
    settle(core, now_ms); /* before anything changes */
    uint8_t *bytes = core->received;
    uint8_t size = unstuff(bytes, core->count);
    if (size < HEAD + CRC || bytes[0] != HFX_VERSION)
        return;
    if (crc32(bytes, (uint8_t)(size - CRC)) != read32(bytes + size - CRC))
        return;
    uint16_t sequence = read16(bytes + 2);
    const uint8_t *payload = bytes + HEAD;
    uint8_t count = (uint8_t)(size - HEAD - CRC);
    if (bytes[1] == STOP)
        disarm(core, ASKED, sequence);
    else if (bytes[1] == CONFIGURE)
        configure(core, payload, count, sequence, now_ms);
    else if (bytes[1] == VALUES)
        take_values(core, payload, count, sequence, now_ms);
}

void hfx_begin(hfx_core *core, uint8_t channels, hfx_write_fn write)
{
    memset(core, 0, sizeof *core);
    core->channels = channels <= HFX_MAX_CHANNELS ? channels : HFX_MAX_CHANNELS;
    core->write = write;
    limit(core, 0, 0);
    core->check = check_of(core);
}

void hfx_begin_again(hfx_core *core, uint8_t channels, hfx_write_fn write)
{
    uint32_t filled[HFX_MAX_CHANNELS];
    uint8_t is_resting[HFX_MAX_CHANNELS];
    bool is_known = core->check == check_of(core);
    memcpy(filled, core->filled, sizeof filled);
    memcpy(is_resting, core->is_resting, sizeof is_resting);
    hfx_begin(core, channels, write);
    if (!is_known)
        return; /* the power was off: what memory holds is chance */
    for (uint8_t i = 0; i < HFX_MAX_CHANNELS; i++) {
        core->filled[i] = filled[i] <= HFX_FULL ? filled[i] : HFX_FULL;
        core->is_resting[i] = is_resting[i] != 0;
    }
    core->check = check_of(core);
}

void hfx_receive(hfx_core *core, uint8_t byte, uint32_t now_ms)
{
    if (byte == 0) {
        if (!core->is_skipping && core->count)
            understand(core, now_ms);
        core->count = 0;
        core->is_skipping = false;
    } else if (core->count >= HFX_MAX_FRAME) {
        core->is_skipping = true;
    } else {
        core->received[core->count++] = byte;
    }
}

void hfx_tick(hfx_core *core, uint32_t now_ms)
{
    settle(core, now_ms);
    if (!core->is_armed)
        return;
    uint32_t silent_ms = now_ms - core->heard_ms;
    if (silent_ms >= core->dead_man_ms) {
        disarm(core, NO_VALUES, core->sequence);
        return;
    }
    bool is_live = silent_ms < core->live_ms;
    for (uint8_t i = 0; i < core->used; i++)
        core->levels[i] = is_live && !core->is_resting[i] ? core->asked[i] : 0;
}
