/*
 * Semihosting (Arm's "Semihosting for AArch32 and AArch64", taken over by RISC-V): a trap by which
 * a debugger or an emulator does input and output for the processor. semihosting.c fills in the
 * text and the end of platform.h with it. Without a debugger the trap is a fault: firmware that is
 * to run alone takes a UART instead.
 */
#ifndef SEMIHOSTING_H
#define SEMIHOSTING_H

#include <stdint.h>

/* The trap itself, in each processor's platform.c. What `argument` points to depends on operation.
 */
void semihosting_call(uint32_t operation, const void *argument);

#endif
