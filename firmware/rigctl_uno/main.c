/* rigctl's program for a hydraulic test bench on an ATmega328P at 16 MHz. */
#include <avr/interrupt.h>
#include <avr/wdt.h>

#include "board.h"

#define LINE 64

static void receive(void) {
    static char line[LINE];
    static uint8_t length;
    static bool damaged; /* part of it is missing: nothing of it is carried out */
    uint8_t byte;
    while (uart_read(&byte)) {
        if (byte == '\r')
            continue;
        if (byte != '\n') {
            if (byte != UART_LOST && length < LINE - 1)
                line[length++] = byte;
            else
                damaged = true;
            continue;
        }
        line[length] = 0;
        if (damaged)
            error_add(E_OVERRUN);
        else
            command_execute(line);
        length = 0;
        damaged = false;
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
