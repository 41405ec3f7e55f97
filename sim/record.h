/* The files that a run leaves in its output folder: summary.json, mse.csv, trajectory.csv. */
#ifndef RECORD_H
#define RECORD_H

#include "ensemble.h"
#include "problem.h"
#include "scenario.h"

#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>

/* What stands in summary.json beside the rows. */
struct summary {
    double slope; /* NaN: not enough rows */
    uint32_t slope_first;
    uint32_t slope_last;
    double seconds; /* wall time of the runs */
};

/* Makes the folder, with its parents; false and *problem unless it is there and can be written. */
bool record_prepare(const char *folder, struct problem *problem);

/* Writes the three files; each appears whole or not at all. */
bool record_write(const char *folder, const struct ensemble *ensemble,
                  const struct scenario *scenario, const struct summary *summary,
                  struct problem *problem);

/* Mean load of the bus: wire bits of a run over the bits of its time. */
double record_bus_load(const struct ensemble *ensemble, const struct scenario *scenario);

/* Mean seconds from send to the end of the frame, over messages; 0 where nothing was delivered. */
double record_latency(const struct ensemble *ensemble);

/* The same figures for a person. */
void record_print(FILE *stream, const struct ensemble *ensemble, const struct scenario *scenario,
                  const struct summary *summary);

#endif
