/*
 * Start-up of any Cortex-M: vector table, initial values of variables, main. A board's linker
 * script (microbit.ld, mps2.ld) says where memory lies. Nothing here depends on the device but the
 * number of vectors: those of its interrupts follow the 16 of the architecture, as many as are
 * used.
 */
#include "platform.h"

#include <stdint.h>

/* From sections.ld. */
extern uint32_t initialized_begin[], initialized_end[], zeroed_begin[], zeroed_end[], stack_top[];
extern const uint32_t initial_values[];

int main(void);

/* Entered by the processor, which has loaded the stack pointer from the vector table. */
static void reset(void)
{
    const uint32_t *value = initial_values;
    for (uint32_t *word = initialized_begin; word < initialized_end; ++word) {
        *word = *value++;
    }
    for (uint32_t *word = zeroed_begin; word < zeroed_end; ++word) {
        *word = 0;
    }
#ifdef __ARM_FP
    /* CPACR: full access to the floating-point unit (coprocessors 10 and 11), before its first use.
     */
    *(volatile uint32_t *)0xE000ED88u |= 0xFu << 20;
    __asm__ volatile("dsb\n\tisb" ::: "memory");
#endif
    platform_exit(main());
}

/* An exception that nobody expects: status 100 and its number (3 is HardFault). */
static void unexpected(void)
{
    uint32_t number;
    __asm__ volatile("mrs %0, ipsr" : "=r"(number));
    platform_exit(100 + (int)(number & 0x1FFu));
}

/* The device's interrupts: of whoever defines a function of this name (mps2_uart.c, nrf51_uart.c).
 */
void interrupt_0(void) __attribute__((weak, alias("unexpected")));
void interrupt_1(void) __attribute__((weak, alias("unexpected")));
void interrupt_2(void) __attribute__((weak, alias("unexpected")));

struct vectors {
    const uint32_t *stack_top;
    void (*reset)(void);
    void (*exception[14])(void); /* NMI, HardFault, .., PendSV, SysTick */
    void (*interrupt[3])(void);
};

__attribute__((section(".vectors"), used)) const struct vectors vectors = {
    stack_top,
    reset,
    {unexpected, unexpected, unexpected, unexpected, unexpected, unexpected, unexpected, unexpected,
     unexpected, unexpected, unexpected, unexpected, unexpected, unexpected},
    {interrupt_0, interrupt_1, interrupt_2},
};
