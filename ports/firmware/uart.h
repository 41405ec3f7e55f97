/*
 * Bytes over the board's UART, for the hooks of ports/slcan/channel.h. Each platform's folder fills
 * it in. One UART a board, so that it and its queue are variables there: an interrupt has no
 * context pointer. Never waits; for one program, which the UART's own interrupt may break in upon.
 */
#ifndef UART_H
#define UART_H

#include <stdbool.h>
#include <stdint.h>

/* Turns both directions on: 115,200 bit/s, 8 data bits, no parity, 1 stop bit. */
void uart_start(void);

/* Sends a byte; false, and nothing sent, while the last one still waits. */
bool uart_put(uint8_t byte);

/* Takes the oldest byte that was received; false, and *byte untouched, if there is none. */
bool uart_take(uint8_t *byte);

/* Bytes that were received and lost, there being no room for them, as far as can be told. */
uint16_t uart_lost(void);

#endif
