/* The process that steps a group: sends CANopen's SYNC, and at its end tells the nodes to stop. */
#ifndef MASTER_H
#define MASTER_H

#include "problem.h"
#include "scenario.h"

#include <stdbool.h>
#include <stdint.h>

struct master {
    const struct scenario *scenario;
    const char *interface;
    /*
     * Seconds between two SYNC. 0: as fast as the group can: the next one follows when all
     * messages of the step were heard, which is when every node has them in its queue, or after a
     * second if some do not come.
     */
    double period;
    uint32_t steps; /* after which it ends; 0: when it is told to */
    uint32_t seed;  /* with run the key of the chain: how many messages a step has */
    uint32_t run;
    bool json;
};

/* Exit status: 0 ended as told, 2 bad use or input, 1 failure; *problem says what was wrong. */
int master_run(const struct master *master, struct problem *problem);

#endif
