/*
 * What firmware of this folder asks of the board that it runs on: a character out, an end with a
 * status, a counter. One folder a platform under ports/ fills it in (platform.c). Not reentrant.
 */
#ifndef PLATFORM_H
#define PLATFORM_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* One character of text; '\n' ends a line. Waits until there is room for it. */
void platform_put(char character);

/* Ends the run: 0 done, else failure, as for a program of a host. Does not return. */
void platform_exit(int status);

/* Sets the counter to 0. */
void platform_count_from_here(void);

/*
 * What the processor did since then: instructions on Cortex-M and RV32IMAC, whose emulator knows
 * no pipeline, cycles on AVR. Both calls cost a few of them: the same few each time, so that
 * counting nothing tells what to take off. Cortex-M counts to 600,000 and AVR to 262,143; beyond,
 * the number is not right. The host has no such counter and lacks these two functions.
 */
uint32_t platform_count(void);

#ifdef __cplusplus
}
#endif

#endif
