/* Heater, solenoids and relief valve. Every switch is reported with its time; nothing comes on while a trip is latched.
 *
 * A solenoid is energised VALVE_REST_MS after the valve's last switch at the earliest: a command that comes too
 * soon waits on the board, and the latest one counts. Both solenoids are never on together, since one function
 * sets them and releases both first. */
#include <util/atomic.h>

#include "board.h"

static volatile int8_t position;          /* of the valve, now */
static volatile uint32_t switched_ms;     /* when it last switched */
static volatile uint32_t on_us, off_us;   /* exact times of the last switch on and off */
static volatile int8_t waiting;           /* the position that waits for the end of the valve's rest */
static volatile uint32_t waiting_pulse;   /* its duration, us */
static volatile uint32_t pulse_end;       /* us */
static volatile bool pulsing, armed, rested = true, heater_rested = true;
static volatile uint32_t heater_off_ms;
static volatile uint16_t pwm;
static volatile uint32_t pwm_us; /* when it last changed */
static volatile uint16_t credit = HEATER_CREDIT_S;
static uint16_t credit_ms;

static void solenoids(int8_t to) {
    if (to != EXTEND)
        PORTD &= ~_BV(PD7);
    if (to != RETRACT)
        PORTB &= ~_BV(PB0);
    if (to == EXTEND)
        PORTD |= _BV(PD7);
    if (to == RETRACT)
        PORTB |= _BV(PB0);
}

/* Interrupts are off in all of these. */
static void forget_pulse(void) {
    clock_disarm();
    pulsing = armed = false;
    waiting = NEUTRAL;
}

static uint32_t move_valve(int8_t to) { /* returns its time, us */
    solenoids(to);
    uint32_t at_us = micros();
    if (to != position) {
        switched_ms = millis();
        rested = false;
        if (to == NEUTRAL)
            off_us = at_us;
        else
            on_us = at_us;
    }
    position = to;
    event_add(at_us, 'V', to);
    return at_us;
}

static void energise(int8_t to, uint32_t duration_us) {
    uint32_t now = move_valve(to);
    if (duration_us) {
        pulse_end = now + duration_us;
        pulsing = true;
    }
}

static void set_pwm(uint16_t counts) {
    if (counts != pwm)
        pwm_us = micros();
    pwm = counts;
    if (counts) {
        OCR1A = counts;
        TCCR1A |= _BV(COM1A1);
    } else {
        TCCR1A &= ~_BV(COM1A1);
        PORTB &= ~_BV(PB1);
    }
}

static void set_heater(bool on) {
    bool was = heater_on();
    if (on)
        PORTD |= _BV(PD4);
    else
        PORTD &= ~_BV(PD4);
    if (was && !on) {
        heater_off_ms = millis();
        heater_rested = false;
    }
    event_add(micros(), 'H', on);
}

void outputs_start(void) {
    PORTD &= ~(_BV(PD4) | _BV(PD7));
    PORTB &= ~(_BV(PB0) | _BV(PB1));
    DDRD |= _BV(PD4) | _BV(PD7);
    DDRB |= _BV(PB0) | _BV(PB1);
    TCCR1A = _BV(WGM11) | _BV(WGM10); /* fast PWM, 10 bit */
    TCCR1B = _BV(WGM12) | _BV(CS10);
}

void outputs_off(void) {
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        forget_pulse();
        control_halt();
        if (heater_on())
            set_heater(false);
        if (position != NEUTRAL)
            move_valve(NEUTRAL);
        if (pwm) {
            set_pwm(0);
            event_add(micros(), 'P', 0);
        }
    }
}

static void count_heating(void) {
    if (++credit_ms < 1000)
        return;
    credit_ms = 0;
    if (!heater_on()) {
        if (credit < HEATER_CREDIT_S)
            credit++;
    } else if (credit) {
        credit--;
    } else {
        trip(TRIP_HEATER);
    }
}

void outputs_tick(void) {
    uint32_t now = millis();
    if (!rested && now - switched_ms >= VALVE_REST_MS)
        rested = true;
    if (!heater_rested && now - heater_off_ms >= HEATER_REST_MS)
        heater_rested = true;
    count_heating();
    if (waiting != NEUTRAL && rested) {
        int8_t to = waiting;
        waiting = NEUTRAL;
        energise(to, waiting_pulse);
    }
    if (pulsing && !armed) {
        int32_t left = (int32_t)(pulse_end - now * 1000UL);
        if (left < 1000) {
            armed = true;
            clock_arm(left > 0 ? (uint16_t)left / 4U : 0);
        }
    }
}

void pulse_due(void) {
    if (!pulsing)
        return;
    forget_pulse();
    move_valve(NEUTRAL);
}

int16_t heater_set(bool on) {
    int16_t error = E_NONE;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        if (on && (trips() || (!heater_on() && (!heater_rested || !credit))))
            error = E_CONFLICT;
        else
            set_heater(on);
    }
    return error;
}

int16_t valve_set(int8_t to, uint32_t duration_us) {
    int16_t error = E_NONE;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        if (to != NEUTRAL && trips()) {
            error = E_CONFLICT;
        } else {
            forget_pulse();
            if (to == NEUTRAL || to == position || (position == NEUTRAL && rested)) {
                if (to == NEUTRAL)
                    move_valve(NEUTRAL);
                else
                    energise(to, duration_us);
            } else { /* it moves the other way, or has just been switched: first neutral, then rest */
                if (position != NEUTRAL)
                    move_valve(NEUTRAL);
                waiting_pulse = duration_us;
                waiting = to;
            }
        }
    }
    return error;
}

int16_t pressure_set(uint16_t counts) {
    int16_t error = E_NONE;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        if (counts && trips()) {
            error = E_CONFLICT;
        } else {
            control_halt(); /* a direct command ends the loop */
            set_pwm(counts);
            event_add(micros(), 'P', counts);
        }
    }
    return error;
}

/* Without an event, as the line could not transmit a thousand per second. Samples contain the output. */
bool pressure_regulate(uint16_t counts) {
    bool allowed = !trips();
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        if (allowed && counts != pwm)
            set_pwm(counts);
    }
    return allowed;
}

uint16_t pressure_since(uint32_t *us) {
    uint16_t counts;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        counts = pwm;
        *us = pwm_us;
    }
    return counts;
}

int8_t valve_position(void) { return position; }
bool heater_on(void) { return PORTD & _BV(PD4); }
uint16_t pressure_counts(void) {
    uint16_t counts;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { counts = pwm; }
    return counts;
}

uint8_t outputs_bits(void) {
    return ((PORTD >> PD4) & 1) | ((PORTD >> PD7) & 1) << 1 | (PORTB & 1) << 2 | (pwm ? 8 : 0);
}

bool outputs_active(void) { return outputs_bits() || waiting != NEUTRAL || control_running(); }

uint16_t heater_credit(void) {
    uint16_t left;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { left = credit; }
    return left;
}

void valve_times(uint32_t *on, uint32_t *off) {
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        *on = on_us;
        *off = off_us;
    }
}
