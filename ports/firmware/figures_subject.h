/*
 * The operations that figures_agent.c counts, where the library has them inline only or a step
 * takes several. A file of their own: they are compiled as the library is, the counting for little
 * space.
 */
#ifndef FIGURES_SUBJECT_H
#define FIGURES_SUBJECT_H

#include "onebit.h"
#include "onebit_arithmetic.h"

#define NEIGHBOURS 3
#define STATES 4

/* An input to every operation; each takes from it what it needs. */
struct figures_trial {
    onebit_config config;
    onebit_agent agent;
    onebit_estimate estimates[NEIGHBOURS];
    onebit_real x[STATES];
    onebit_real u; /* of the CDF */
    uint32_t word;
    bool bits[NEIGHBOURS];
};

#define figures_update ONEBIT_NAME(figures_update)
#define figures_cdf ONEBIT_NAME(figures_cdf)
#define figures_step ONEBIT_NAME(figures_step)

/* The estimator update, as onebit_receive_message makes it for a neighbour that was heard. */
void figures_update(const onebit_config *config, const onebit_agent *agent,
                    onebit_estimate *estimate, bool bit);

onebit_probability figures_cdf(onebit_real u);

/* All that an agent does in a step but talk to its bus: word, bit, frame, three frames heard, u. */
void figures_step(struct figures_trial *trial);

#endif
