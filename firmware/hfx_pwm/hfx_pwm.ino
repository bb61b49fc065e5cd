/* SPDX-License-Identifier: GPL-3.0-or-later
 * HFX: motors on the PWM pins of an Arduino Uno, Nano or Mega, driven live over USB.
 *
 * Protocol: docs/wire-protocol.md. Never drive a motor from a pin directly: use a transistor
 * with a flyback diode, or a driver board, and a supply of its own.
 */
#include <avr/wdt.h>

#include "hfx_core.h"

/* The channels, in the order of the device's actuators. Change them to how yours is wired. */
#if defined(__AVR_ATmega2560__)
static const uint8_t PINS[] = {2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12};
#else
static const uint8_t PINS[] = {3, 5, 6, 9, 10, 11};
#endif
static const uint8_t CHANNELS = sizeof PINS;

/* Not cleared at a restart (each time that its port is opened, an Uno restarts): what was on for
 * long before it still has to rest. */
static hfx_core core __attribute__((section(".noinit")));
static uint8_t duty[sizeof PINS];

static void send(const uint8_t *bytes, uint8_t count)
{
    /* Replies are short and rare; one that finds no room is dropped rather than waited for. */
    if (Serial.availableForWrite() >= count)
        Serial.write(bytes, count);
}

void setup()
{
    MCUSR = 0;
    wdt_disable();
    for (uint8_t i = 0; i < CHANNELS; i++) {
        pinMode(PINS[i], OUTPUT);
        digitalWrite(PINS[i], LOW);
    }
    hfx_begin_again(&core, CHANNELS, send);
    Serial.begin(115200);
    wdt_enable(WDTO_250MS); /* a sketch that hangs is restarted, and starts silent */
}

void loop()
{
    wdt_reset();
    for (uint8_t taken = 0; taken < 64 && Serial.available(); taken++)
        hfx_receive(&core, (uint8_t)Serial.read(), millis());
    hfx_tick(&core, millis());
    for (uint8_t i = 0; i < CHANNELS; i++) {
        uint8_t wanted = (uint8_t)((core.levels[i] * 255UL + 32767UL) / 65535UL);
        if (wanted != duty[i]) {
            duty[i] = wanted;
            analogWrite(PINS[i], wanted);
        }
    }
}
