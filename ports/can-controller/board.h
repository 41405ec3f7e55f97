/*
 * What main.c asks of a board: the controller's hooks and a few functions more, to be written for
 * the hardware at hand.
 */
#ifndef BOARD_H
#define BOARD_H

#include "controller.h"
#include "onebit.h"

#include <stdbool.h>
#include <stdint.h>

extern const struct controller board_controller;

/*
 * Clocks, pins, the controller (bit rate, filters, no reception of own frames) and its receive
 * interrupt, whose handler calls can_receive_interrupt. Frames may come from here on.
 */
void board_start(void);

uint32_t board_agent(void); /* the own number, from switches or a page of flash; from 1 */
uint8_t board_node(void); /* the own node-ID where the master speaks CANopen (canopen.h), else 0 */

void board_measure(void *context, onebit_real *x); /* as plant_hooks in step_loop.h has them */
void board_drive(void *context, onebit_real u);
void board_hold(void *context); /* nobody tells steps any more: what is safe for the machine */

/*
 * Sleeps until an interrupt is pending, at most about a millisecond and a small part of the period;
 * at once if one is. Called with interrupts locked. On a Cortex-M: SysTick once a millisecond, and
 * __WFI(), which returns for a pending interrupt also while __disable_irq() keeps it from running.
 */
void board_sleep(void);

bool board_stopped(void); /* whether the program is to end; a machine that runs for ever: false */

void can_receive_interrupt(void); /* in main.c; the board's interrupt handler calls it */

#endif
