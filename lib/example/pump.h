/* One of three pumps that agree on a pressure; see pump.c. Pressures in bar, Q26. */
#ifndef PUMP_H
#define PUMP_H

#include "onebit_frame.h"

#include <stdbool.h>
#include <stdint.h>

bool pump_start(void);
void pump_step_begins(int32_t pressure);      /* on SYNC, with the pressure just measured */
void pump_receive(const onebit_frame *frame); /* on every other frame of the bus */
int32_t pump_step_ends(void);                 /* just before the next SYNC: change to apply */

void pump_send(const onebit_frame *frame); /* the board's: queues a frame for sending */

#endif
