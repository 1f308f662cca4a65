/* The converter cycles through its three channels by itself, and the interlocks check every reading in its
 * interrupt: a hanging program cannot keep an output on. */
#include <avr/interrupt.h>
#include <util/atomic.h>

#include "board.h"

enum { PRESSURE, POSITION, TEMPERATURE, CHANNELS };

static volatile uint16_t reading[CHANNELS];
static volatile uint8_t rounds;
static uint8_t over[CHANNELS], open[CHANNELS];

static bool too_high(uint8_t channel, uint16_t counts) {
    return (channel == PRESSURE && counts >= PRESSURE_TRIP) ||
           (channel == TEMPERATURE && counts >= TEMPERATURE_TRIP);
}

static void count_to(uint8_t *counter, bool faulty) {
    if (!faulty)
        *counter = 0;
    else if (*counter < TRIP_READINGS)
        ++*counter;
}

static uint8_t cause_of(uint8_t channel) {
    if (open[channel] >= TRIP_READINGS) /* the reading of a broken wire is not a pressure */
        return TRIP_SENSOR;
    if (over[channel] >= TRIP_READINGS)
        return channel == PRESSURE ? TRIP_PRESSURE : TRIP_TEMPERATURE;
    return 0;
}

ISR(ADC_vect) {
    static uint8_t channel;
    uint16_t counts = ADC;
    reading[channel] = counts;
    count_to(&over[channel], too_high(channel, counts));
    count_to(&open[channel], (SENSORS & _BV(channel)) && (counts < OPEN_LOW || counts > OPEN_HIGH));
    uint8_t cause = cause_of(channel);
    if (cause && !(trips() & cause))
        trip(cause);
    if (++channel == CHANNELS) {
        channel = 0;
        if (rounds < 2)
            rounds++;
    }
    ADMUX = _BV(REFS0) | channel;
    ADCSRA |= _BV(ADSC);
}

/* Returns after the first reading of every channel; interrupts must be on. */
void inputs_start(void) {
    ADMUX = _BV(REFS0);
    ADCSRA = _BV(ADEN) | _BV(ADIE) | _BV(ADPS2) | _BV(ADPS1) | _BV(ADPS0);
    ADCSRA |= _BV(ADSC);
    while (rounds < 1) {
    }
}

uint16_t input(uint8_t channel) {
    uint16_t counts;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { counts = reading[channel]; }
    return counts;
}

uint8_t inputs_faulty(void) {
    uint8_t causes = 0;
    for (uint8_t channel = 0; channel < CHANNELS; channel++)
        causes |= cause_of(channel);
    return causes;
}
