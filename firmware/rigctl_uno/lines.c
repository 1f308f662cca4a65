/* Lines that the board sends of its own accord: put together first, sent whole or not at all. */
#include <avr/pgmspace.h>
#include <stdlib.h>
#include <util/crc16.h>

#include "board.h"

static char line[64];
static uint8_t length;

uint16_t crc_update(uint16_t crc, uint8_t byte) { return _crc_xmodem_update(crc, byte); }

void put_hex(uint16_t value, void (*put)(char)) {
    for (int8_t shift = 12; shift >= 0; shift -= 4) {
        uint8_t digit = (value >> shift) & 15;
        put(digit < 10 ? '0' + digit : 'A' + digit - 10);
    }
}

void line_begin(char first) {
    length = 0;
    line_char(first);
}

void line_char(char c) { line[length++] = c; }

void line_number(uint32_t value) {
    char digits[11];
    ultoa(value, digits, 10);
    for (char *d = digits; *d; d++)
        line_char(*d);
}

void line_signed(int32_t value) {
    if (value < 0) {
        line_char('-');
        value = -value;
    }
    line_number(value);
}

bool line_send(void) {
    uint16_t crc = 0;
    for (uint8_t i = 0; i < length; i++)
        crc = crc_update(crc, line[i]);
    line_char('*');
    put_hex(crc, line_char);
    line_char('\n');
    if (uart_free() < length)
        return false;
    for (uint8_t i = 0; i < length; i++)
        uart_put(line[i]);
    return true;
}
