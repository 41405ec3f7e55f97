/* One of three pumps that agree on a pressure; see pump.c. Pressures in bar; in q31 as Q5.26. */
#ifndef PUMP_H
#define PUMP_H

#include "onebit.h"

bool pump_start(void);
bool pump_step_begins(onebit_real pressure);  /* on SYNC, with the pressure just measured */
void pump_receive(const onebit_frame *frame); /* on every other frame of the bus */
bool pump_step_ends(onebit_real *change);     /* just before the next SYNC: what to apply */

void pump_send(const onebit_frame *frame); /* the board's: queues a frame for sending */

#endif
