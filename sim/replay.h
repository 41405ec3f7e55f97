/*
 * One agent fed from a recorded bus log: what it believed and commanded. replay.c is compiled once
 * for each arithmetic.
 */
#ifndef REPLAY_H
#define REPLAY_H

#include "formats.h"
#include "log.h"
#include "scenario.h"
#include "simulation.h"

#include <stdint.h>
#include <stdio.h>

struct replay {
    uint32_t agent; /* number, from 1 */
    uint32_t seed;  /* with `run` the key of the chain that switches the topology */
    uint32_t run;
};

/*
 * Reads the log to its end and prints CSV, a row a step: `step,t,u,x1..xn,zhat_<j>..`, in the
 * paper's units: at step k (from 0) the clock is t = t0+1+k, x the state at t, zhat the estimates
 * after the frames heard at t, u the control at t. SYNC bounds the steps, the first one begins
 * t0+1; frames before it and time stamps are ignored. False and *problem if the log is malformed.
 */
bool replay(enum arithmetic arithmetic, const struct scenario *scenario,
            const struct formats *formats, const struct replay *what, struct log_reader *log,
            FILE *stream, struct problem *problem);

typedef bool replay_function(const struct scenario *scenario, const struct formats *formats,
                             const struct replay *what, struct log_reader *log, FILE *stream,
                             struct problem *problem);
replay_function onebit_f64_replay;
replay_function onebit_f32_replay;
replay_function onebit_q31_replay;

#endif
