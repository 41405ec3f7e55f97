/*
 * What onebit-node tells of an agent: its summary at the end, for a person or a program, and the
 * file of its rows. Writes standard output and the file.
 */
#ifndef SUMMARY_H
#define SUMMARY_H

#include "machine.h"
#include "node.h"

#include <cjson/cJSON.h>
#include <stdint.h>
#include <stdio.h>

struct summary {
    const struct nodes *nodes;
    uint32_t agent;
    const char *ended; /* by what: signal, stop or steps */
    double seconds;
    struct machine_report report;
    uint64_t frames_out;
    uint64_t frames_in;
    uint64_t duplicates; /* messages of another node under the own number */
    uint64_t syncs;
    uint64_t sync_refused;
    uint64_t deadline_misses;
    uint64_t late;           /* frames withdrawn, their step was over */
    uint64_t queue_full;     /* refusals of a full transmit queue, every attempt */
    uint64_t lost;           /* frames that the receive queue had no room for */
    uint64_t error_frames;   /* reports of the controller */
    uint64_t bus_off;        /* those among them that say so */
    uint64_t interface_down; /* times that it went down */
};

/* For a program; to be deleted by the caller. */
cJSON *summary_object(const struct summary *summary);

void summary_print_object(const cJSON *object);

/* A line for a person; what did not happen is not told. */
void summary_print(const struct summary *summary);

/* FILE of --csv, or with several agents FILE with the agent's number before its ending. Null and
 * *problem where it cannot be written. */
FILE *summary_open_csv(const struct nodes *nodes, uint32_t agent, struct problem *problem);

#endif
