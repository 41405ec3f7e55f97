/*
 * Part of a group on a slcan line: agents of a scenario in this process, the others behind the line
 * (a board, an emulator, an adapter with its bus), and the master's SYNC from here. The process is
 * itself the bus between its agents, and steps them all in one loop.
 */
#ifndef SERIAL_GROUP_H
#define SERIAL_GROUP_H

#include "node.h"

#include <stdbool.h>

#define SERIAL_GROUP_PREFIX "slcan:" /* of the interface's name; then the line's path */

/*
 * Runs the agents, and tells all nodes to stop at the end. Of *nodes `sync` is not looked at;
 * period 0 is lock step: a step ends when the messages of all agents behind the line have come.
 * Exit status as of nodes_run.
 */
int serial_group_run(const struct nodes *nodes, struct problem *problem);

#endif
