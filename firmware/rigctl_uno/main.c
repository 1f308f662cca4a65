/* rigctl's program for a hydraulic test bench on an ATmega328P at 16 MHz. */
#include <avr/interrupt.h>
#include <avr/wdt.h>

#include "board.h"

#define LINE 64

static void receive(void) {
    static char line[LINE];
    static uint8_t length;
    static bool too_long;
    uint8_t byte;
    if (uart_overrun()) /* part of a command is missing: carry out nothing of it */
        too_long = true;
    while (uart_read(&byte)) {
        if (byte == '\r')
            continue;
        if (byte != '\n') {
            if (length < LINE - 1)
                line[length++] = byte;
            else
                too_long = true;
            continue;
        }
        line[length] = 0;
        if (too_long)
            error_add(E_OVERRUN);
        else
            command_execute(line);
        length = 0;
        too_long = false;
        return; /* one command, then the events and the stream */
    }
}

int main(void) {
    outputs_start();
    clock_start();
    uart_start();
    trips_start();
    sei();
    inputs_start();
    wdt_enable(WDTO_250MS);
    for (;;) {
        wdt_reset();
        receive();
        events_send();
        stream_tick();
    }
}
