/*
 * The agents of a scenario as instances of the library, in the arithmetic that this file is
 * compiled for (ONEBIT_ARITHMETIC; names map as in onebit_arithmetic.h). Also the conversions
 * between the simulator's doubles in the paper's units and the library's numbers.
 */
#ifndef GROUP_H
#define GROUP_H

#include "formats.h"
#include "onebit.h"
#include "scenario.h"

#include <stdio.h>

#define group_build ONEBIT_NAME(group_build)
#define group_free ONEBIT_NAME(group_free)
#define group_write_heading ONEBIT_NAME(group_write_heading)
#define group_write_row ONEBIT_NAME(group_write_row)

struct group {
    uint32_t agent_count;
    onebit_config *configs; /* neighbours point into the scenario's topology */
    onebit_agent *agents;
    onebit_estimate *estimates; /* those of agent i begin at topology.first_link[i-1] */
    bool framed; /* all numbers fit the format; else the agents take messages (onebit_frame.h) */
    onebit_real *rows; /* K1, then K2 / sigma */
    double sigma;      /* paper's units of one of the library's noise units */
};

/* Builds and starts all agents of a scenario, which must outlive them, for one run of a seed. */
bool group_build(struct group *group, const struct scenario *scenario,
                 const struct formats *formats, uint32_t seed, uint32_t run,
                 struct problem *problem);

void group_free(struct group *group);

/*
 * The CSV of what the agent at `index` (from 0) believed and commanded, in the paper's units:
 * step,t,u,x1..xn,zhat_<j>.. of its neighbours j. The heading, and the row of a step, after its
 * control and before the plant moves: x of n, and u at clock t.
 */
void group_write_heading(const struct group *group, uint32_t index, FILE *stream);
void group_write_row(const struct group *group, uint32_t index, uint32_t step, uint32_t t, double u,
                     const double *x, FILE *stream);

/* A double as the library's number with the given fraction bits (q31), nearest and saturated. */
static inline onebit_real real_from_double(double value, int fraction_bits)
{
#if ONEBIT_ARITHMETIC == ONEBIT_Q31
    double scaled = value * (double)((uint64_t)1 << fraction_bits);
    if (!(scaled < 2147483647.0)) {
        return INT32_MAX;
    }
    /* Half away from zero: rint would follow the caller's rounding mode. */
    return scaled <= -2147483648.0 ? INT32_MIN : (onebit_real)(scaled + (scaled < 0 ? -0.5 : 0.5));
#else
    (void)fraction_bits;
    return (onebit_real)value;
#endif
}

static inline double double_from_real(onebit_real value, int fraction_bits)
{
#if ONEBIT_ARITHMETIC == ONEBIT_Q31
    return (double)value / (double)((uint64_t)1 << fraction_bits);
#else
    (void)fraction_bits;
    return (double)value;
#endif
}

#endif
