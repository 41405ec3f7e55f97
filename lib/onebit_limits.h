/* Limits of the agent library. Arithmetic-independent. */
#ifndef ONEBIT_LIMITS_H
#define ONEBIT_LIMITS_H

#define ONEBIT_STATES_MAX 16     /* n, states of a plant */
#define ONEBIT_NEIGHBOURS_MAX 32 /* of one agent: `heard` in onebit_agent is a 32-bit mask */

#endif
