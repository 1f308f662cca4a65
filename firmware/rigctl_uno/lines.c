/* Unsolicited lines of the board: assembled first, then sent completely or not at all.
 *
 * CRC and digits are made here the fast way: at 500000 baud the line would else wait for the processor. */
#include <avr/pgmspace.h>

#include "board.h"

static char line[80];
static uint8_t length;

/* CRC-16/XMODEM, x^16 + x^12 + x^5 + 1, byte by byte; avr-libc's works bit by bit. */
uint16_t crc_update(uint16_t crc, uint8_t byte) {
    crc = (uint8_t)(crc >> 8) | crc << 8;
    crc ^= byte;
    crc ^= (uint8_t)crc >> 4;
    crc ^= crc << 12;
    crc ^= (uint16_t)(uint8_t)crc << 5;
    return crc;
}

void put_hex(uint16_t value, void (*put)(char)) {
    for (int8_t shift = 12; shift >= 0; shift -= 4) {
        uint8_t digit = (value >> shift) & 15;
        put(digit < 10 ? '0' + digit : 'A' + digit - 10);
    }
}

/* By subtraction: a division of 32 bits takes 600 cycles. */
char *decimal(uint32_t value, char *digits) {
    static const uint32_t LARGE[] PROGMEM = {1000000000, 100000000, 10000000, 1000000, 100000, 10000};
    static const uint16_t SMALL[] PROGMEM = {10000, 1000, 100, 10};
    bool begun = false;
    uint8_t from = 0;
    if (value > UINT16_MAX) {
        for (uint8_t i = 0; i < 6; i++) {
            uint32_t unit = pgm_read_dword(&LARGE[i]);
            char digit = '0';
            for (; value >= unit; value -= unit)
                digit++;
            begun |= digit != '0';
            if (begun)
                *digits++ = digit;
        }
        from = 1; /* less than 10000 is left */
    }
    uint16_t rest = value;
    for (uint8_t i = from; i < 4; i++) {
        uint16_t unit = pgm_read_word(&SMALL[i]);
        char digit = '0';
        for (; rest >= unit; rest -= unit)
            digit++;
        begun |= digit != '0';
        if (begun)
            *digits++ = digit;
    }
    *digits++ = '0' + rest;
    return digits;
}

void line_begin(char first) {
    length = 0;
    line_char(first);
}

void line_char(char c) { line[length++] = c; }

void line_number(uint32_t value) { length = decimal(value, line + length) - line; }

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
    return uart_put_all(line, length);
}
