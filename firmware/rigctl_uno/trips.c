/* Trips: outputs off at once, the cause latched, through any reset but a lost supply, until cleared on purpose. */
#include <avr/pgmspace.h>
#include <avr/wdt.h>
#include <util/atomic.h>

#include "board.h"

#define REGISTER_BEFORE_MAIN __attribute__((naked, used, section(".init3")))

/* Not cleared at start-up: the complement shows whether the memory has kept its content. */
static uint8_t latched __attribute__((section(".noinit")));
static uint8_t complement __attribute__((section(".noinit")));
static uint8_t reset_cause __attribute__((section(".noinit")));

static volatile uint16_t host_ms;       /* since the last command of the host */

/* The watchdog goes on after its reset with its shortest time, so it is stopped first of all. The Uno's boot
 * loader has cleared MCUSR by then and hands it on in r2. */
void keep_reset_cause(void) REGISTER_BEFORE_MAIN;
void keep_reset_cause(void) {
    uint8_t handed_on;
    __asm__ volatile("mov %0, r2" : "=r"(handed_on));
    reset_cause = MCUSR ? MCUSR : handed_on;
    MCUSR = 0;
    wdt_disable();
}

static void latch(uint8_t cause) {
    latched |= cause;
    complement = ~latched;
}

void trips_start(void) {
    if ((latched ^ complement) != 0xFF) {
        latched = 0;
        complement = 0xFF;
    }
    if ((reset_cause & _BV(WDRF)) && !(reset_cause & _BV(PORF)))
        trip(TRIP_MCU);
}

void trip(uint8_t cause) {
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        outputs_off();
        if (!(latched & cause)) {
            latch(cause);
            event_add(micros(), 'T', latched);
            error_add(100 + __builtin_ctz(cause));
        }
    }
}

uint8_t trips(void) { return latched; }

bool trips_clear(void) {
    bool cleared = false;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        if (!inputs_faulty()) {
            latched = 0;
            complement = 0xFF;
            cleared = true;
            event_add(micros(), 'T', 0);
        }
    }
    return cleared;
}

const char *trip_text(uint8_t bit) {
    switch (bit) {
    case 0: return PSTR("over-temperature");
    case 1: return PSTR("over-pressure");
    case 2: return PSTR("host silent");
    case 3: return PSTR("restarted by the MCU watchdog");
    case 4: return PSTR("sensor open or shorted");
    default: return PSTR("heater on for too long");
    }
}

void host_spoke(void) {
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { host_ms = 0; }
}

void host_tick(void) {
    if (!outputs_active())
        return;
    if (host_ms >= HOST_TIMEOUT_MS)
        trip(TRIP_HOST);
    else
        host_ms++;
}
