/* Timer 0: 4 us counts, a millisecond interrupt (compare A), and a one-shot inside a millisecond (compare B). */
#include <avr/interrupt.h>
#include <util/atomic.h>

#include "board.h"

static volatile uint32_t ticks;

ISR(TIMER0_COMPA_vect) {
    ticks++;
    outputs_tick();
    host_tick();
}

ISR(TIMER0_COMPB_vect) {
    clock_disarm();
    pulse_due();
}

void clock_start(void) {
    TCCR0A = _BV(WGM01); /* also resets settings of an Arduino core */
    OCR0A = 249;
    TCCR0B = _BV(CS01) | _BV(CS00);
    TIMSK0 = _BV(OCIE0A);
}

/* From an interrupt only. A count that has almost passed is handled at once. */
void clock_arm(uint8_t count) {
    if (count <= TCNT0 + 2) {
        while (TCNT0 < count) {
        }
        pulse_due();
        return;
    }
    OCR0B = count;
    TIFR0 = _BV(OCF0B);
    TIMSK0 |= _BV(OCIE0B);
}

void clock_disarm(void) { TIMSK0 &= ~_BV(OCIE0B); }

uint32_t millis(void) {
    uint32_t now;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { now = ticks; }
    return now;
}

uint32_t micros(void) {
    uint32_t ms;
    uint8_t count;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        count = TCNT0;
        ms = ticks;
        if ((TIFR0 & _BV(OCF0A)) && count < 249) /* the millisecond is over, but its interrupt is pending */
            ms++;
    }
    return ms * 1000UL + (uint16_t)count * 4U;
}
