/* Pins of the Uno, and the interfaces between the parts of the program.
 *
 *   A0 supply pressure   A1 position   A2 oil temperature     (0..5 V, reference AVCC)
 *   D4 (PD4) heater relay   D7 (PD7) solenoid extend   D8 (PB0) solenoid retract   (high = on)
 *   D9 (PB1, OC1A) 10-bit PWM, 15.6 kHz: proportional relief valve, where the bench has one
 *
 * Timer 0 is the clock, timer 1 the PWM, timer 2 the period of the closed loop.
 */
#ifndef BOARD_H
#define BOARD_H

#include <avr/io.h>
#include <stdbool.h>
#include <stdint.h>

#include "config.h"

/* clock.c */
void clock_start(void);
uint32_t millis(void);
uint32_t micros(void); /* 4 us steps, rolls over after 71.6 min */
void clock_arm(uint8_t count); /* call pulse_due() when the running millisecond reaches 4 us * count */
void clock_disarm(void);

/* uart.c */
void uart_start(void);
#define UART_LOST 0xFF /* stands where received bytes were lost; no command has it */
bool uart_read(uint8_t *byte);
void uart_put(char c); /* waits for room */
bool uart_put_all(const char *data, uint8_t length); /* false, and nothing is sent, if there is no room */

/* errors.c: the SCPI error queue */
enum {
    E_NONE = 0,
    E_DATA_TYPE = -104,
    E_NOT_ALLOWED = -108,
    E_MISSING = -109,
    E_HEADER = -113,
    E_CONFLICT = -221,
    E_RANGE = -222,
    E_OVERFLOW = -350,
    E_COMMUNICATION = -360,
    E_OVERRUN = -363,
    E_STREAM = 201,
};
void error_add(int16_t error);
int16_t error_take(void);
uint8_t error_count(void);
void error_clear(void);
const char *error_text(int16_t error); /* in program memory */

/* outputs.c: nothing else writes to an output pin */
enum { RETRACT = -1, NEUTRAL = 0, EXTEND = 1 };
void outputs_start(void);
void outputs_off(void);
void outputs_tick(void); /* every millisecond, from the clock's interrupt */
void pulse_due(void);
int16_t heater_set(bool on);
int16_t valve_set(int8_t position, uint32_t duration_us); /* 0: until the next command */
int16_t pressure_set(uint16_t counts);
int8_t valve_position(void);
bool heater_on(void);
bool pressure_regulate(uint16_t counts); /* by the closed loop; false, without effect, while a trip is latched */
uint16_t pressure_counts(void);
uint16_t pressure_since(uint32_t *us); /* the counts, and when they last changed */
uint8_t outputs_bits(void); /* bit 0 heater, 1 extend, 2 retract, 3 PWM */
bool outputs_active(void);  /* anything on, or about to be */
uint16_t heater_credit(void);
void valve_times(uint32_t *on_us, uint32_t *off_us);

/* control.c: a closed loop from an input to the PWM */
enum { CONTROL_FIGURES = 10 };
bool control_running(void);
void control_halt(void); /* with interrupts off; the output stays as it is */
int16_t control_clear(void);
int16_t control_input(uint8_t number);
int16_t control_period(uint16_t ms);
int16_t control_parameter(char *text);
int16_t control_start(bool from_here, bool clamped);
void control_figures(uint32_t *figures);
void control_state(float *wanted, float *output);

/* trips.c: latched until SYST:TRIP:CLE, through resets too */
enum {
    TRIP_TEMPERATURE = 1,
    TRIP_PRESSURE = 2,
    TRIP_HOST = 4,
    TRIP_MCU = 8,
    TRIP_SENSOR = 16,
    TRIP_HEATER = 32,
};
void trips_start(void);
void trip(uint8_t cause); /* outputs off, latch, report */
uint8_t trips(void);
bool trips_clear(void); /* false while a cause lasts */
const char *trip_text(uint8_t bit); /* in program memory */
void host_spoke(void);
void host_tick(void);

/* inputs.c */
void inputs_start(void);
uint16_t input(uint8_t channel);
uint8_t inputs_faulty(void); /* present causes of trips */

/* events.c: events with exact times */
void event_add(uint32_t us, char kind, int16_t value);
void events_send(void);

/* lines.c: complete lines with CRC-16/XMODEM */
void line_begin(char first);
void line_char(char c);
void line_number(uint32_t value);
void line_signed(int32_t value);
bool line_send(void); /* false if there was no room; nothing is sent then */
uint16_t crc_update(uint16_t crc, uint8_t byte);
char *decimal(uint32_t value, char *digits); /* up to 10 digits, without a final 0 byte; returns their end */
void put_hex(uint16_t value, void (*put)(char));

/* stream.c */
void stream_set(uint32_t period_us);
void stream_tick(void);
bool stream_on(void);

/* commands.c */
void command_execute(char *line);

#endif
