/*
 * uart.h on the BBC micro:bit: the UART of the nRF51822 (nRF51 Series Reference Manual, chapter
 * 29), which goes to the board's USB. It holds six received bytes, fewer than come in a step of the
 * agent: the interrupt on reception takes them into a queue.
 */
#include "uart.h"

#include "byte_queue.h"

#define UART0 0x40002000u
#define START_RECEIVER (*(volatile uint32_t *)(UART0 + 0x000u))
#define START_TRANSMITTER (*(volatile uint32_t *)(UART0 + 0x008u))
#define RECEIVED (*(volatile uint32_t *)(UART0 + 0x108u)) /* event RXDRDY */
#define SENT (*(volatile uint32_t *)(UART0 + 0x11Cu))     /* event TXDRDY */
#define INTERRUPT_ENABLE (*(volatile uint32_t *)(UART0 + 0x304u))
#define ENABLE (*(volatile uint32_t *)(UART0 + 0x500u))
#define PIN_OUT (*(volatile uint32_t *)(UART0 + 0x50Cu))
#define PIN_IN (*(volatile uint32_t *)(UART0 + 0x514u))
#define DATA_IN (*(volatile uint32_t *)(UART0 + 0x518u))
#define DATA_OUT (*(volatile uint32_t *)(UART0 + 0x51Cu))
#define RATE (*(volatile uint32_t *)(UART0 + 0x524u))

#define INTERRUPT_RECEIVED 0x4u

/* NVIC: interrupt 2 of the device is the UART's. */
#define NVIC_ENABLE (*(volatile uint32_t *)0xE000E100u)
#define NVIC_UART0 0x4u

static struct byte_queue received;
static volatile uint16_t lost;
static bool sending; /* a byte was handed over; SENT tells when the next may be */

/* In the vector table (startup.c). Cleared before the byte is taken: the next one asks again. */
void interrupt_2(void)
{
    if (RECEIVED != 0) {
        RECEIVED = 0;
        if (!byte_queue_put(&received, (uint8_t)DATA_IN)) {
            ++lost;
        }
    }
}

void uart_start(void)
{
    PIN_OUT = 24;
    PIN_IN = 25;
    RATE = 0x01D7E000u; /* 115,200 bit/s; no parity after reset */
    ENABLE = 4;
    START_RECEIVER = 1;
    START_TRANSMITTER = 1;
    INTERRUPT_ENABLE = INTERRUPT_RECEIVED;
    NVIC_ENABLE = NVIC_UART0;
}

bool uart_put(uint8_t byte)
{
    if (sending && SENT == 0) {
        return false;
    }
    SENT = 0;
    DATA_OUT = byte;
    sending = true;
    return true;
}

bool uart_take(uint8_t *byte)
{
    return byte_queue_take(&received, byte);
}

uint16_t uart_lost(void)
{
    return lost;
}
