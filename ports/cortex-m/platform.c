/*
 * platform.h on a Cortex-M in QEMU: text and end by semihosting, counting by SysTick. QEMU lets
 * each instruction take 2^shift ns of its clock (-icount shift=10, see cortex-m.cmake), by which
 * SysTick runs; on a real processor SysTick counts cycles, and the conversion below has to go.
 */
#include "platform.h"

#include "semihosting.h"

#define SYSTICK_CONTROL (*(volatile uint32_t *)0xE000E010u)
#define SYSTICK_RELOAD (*(volatile uint32_t *)0xE000E014u)
#define SYSTICK_CURRENT (*(volatile uint32_t *)0xE000E018u)
#define SYSTICK_LARGEST 0xFFFFFFu /* it has 24 bits and counts down */

void semihosting_call(uint32_t operation, const void *argument)
{
    register uint32_t r0 __asm__("r0") = operation;
    register const void *r1 __asm__("r1") = argument;
    __asm__ volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory");
}

void platform_count_from_here(void)
{
    SYSTICK_CONTROL = 0;
    SYSTICK_RELOAD = SYSTICK_LARGEST;
    SYSTICK_CURRENT = 0; /* any value clears it; the first tick reloads it */
    SYSTICK_CONTROL = 5; /* on, by the processor's clock, no interrupt */
}

/*
 * An instruction takes 1.024 us, and SysTick SYSTICK_MEGAHERTZ ticks in a microsecond: 25.6 ticks
 * on MPS2, 16.384 on the micro:bit. To the nearest; 125 * 2^24 fits 32 bits.
 */
uint32_t platform_count(void)
{
    uint32_t ticks = SYSTICK_LARGEST - SYSTICK_CURRENT;
    return (ticks * 125u + 64u * SYSTICK_MEGAHERTZ) / (128u * SYSTICK_MEGAHERTZ);
}
