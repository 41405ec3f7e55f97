/*
 * platform.h on an RV32 in QEMU: text and end by semihosting, counting by minstret. QEMU lets
 * minstret count the nanoseconds of its clock, of which rv32imac.cmake gives each instruction one.
 */
#include "platform.h"

#include "semihosting.h"

static uint32_t counted_from;

/* The trap is known by the two shifts around it, all three without compression. */
void semihosting_call(uint32_t operation, const void *argument)
{
    register uint32_t a0 __asm__("a0") = operation;
    register const void *a1 __asm__("a1") = argument;
    __asm__ volatile(".balign 16\n\t"
                     ".option push\n\t"
                     ".option norvc\n\t"
                     "slli zero, zero, 0x1f\n\t"
                     "ebreak\n\t"
                     "srai zero, zero, 7\n\t"
                     ".option pop"
                     : "+r"(a0)
                     : "r"(a1)
                     : "memory");
}

static uint32_t retired(void)
{
    uint32_t instructions;
    __asm__ volatile("csrr %0, minstret" : "=r"(instructions)::"memory");
    return instructions;
}

void platform_count_from_here(void)
{
    counted_from = retired();
}

uint32_t platform_count(void)
{
    return retired() - counted_from;
}
