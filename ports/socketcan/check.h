/* What a CAN interface lacks for nodes to run on it, for a person. */
#ifndef CHECK_H
#define CHECK_H

#include <stdbool.h>

/*
 * Looks at kernel, interface, state, bit rate and right, in this order, and prints a line for each,
 * with the command that mends it where something is missing. True if nothing is. Changes nothing.
 */
bool check_interface(const char *interface);

#endif
