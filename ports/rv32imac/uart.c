/*
 * uart.h on QEMU's board virt: a 16550 (Texas Instruments PC16550D, section 8). Its own queue of 16
 * received bytes is 1.4 ms of the line; firmware that stays away longer takes its interrupt.
 */
#include "uart.h"

#define UART 0x10000000u
#define DATA (*(volatile uint8_t *)(UART + 0u))
#define FIFO_CONTROL (*(volatile uint8_t *)(UART + 2u))
#define LINE_CONTROL (*(volatile uint8_t *)(UART + 3u))
#define LINE_STATUS (*(volatile uint8_t *)(UART + 5u))

#define FIFO_ON_AND_EMPTY 0x07u
#define EIGHT_DATA_BITS 0x03u /* no parity, 1 stop bit */
#define STATUS_RECEIVED 0x01u
#define STATUS_OVERRUN 0x02u /* cleared as it is read */
#define STATUS_TRANSMIT_EMPTY 0x20u

static uint16_t lost;

static uint8_t status(void)
{
    uint8_t bits = LINE_STATUS;
    if ((bits & STATUS_OVERRUN) != 0) {
        ++lost; /* one at least */
    }
    return bits;
}

/*
 * The rate is a divisor of the board's own clock; QEMU takes any, so none is set. A byte that came
 * before is thrown away by reading too: QEMU holds the next back until one is read.
 */
void uart_start(void)
{
    LINE_CONTROL = EIGHT_DATA_BITS;
    FIFO_CONTROL = FIFO_ON_AND_EMPTY;
    (void)DATA;
}

bool uart_put(uint8_t byte)
{
    if ((status() & STATUS_TRANSMIT_EMPTY) == 0) {
        return false;
    }
    DATA = byte;
    return true;
}

bool uart_take(uint8_t *byte)
{
    if ((status() & STATUS_RECEIVED) == 0) {
        return false;
    }
    *byte = DATA;
    return true;
}

uint16_t uart_lost(void)
{
    return lost;
}
