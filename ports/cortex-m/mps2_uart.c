/* The registers of mps2_uart.h. */
#include "mps2_uart.h"

#define UART0 0x40004000u
#define DATA (*(volatile uint32_t *)(UART0 + 0x00u))
#define STATE (*(volatile uint32_t *)(UART0 + 0x04u))
#define CONTROL (*(volatile uint32_t *)(UART0 + 0x08u))
#define DIVIDER (*(volatile uint32_t *)(UART0 + 0x10u))

#define STATE_TRANSMIT_FULL 0x1u
#define STATE_RECEIVE_FULL 0x2u
#define CONTROL_TRANSMIT 0x1u
#define CONTROL_RECEIVE 0x2u

void mps2_uart_start(void)
{
    DIVIDER = 217;
    CONTROL = CONTROL_TRANSMIT | CONTROL_RECEIVE;
}

bool mps2_uart_put(uint8_t byte)
{
    if ((STATE & STATE_TRANSMIT_FULL) != 0) {
        return false;
    }
    DATA = byte;
    return true;
}

bool mps2_uart_take(uint8_t *byte)
{
    if ((STATE & STATE_RECEIVE_FULL) == 0) {
        return false;
    }
    *byte = (uint8_t)DATA;
    return true;
}
