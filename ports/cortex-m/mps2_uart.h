/*
 * UART 0 of the MPS2 board (CMSDK APB UART, Arm DDI 0479, section 4.3), by looking: it holds one
 * received byte, which QEMU keeps from the next until it is taken. On a board an interrupt on
 * reception takes the byte into a queue instead.
 */
#ifndef MPS2_UART_H
#define MPS2_UART_H

#include <stdbool.h>
#include <stdint.h>

/* Turns both directions on. QEMU takes any rate; a board runs at 25 MHz / 217 = 115,200 bit/s. */
void mps2_uart_start(void);

/* Sends a byte; false, and nothing sent, while the last one still waits. */
bool mps2_uart_put(uint8_t byte);

/* Takes the byte that was received; false, and *byte untouched, if there is none. */
bool mps2_uart_take(uint8_t *byte);

#endif
