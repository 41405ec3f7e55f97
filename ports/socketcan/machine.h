/*
 * One machine: an agent of a scenario as an instance of the library, its plant, and the graph of
 * the step that it is in. Does what the simulator does with one agent of a run, with the same
 * random words and so the same bits, but takes and gives frames. No input or output but the CSV.
 * machine.c is compiled once for each arithmetic.
 */
#ifndef MACHINE_H
#define MACHINE_H

#include "formats.h"
#include "onebit_limits.h"
#include "scenario.h"
#include "simulation.h"

#include <stdint.h>
#include <stdio.h>

#define MACHINE_FRAMES_MAX ONEBIT_NEIGHBOURS_MAX /* that one sends in a step */

/* Which machine of a scenario, and the key of its random words. */
struct machine_choice {
    uint32_t agent; /* from 1 */
    uint32_t seed;
    uint32_t run;
};

struct machine_report {
    uint32_t steps;                    /* completed; stops at 2^32 - 1 */
    uint32_t clock;                    /* t of the step that it is in or begins next */
    uint64_t taken;                    /* neighbours' bits that became estimates */
    uint64_t aligned;                  /* times that the clock moved to the group's */
    uint64_t refused[ONEBIT_REFUSALS]; /* by code, as in onebit_agent, but not saturating */
    double disagreement; /* mean over the neighbours heard in the last step in which any was of
                            (zhat - K2 x)^2, the paper's units; NaN while none was */
};

struct machine;

/* What one arithmetic offers. A machine belongs to one thread and is used with its own verbs. */
struct machine_verbs {
    /* A machine at t0 + 1; null and *problem if it cannot be. The scenario must outlive it. */
    struct machine *(*create)(const struct scenario *scenario, const struct formats *formats,
                              const struct machine_choice *choice, struct problem *problem);
    void (*destroy)(struct machine *machine); /* null is allowed */

    /*
     * Before begin, where SYNC told the step (t modulo 128): moves the clock to the group's.
     * ONEBIT_NO_STEP does nothing.
     */
    void (*align)(struct machine *machine, uint8_t step);

    /* Begins a step: draws its graph, encodes. Writes the frames to send, returns how many. */
    uint32_t (*begin)(struct machine *machine, onebit_frame frames[MACHINE_FRAMES_MAX]);

    /* A frame that is neither SYNC nor a stop, heard in the step; true if it was taken. */
    bool (*hear)(struct machine *machine, const onebit_frame *frame);

    /*
     * Ends the step: controls, writes its row where `csv` is not null, moves the plant, and the
     * clock too where the frames that it heard were of the group's other step (alignment.h).
     */
    void (*end)(struct machine *machine, FILE *csv);

    /* Moves the clock by steps that were missed; between end and begin. */
    void (*miss)(struct machine *machine, int32_t steps);

    void (*write_header)(const struct machine *machine, FILE *csv);
    void (*report)(const struct machine *machine, struct machine_report *report);

    /* Its neighbours, ascending. */
    uint32_t (*neighbours)(const struct machine *machine, const uint32_t **numbers);
};

extern const struct machine_verbs onebit_f64_machine;
extern const struct machine_verbs onebit_f32_machine;
extern const struct machine_verbs onebit_q31_machine;

#endif
