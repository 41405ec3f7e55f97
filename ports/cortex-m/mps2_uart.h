/*
 * UART 0 of the MPS2 board (CMSDK APB UART, Arm DDI 0479, section 4.3). It holds one received byte:
 * the interrupt on reception takes it into a queue, from which the program takes it when it has
 * time. One UART, so its queue is a variable of mps2_uart.c: an interrupt has no context pointer.
 */
#ifndef MPS2_UART_H
#define MPS2_UART_H

#include <stdbool.h>
#include <stdint.h>

/* Turns both directions on. QEMU takes any rate; a board runs at 25 MHz / 217 = 115,200 bit/s. */
void mps2_uart_start(void);

/* Sends a byte; false, and nothing sent, while the last one still waits. */
bool mps2_uart_put(uint8_t byte);

/* Takes the oldest byte that was received; false, and *byte untouched, if there is none. */
bool mps2_uart_take(uint8_t *byte);

/* Bytes that were received and lost: the queue was full. Modulo 2^16. */
uint16_t mps2_uart_lost(void);

#endif
