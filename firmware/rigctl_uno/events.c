/* Events with their exact time: `!number,us,kind,value*CRC`. Sent while the stream is on. */
#include <util/atomic.h>

#include "board.h"

#define SIZE 16

typedef struct {
    uint32_t us;
    int16_t value;
    char kind;
    uint8_t number;
} event_t;

static event_t ring[SIZE];
static volatile uint8_t head, tail, next_number;

/* A full ring drops the newest event, which leaves a gap in the numbers. */
void event_add(uint32_t us, char kind, int16_t value) {
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        uint8_t after = (head + 1) % SIZE;
        if (after != tail) {
            ring[head] = (event_t){us, value, kind, next_number};
            head = after;
        }
        next_number++;
    }
}

void events_send(void) {
    while (tail != head) {
        event_t event = ring[tail];
        if (stream_on()) {
            line_begin('!');
            line_number(event.number);
            line_char(',');
            line_number(event.us);
            line_char(',');
            line_char(event.kind);
            line_char(',');
            line_signed(event.value);
            if (!line_send())
                return;
        }
        tail = (tail + 1) % SIZE;
    }
}
