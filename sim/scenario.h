/*
 * A scenario file (YAML) as a checked structure, in the paper's units. The format is documented in
 * README.md. What scenario_load accepts, every other module may rely on.
 */
#ifndef SCENARIO_H
#define SCENARIO_H

#include "onebit_frame.h"
#include "problem.h"
#include "topology.h"

#include <stdbool.h>
#include <stdint.h>

enum bus_model { BUS_IDEAL, BUS_CAN };

struct scenario {
    char *path; /* of the file, for messages */
    char *name;

    uint32_t state_count; /* n */
    double *A;            /* n x n, row-major */
    double *B;            /* n */
    bool integer_plant;   /* plant arithmetic q31 */

    double *stabilizing; /* K1, n */
    double *compression; /* K2, n */
    double beta;
    double gamma;
    uint32_t t0;
    double threshold; /* c */
    double bound;     /* M */
    double sigma;

    struct topology topology;
    double *initial_states; /* agent_count x n */
    double initial_estimate;

    onebit_format format;
    enum bus_model bus_model;
    double bitrate; /* bit/s */

    bool has_fixed; /* the file chose the formats; else formats_choose does */
    int state_fraction_bits;
    int control_fraction_bits;

    double period;  /* seconds a step */
    uint32_t steps; /* t0 + 1 + steps < 2^32: the clock does not return within a run */
};

/* Most graphs of a scenario: the chain's law costs their number's cube. */
#define SCENARIO_GRAPHS_MAX 1000u

/*
 * Reads and checks a file. On failure *problem holds `file:line: key: what is wrong` (or
 * `file: ...` where there is no line) and nothing is allocated. A key is written with its sections
 * and, in lists, its place from 1: `topology.graphs[1].edges[3]`.
 */
bool scenario_load(struct scenario *scenario, const char *path, struct problem *problem);

void scenario_free(struct scenario *scenario);

#endif
