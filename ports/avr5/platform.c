/*
 * platform.h on an ATmega328P: text by USART0, cycles by timers 0 and 1. Nobody takes a status from
 * a microcontroller, so the end prints one as a last line, which simulate.sh turns into its own.
 * Register names are those of the data sheet (Atmel-7810).
 */
#include "platform.h"

#include "print.h"

#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>

/*
 * 8 data bits, no parity, 1 stop bit and UBRR0 = 0 after reset, which with double speed is
 * 2 Mbit/s at 16 MHz; where uart.c has started the USART, its rate.
 */
void platform_put(char character)
{
    if ((UCSR0B & _BV(TXEN0)) == 0) {
        UCSR0A = _BV(U2X0);
        UCSR0B = _BV(TXEN0);
    }
    while ((UCSR0A & _BV(UDRE0)) == 0) {
    }
    UDR0 = (uint8_t)character;
}

void platform_exit(int status)
{
    print_text("status ");
    print_decimal((uint32_t)status);
    platform_put('\n');
    cli();
    for (;;) {
        sleep_mode(); /* simavr ends where nothing can wake the processor */
    }
}

void platform_count_from_here(void)
{
    TCCR0A = 0;
    TCCR1A = 0;
    TCCR1B = _BV(CS10); /* every cycle */
    GTCCR = _BV(TSM) | _BV(PSRSYNC);
    TCCR0B = _BV(CS02) | _BV(CS00); /* every 1024 cycles of the prescaler, which stands at 0 */
    TCNT1 = 0;
    TCNT0 = 0;
    GTCCR = 0;
}

/*
 * Timer 1 has the lower 16 bits. Timer 0 started after it and is read before it, so timer 1 is
 * never behind the cycles that timer 0 has counted, and its 16 bits tell by how many it is ahead.
 */
uint32_t platform_count(void)
{
    uint32_t coarse = (uint32_t)TCNT0 << 10;
    uint16_t ahead = (uint16_t)(TCNT1 - (uint16_t)coarse);
    return coarse + ahead;
}
