/*
 * uart.h on an ATmega328P: USART0, pins RXD and TXD. It holds two received bytes, and a step of the
 * agent takes longer: the interrupt on reception takes them into a queue. Register names are those
 * of the data sheet (Atmel-7810).
 */
#include "uart.h"

#include "byte_queue.h"

#include <avr/interrupt.h>
#include <avr/io.h>

static struct byte_queue received;
static volatile uint16_t lost;

ISR(USART_RX_vect)
{
    if ((UCSR0A & _BV(DOR0)) != 0) {
        ++lost; /* before this byte, one at least */
    }
    if (!byte_queue_put(&received, UDR0)) {
        ++lost;
    }
}

void uart_start(void)
{
    UBRR0 = 16; /* with double speed 117,647 bit/s of 16 MHz, 2.1 % more than 115,200 */
    UCSR0A = _BV(U2X0);
    UCSR0B = _BV(TXEN0) | _BV(RXEN0) | _BV(RXCIE0);
    sei();
}

bool uart_put(uint8_t byte)
{
    if ((UCSR0A & _BV(UDRE0)) == 0) {
        return false;
    }
    UDR0 = byte;
    return true;
}

bool uart_take(uint8_t *byte)
{
    return byte_queue_take(&received, byte);
}

/* The interrupt could come between its two bytes. */
uint16_t uart_lost(void)
{
    uint8_t flags = SREG;
    cli();
    uint16_t count = lost;
    SREG = flags;
    return count;
}
