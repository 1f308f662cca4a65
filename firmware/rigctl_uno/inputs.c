/* The converter cycles through its three channels by itself, and the interlocks check every reading in its
 * interrupt: a hanging program cannot keep an output on. */
#include <avr/interrupt.h>
#include <util/atomic.h>

#include "board.h"

/* Each fault has a counter that a faulty reading raises by WEIGHT and a good one lowers by 1, so that good readings in
 * between, as a loose contact gives them, do not hide it: it trips from a share of 1 / (WEIGHT + 1) on, in the end, and
 * after TRIP_READINGS faulty ones in a row. */
enum { WEIGHT = 3, TRIPS = WEIGHT * TRIP_READINGS, LASTS = TRIPS / 3 };
_Static_assert(TRIPS + WEIGHT <= 255, "TRIP_READINGS: at most 84");

enum { PRESSURE, POSITION, TEMPERATURE, CHANNELS };

static volatile uint16_t reading[CHANNELS];
static volatile uint8_t rounds;
static uint8_t over[CHANNELS], open[CHANNELS];

static bool too_high(uint8_t channel, uint16_t counts) {
    return (channel == PRESSURE && counts >= PRESSURE_TRIP) ||
           (channel == TEMPERATURE && counts >= TEMPERATURE_TRIP);
}

static void count(uint8_t *counter, bool faulty) {
    if (faulty)
        *counter = *counter + WEIGHT < TRIPS ? *counter + WEIGHT : TRIPS;
    else if (*counter)
        --*counter;
}

static uint8_t cause_of(uint8_t channel, uint8_t from) {
    if (open[channel] >= from)
        return TRIP_SENSOR;
    if (over[channel] >= from)
        return channel == PRESSURE ? TRIP_PRESSURE : TRIP_TEMPERATURE;
    return 0;
}

ISR(ADC_vect) {
    static uint8_t channel;
    uint16_t counts = ADC;
    reading[channel] = counts;
    bool broken = (SENSORS & _BV(channel)) && (counts < OPEN_LOW || counts > OPEN_HIGH);
    count(&open[channel], broken);
    if (!broken) /* the reading of a broken wire is not a pressure, neither a high nor a low one */
        count(&over[channel], too_high(channel, counts));
    uint8_t cause = cause_of(channel, TRIPS);
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
        causes |= cause_of(channel, LASTS);
    return causes;
}
