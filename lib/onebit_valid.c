/*
 * onebit_valid of onebit.h: an agent's invariants. In an object of its own, which firmware without
 * it does not link. Touches nothing but its arguments.
 */
#include "onebit.h"

#include "onebit_arithmetic.h"

#include <stddef.h>

bool onebit_valid(const onebit_config *config, const onebit_agent *agent)
{
    if (config == NULL || agent == NULL || agent->estimates == NULL) {
        return false;
    }
    /* Every comparison is made, so that the time does not depend on what is wrong. */
    unsigned count = config->neighbour_count;
    uint32_t t = agent->wrapped ? UINT32_MAX : agent->clock;
    bool valid = t > config->start &&
                 onebit_gain_valid(agent->gain,
                                   onebit_gain_of(config->estimator_gain, onebit_reciprocal_of(t)));
    uint32_t strangers = ~(uint32_t)0 << 1 << (count - 1u);
    valid = valid && (agent->heard & strangers) == 0;
    for (unsigned k = 0; k < count; ++k) {
        onebit_real value = agent->estimates[k].value;
        valid = valid && value <= config->bound && value >= -config->bound;
    }
    return valid;
}
