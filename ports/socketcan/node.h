/*
 * Nodes of a group on a CAN interface: steps their machines, by SYNC or by the system's clock,
 * until they are told to end. Several may run in one process, each with its own socket.
 */
#ifndef NODE_H
#define NODE_H

#include "formats.h"
#include "problem.h"
#include "scenario.h"
#include "simulation.h"

#include <stdbool.h>
#include <stdint.h>

struct nodes {
    const struct scenario *scenario;
    const struct formats *formats;
    const char *interface;
    enum arithmetic arithmetic;
    const uint32_t *agents; /* numbers in the scenario, ascending */
    uint32_t agent_count;
    uint32_t seed;
    uint32_t run;
    bool sync;       /* stepped by SYNC; else by the system's clock */
    double period;   /* seconds; 0: not known, then no SYNC comes too soon */
    uint32_t steps;  /* after which a node ends; 0: it does not */
    const char *csv; /* path, or null; with several agents `-<agent>` is put before its ending */
    bool json;       /* the summary for a program */
};

/* Exit status: 0 ended as told, 2 bad use or input, 1 failure; *problem says what was wrong. */
int nodes_run(const struct nodes *nodes, struct problem *problem);

#endif
