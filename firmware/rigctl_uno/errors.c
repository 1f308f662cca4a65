/* The error queue of SCPI-99, volume 2, chapter 21.8: standard numbers, oldest first, -350 when it is full. */
#include <avr/pgmspace.h>
#include <string.h>
#include <util/atomic.h>

#include "board.h"

static int16_t queue[8];
static uint8_t count;

void error_add(int16_t error) {
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { /* trips add errors from interrupts */
        if (count < 8)
            queue[count++] = error;
        else
            queue[7] = E_OVERFLOW;
    }
}

int16_t error_take(void) {
    int16_t error = E_NONE;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        if (count) {
            error = queue[0];
            count--;
            memmove(queue, queue + 1, count * sizeof queue[0]);
        }
    }
    return error;
}

uint8_t error_count(void) { return count; }

void error_clear(void) { count = 0; }

const char *error_text(int16_t error) {
    switch (error) {
    case E_NONE: return PSTR("No error");
    case E_DATA_TYPE: return PSTR("Data type error");
    case E_NOT_ALLOWED: return PSTR("Parameter not allowed");
    case E_MISSING: return PSTR("Missing parameter");
    case E_HEADER: return PSTR("Undefined header");
    case E_CONFLICT: return PSTR("Settings conflict");
    case E_RANGE: return PSTR("Data out of range");
    case E_OVERFLOW: return PSTR("Queue overflow");
    case E_COMMUNICATION: return PSTR("Communication error");
    case E_OVERRUN: return PSTR("Input buffer overrun");
    case E_STREAM: return PSTR("Stream overrun");
    default: return PSTR("Tripped");
    }
}
