/*
 * The agent of onebit.h, one text for all arithmetics: configuration check, encoder, receiver,
 * controller, clock. Touches nothing but its arguments.
 */
#include "onebit.h"

#include "onebit_estimator.h"

#include <stddef.h>

#define RATIO_LIMIT ONEBIT_REAL(4.0) /* of |threshold| + bound */
#define ESTIMATOR_GAIN_LIMIT_LOG2 16 /* noise units; the fixed-point gain's exponent from -1 */
#define STALE_FROM 64u               /* step errors 64..127 are behind the clock */

/*
 * Shifts of the fixed-point dot products: from the product's fraction bits to the result's. The
 * floating arithmetics have no formats and ignore them.
 */
#if ONEBIT_ARITHMETIC == ONEBIT_Q31
#define NOISE_FRACTION_BITS 27
#define COMPRESSION_SHIFT(config)                                                                  \
    ((config)->fraction_bits.compression + (config)->fraction_bits.state - NOISE_FRACTION_BITS)
#define STABILIZING_SHIFT(config)                                                                  \
    ((config)->fraction_bits.stabilizing + (config)->fraction_bits.state -                         \
     (config)->fraction_bits.control)
#define CONSENSUS_SHIFT(config) (NOISE_FRACTION_BITS - (config)->fraction_bits.control)

static bool formats_valid(const onebit_config *config)
{
    /* Through uint8_t a negative number is above every limit. */
    return (uint8_t)config->fraction_bits.stabilizing <= 46 &&
           (uint8_t)config->fraction_bits.compression <= 46 &&
           (uint8_t)config->fraction_bits.state <= 31 &&
           (uint8_t)config->fraction_bits.control <= 31;
}
#else
#define COMPRESSION_SHIFT(config) 0
#define STABILIZING_SHIFT(config) 0
#define CONSENSUS_SHIFT(config) 0

static bool formats_valid(const onebit_config *config)
{
    (void)config;
    return true;
}
#endif

onebit_status onebit_check(const onebit_config *config)
{
    if (config == NULL || config->neighbours == NULL || config->stabilizing == NULL ||
        config->compression == NULL) {
        return ONEBIT_NULL;
    }
    if (config->agent == 0) {
        return ONEBIT_CONFIG_AGENT;
    }
    if (config->neighbour_count == 0 || config->neighbour_count > ONEBIT_NEIGHBOURS_MAX) {
        return ONEBIT_CONFIG_NEIGHBOURS;
    }
    uint32_t previous = 0;
    for (unsigned k = 0; k < config->neighbour_count; ++k) {
        if (config->neighbours[k] <= previous || config->neighbours[k] == config->agent) {
            return ONEBIT_CONFIG_NEIGHBOURS;
        }
        previous = config->neighbours[k];
    }
    if (config->state_count == 0 || config->state_count > ONEBIT_STATES_MAX) {
        return ONEBIT_CONFIG_STATES;
    }
    if (!formats_valid(config)) {
        return ONEBIT_CONFIG_FRACTION_BITS;
    }
    if (!onebit_row_valid(config->stabilizing, config->state_count)) {
        return ONEBIT_CONFIG_STABILIZING;
    }
    if (!onebit_row_valid(config->compression, config->state_count)) {
        return ONEBIT_CONFIG_COMPRESSION;
    }
    /* Written so that a NaN is refused. */
    if (!(config->threshold < RATIO_LIMIT && config->threshold > -RATIO_LIMIT)) {
        return ONEBIT_CONFIG_THRESHOLD;
    }
    onebit_real distance = config->threshold < 0 ? -config->threshold : config->threshold;
    if (!(config->bound > 0 && config->bound <= RATIO_LIMIT - distance)) {
        return ONEBIT_CONFIG_BOUND;
    }
    if (!onebit_coefficient_valid(config->estimator_gain) ||
        !onebit_coefficient_within(config->estimator_gain, ESTIMATOR_GAIN_LIMIT_LOG2)) {
        return ONEBIT_CONFIG_ESTIMATOR_GAIN;
    }
    if (!onebit_coefficient_valid(config->control_gain)) {
        return ONEBIT_CONFIG_CONTROL_GAIN;
    }
    if (config->start == 0 || config->start == UINT32_MAX) {
        return ONEBIT_CONFIG_START;
    }
    return onebit_frame_agent_limit(&config->format) == 0 ? ONEBIT_CONFIG_FORMAT : ONEBIT_OK;
}

onebit_status onebit_start(const onebit_config *config, onebit_agent *agent, onebit_link *links,
                           const onebit_real *estimates)
{
    onebit_status status = onebit_check(config);
    if (status != ONEBIT_OK) {
        return status;
    }
    if (agent == NULL || links == NULL) {
        return ONEBIT_NULL;
    }
    for (unsigned k = 0; estimates != NULL && k < config->neighbour_count; ++k) {
        if (!(estimates[k] <= config->bound && estimates[k] >= -config->bound)) {
            return ONEBIT_ESTIMATE;
        }
    }
    for (unsigned k = 0; k < config->neighbour_count; ++k) {
        links[k] = (onebit_link){estimates != NULL ? estimates[k] : 0, 0};
    }
    *agent = (onebit_agent){.links = links, .clock = config->start};
    return onebit_advance(config, agent, 1);
}

/* K2 x / sigma. */
static onebit_real compressed(const onebit_config *config, const onebit_real *x)
{
    return onebit_dot(config->compression, x, config->state_count, COMPRESSION_SHIFT(config));
}

onebit_status onebit_encode(const onebit_config *config, const onebit_real *x, uint32_t word,
                            bool *bit)
{
    if (config == NULL || x == NULL || bit == NULL) {
        return ONEBIT_NULL;
    }
    onebit_real z = compressed(config, x);
    if (!onebit_finite(z)) {
        return ONEBIT_STATE;
    }
    *bit = (onebit_probability)(word >> 1) < onebit_distribution(config->threshold, z);
    return ONEBIT_OK;
}

/* A frame's code on its way out: from ONEBIT_UNKNOWN on it moves its counter. */
static onebit_status counted(onebit_agent *agent, onebit_status status)
{
    if (status >= ONEBIT_UNKNOWN && agent->refused[status - ONEBIT_UNKNOWN] != UINT16_MAX) {
        ++agent->refused[status - ONEBIT_UNKNOWN];
    }
    return status;
}

/* onebit_receive_message without its counters. */
static onebit_status take(const onebit_config *config, onebit_agent *agent,
                          const onebit_message *message)
{
    if (config->format.mode == ONEBIT_LINK && message->receiver != config->agent) {
        return ONEBIT_UNKNOWN;
    }
    unsigned k = 0;
    while (k < config->neighbour_count && config->neighbours[k] != message->sender) {
        ++k;
    }
    if (k == config->neighbour_count) {
        return ONEBIT_UNKNOWN;
    }
    uint32_t error = message->has_step ? (message->step - agent->clock) % ONEBIT_STEP_MODULUS : 0;
    if (error != 0) {
        return error >= STALE_FROM ? ONEBIT_STALE : ONEBIT_EARLY;
    }
    if (agent->heard >> k & 1u) {
        return ONEBIT_REPEATED;
    }
    agent->heard |= (uint32_t)1 << k;
    onebit_estimate(&agent->links[k], agent->gain, config->threshold, config->bound, message->bit);
    return ONEBIT_OK;
}

onebit_status onebit_receive_message(const onebit_config *config, onebit_agent *agent,
                                     const onebit_message *message)
{
    if (config == NULL || agent == NULL || message == NULL) {
        return ONEBIT_NULL;
    }
    return counted(agent, take(config, agent, message));
}

onebit_status onebit_receive(const onebit_config *config, onebit_agent *agent,
                             const onebit_frame *frame)
{
    if (config == NULL || agent == NULL) {
        return ONEBIT_NULL;
    }
    onebit_message message;
    onebit_status status = onebit_frame_decode(&config->format, frame, &message);
    return counted(agent, status != ONEBIT_OK ? status : take(config, agent, &message));
}

/* After 2^32 - 1 comes 2^32 - 128: residues run on, gains stay where they are. */
static uint32_t clock_after(uint32_t clock, uint32_t steps)
{
    uint32_t after = clock + steps;
    return after < clock ? after | (0u - ONEBIT_STEP_MODULUS) : after;
}

static void begin_step(const onebit_config *config, onebit_agent *agent, uint32_t clock,
                       onebit_reciprocal reciprocal)
{
    agent->clock = clock;
    agent->heard = 0;
    agent->gain = onebit_gain_of(config->estimator_gain, reciprocal);
}

onebit_status onebit_control(const onebit_config *config, onebit_agent *agent, const onebit_real *x,
                             onebit_real *u)
{
    if (config == NULL || agent == NULL || x == NULL || u == NULL) {
        return ONEBIT_NULL;
    }
    onebit_real z = compressed(config, x);
    onebit_sum sum = 0;
    const onebit_link *link = agent->links;
    for (uint32_t heard = agent->heard; heard != 0; heard >>= 1, ++link) {
        if (heard & 1u) {
            sum += (onebit_sum)link->estimate - z;
        }
    }
    onebit_real stabilizing =
        onebit_dot(config->stabilizing, x, config->state_count, STABILIZING_SHIFT(config));
    uint32_t next = clock_after(agent->clock, 1);
    onebit_reciprocal reciprocal = onebit_reciprocal_of(next);
    onebit_real control =
        onebit_combine(stabilizing, onebit_gain_of(config->control_gain, reciprocal), sum,
                       CONSENSUS_SHIFT(config));
    if (!onebit_finite(control)) {
        return ONEBIT_STATE;
    }
    *u = control;
    begin_step(config, agent, next, reciprocal);
    return ONEBIT_OK;
}

onebit_status onebit_advance(const onebit_config *config, onebit_agent *agent, int32_t steps)
{
    if (config == NULL || agent == NULL) {
        return ONEBIT_NULL;
    }
    uint32_t clock;
    if (steps < 0) {
        clock = agent->clock + (uint32_t)steps;
        if (clock > agent->clock || clock <= config->start) {
            return ONEBIT_CLOCK;
        }
    } else {
        clock = clock_after(agent->clock, (uint32_t)steps);
    }
    begin_step(config, agent, clock, onebit_reciprocal_of(clock));
    return ONEBIT_OK;
}
