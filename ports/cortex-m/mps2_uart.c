/*
 * uart.h on the MPS2 board: UART 0 (CMSDK APB UART, Arm DDI 0479, section 4.3). It holds one
 * received byte: the interrupt on reception takes it into a queue.
 */
#include "uart.h"

#include "byte_queue.h"

#define UART0 0x40004000u
#define DATA (*(volatile uint32_t *)(UART0 + 0x00u))
#define STATE (*(volatile uint32_t *)(UART0 + 0x04u))
#define CONTROL (*(volatile uint32_t *)(UART0 + 0x08u))
#define INTERRUPT_CLEAR (*(volatile uint32_t *)(UART0 + 0x0Cu))
#define DIVIDER (*(volatile uint32_t *)(UART0 + 0x10u))

#define STATE_TRANSMIT_FULL 0x1u
#define STATE_RECEIVE_FULL 0x2u
#define CONTROL_TRANSMIT 0x1u
#define CONTROL_RECEIVE 0x2u
#define CONTROL_RECEIVE_INTERRUPT 0x8u
#define INTERRUPT_RECEIVE 0x2u

/* NVIC: interrupt 0 of the device is UART 0's reception. */
#define NVIC_ENABLE (*(volatile uint32_t *)0xE000E100u)
#define NVIC_UART0_RECEIVE 0x1u

static struct byte_queue received;
static volatile uint16_t lost;

/* In the vector table (startup.c). Cleared before the byte is taken: the next one asks again. */
void interrupt_0(void)
{
    INTERRUPT_CLEAR = INTERRUPT_RECEIVE;
    if ((STATE & STATE_RECEIVE_FULL) != 0 && !byte_queue_put(&received, (uint8_t)DATA)) {
        ++lost;
    }
}

void uart_start(void)
{
    DIVIDER = 217; /* of 25 MHz; QEMU takes any rate */
    CONTROL = CONTROL_TRANSMIT | CONTROL_RECEIVE | CONTROL_RECEIVE_INTERRUPT;
    NVIC_ENABLE = NVIC_UART0_RECEIVE;
}

bool uart_put(uint8_t byte)
{
    if ((STATE & STATE_TRANSMIT_FULL) != 0) {
        return false;
    }
    DATA = byte;
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
