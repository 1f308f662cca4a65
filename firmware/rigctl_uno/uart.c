/* The serial line, with ring buffers in both directions that interrupts fill and empty. */
#include <avr/interrupt.h>
#include <avr/wdt.h>

#include "board.h"

#define DIVISOR ((F_CPU + BAUD * 4UL) / (BAUD * 8UL) - 1UL) /* double speed */

static volatile uint8_t received[128], to_send[256];
static volatile uint8_t rx_head, rx_tail, tx_head, tx_tail;
static volatile bool missing; /* bytes were lost after the newest in the ring */

static bool keep(uint8_t byte) {
    uint8_t next = (rx_head + 1) & 127;
    if (next == rx_tail)
        return false;
    received[rx_head] = byte;
    rx_head = next;
    return true;
}

ISR(USART_RX_vect) {
    uint8_t status = UCSR0A, byte = UDR0;
    if (status & _BV(DOR0))
        missing = true;
    if (missing)
        missing = !keep(UART_LOST);
    if (!missing)
        missing = !keep(byte);
}

ISR(USART_UDRE_vect) {
    if (tx_head == tx_tail) {
        UCSR0B &= ~_BV(UDRIE0);
        return;
    }
    UDR0 = to_send[tx_tail];
    tx_tail++;
}

void uart_start(void) {
    UCSR0A = _BV(U2X0);
    UCSR0C = _BV(UCSZ01) | _BV(UCSZ00);
    UBRR0H = DIVISOR >> 8;
    UBRR0L = DIVISOR & 255;
    UCSR0B = _BV(RXEN0) | _BV(TXEN0) | _BV(RXCIE0);
}

bool uart_read(uint8_t *byte) {
    if (rx_tail == rx_head)
        return false;
    *byte = received[rx_tail];
    rx_tail = (rx_tail + 1) & 127;
    return true;
}

static uint8_t uart_free(void) { return (uint8_t)(tx_tail - tx_head - 1); }

void uart_put(char c) {
    while (!uart_free()) /* always ends, as the line sends independently */
        wdt_reset();
    to_send[tx_head] = c;
    tx_head++;
    UCSR0B |= _BV(UDRIE0);
}

bool uart_put_all(const char *data, uint8_t length) {
    if (uart_free() < length)
        return false;
    uint8_t head = tx_head;
    while (length--)
        to_send[head++] = *data++;
    tx_head = head;
    UCSR0B |= _BV(UDRIE0);
    return true;
}
