/*
 * The graph of a step, drawn from the topology's Markov chain with the words of link 0. The graph
 * at clock t follows from all draws since t0 + 1, so it is the same in a run, its replay and every
 * node whose clock is t, and a clock that jumps takes the draws between along. The last 128 graphs
 * are kept, for a clock that moves back to the group's.
 */
#ifndef CHAIN_H
#define CHAIN_H

#include "onebit_frame.h"
#include "topology.h"

#include <stdint.h>

struct chain {
    const struct topology *topology;
    const double *law; /* of the next draw */
    uint32_t seed;
    uint32_t run;
    uint32_t next;                        /* the clock that is drawn next */
    uint32_t graphs[ONEBIT_STEP_MODULUS]; /* of the clocks before it, at their residues */
};

/* Begins at clock `first`, t0 + 1. */
void chain_begin(struct chain *chain, const struct topology *topology, uint32_t seed, uint32_t run,
                 uint32_t first);

/* The graph, from 0, of clock t: not below the first, and at most 128 behind the last asked. */
uint32_t chain_graph(struct chain *chain, uint32_t t);

#endif
