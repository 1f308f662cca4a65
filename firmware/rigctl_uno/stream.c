/* `@sequence,us,pressure,position,temperature,outputs,trips*CRC` at a regular distance; while a closed loop runs
 * with `,pwm,held` before the `*`: the output, and since how many microseconds it is what it is. A line that finds no
 * room is left out, and its number with it. */
#include "board.h"

#define LATE 8 /* periods that an answer may delay the stream by; each sample bears the time it was taken */

static uint32_t period, next;
static uint16_t sequence;
static bool overrun;

void stream_set(uint32_t period_us) {
    period = period_us;
    sequence = 0;
    overrun = false;
    next = micros();
}

bool stream_on(void) { return period != 0; }

static void tell_overrun(void) {
    if (!overrun)
        error_add(E_STREAM);
    overrun = true;
}

void stream_tick(void) {
    uint32_t now = micros();
    if (!period || (int32_t)(now - next) < 0)
        return;
    next += period;
    if ((int32_t)(now - next) > (int32_t)(LATE * period)) { /* too busy for this rate: drop samples */
        while ((int32_t)(now - next) > 0) {
            next += period;
            sequence++;
        }
        tell_overrun();
    }
    line_begin('@');
    line_number(sequence++);
    line_char(',');
    line_number(now);
    for (uint8_t channel = 0; channel < 3; channel++) {
        line_char(',');
        line_number(input(channel));
    }
    line_char(',');
    line_number(outputs_bits());
    line_char(',');
    line_number(trips());
    if (control_running()) {
        uint32_t since;
        uint16_t counts = pressure_since(&since);
        line_char(',');
        line_number(counts);
        line_char(',');
        line_number((int32_t)(now - since) > 0 ? now - since : 0); /* may have changed after `now` */
    }
    if (!line_send())
        tell_overrun();
}
