/*
 * The verbs of onebit.h, one text for all arithmetics: start, send, receive, control, clock.
 * Touches nothing but its arguments.
 */
#include "onebit.h"

#include "onebit_codec.h"
#include "onebit_estimator.h"
#include "onebit_random.h"

#include <stddef.h>

#define STALE_FROM 64u /* step errors 64..127 are behind the clock */

/*
 * Shifts of the fixed-point dot products: from the product's fraction bits to the result's. The
 * floating arithmetics ignore them.
 */
#define COMPRESSION_SHIFT(config)                                                                  \
    ((config)->fraction_bits.compression + (config)->fraction_bits.state -                         \
     ONEBIT_NOISE_FRACTION_BITS)
#define STABILIZING_SHIFT(config)                                                                  \
    ((config)->fraction_bits.stabilizing + (config)->fraction_bits.state -                         \
     (config)->fraction_bits.control)
#define CONSENSUS_SHIFT(config) (ONEBIT_NOISE_FRACTION_BITS - (config)->fraction_bits.control)

onebit_status onebit_start(const onebit_config *config, onebit_agent *agent,
                           onebit_estimate *estimates, const onebit_real *initial)
{
#ifdef ONEBIT_UNCHECKED
    onebit_status status = config == NULL ? ONEBIT_NULL : ONEBIT_OK;
#else
    onebit_status status = onebit_check(config);
#endif
    if (status != ONEBIT_OK) {
        return status;
    }
    if (agent == NULL || estimates == NULL) {
        return ONEBIT_NULL;
    }
    for (unsigned k = 0; initial != NULL && k < config->neighbour_count; ++k) {
        if (!(initial[k] <= config->bound && initial[k] >= -config->bound)) {
            return ONEBIT_ESTIMATE;
        }
    }
    for (unsigned k = 0; k < config->neighbour_count; ++k) {
        estimates[k] = (onebit_estimate){initial != NULL ? initial[k] : 0, 0};
    }
    /* Field by field: for a whole structure compilers call memset. */
    agent->estimates = estimates;
    agent->clock = config->start;
    agent->wrapped = false;
    agent->saturated = 0;
    for (unsigned k = 0; k < ONEBIT_REFUSALS; ++k) {
        agent->refused[k] = 0;
    }
    return onebit_advance(config, agent, 1);
}

static bool link_mode(const onebit_config *config)
{
    return onebit_mode_of(&config->format) == ONEBIT_MODE_LINK;
}

/* Whether the format has frames; that it is valid onebit_check has seen. */
static bool framed(const onebit_config *config)
{
    return onebit_encoding_of(&config->format) != ONEBIT_ENCODING_NONE;
}

/* onebit_message_count, where the mode may be a constant. */
static unsigned message_count(const onebit_config *config)
{
    return link_mode(config) ? config->neighbour_count : 1u;
}

/* ONEBIT_OK if a verb can work with the three, the last of which may be anything that it needs. */
static onebit_status usable(const onebit_config *config, const onebit_agent *agent,
                            const void *argument)
{
    if (config == NULL || agent == NULL || argument == NULL) {
        return ONEBIT_NULL;
    }
    return agent->estimates == NULL ? ONEBIT_NOT_STARTED : ONEBIT_OK;
}

/* K2 x / sigma. */
static onebit_real compressed(const onebit_config *config, const onebit_real *x)
{
    return onebit_dot(config->compression, x, config->state_count, COMPRESSION_SHIFT(config));
}

/* The bit of message k, which there is, into *bit. */
static onebit_status draw_bit(const onebit_config *config, const onebit_real *x, unsigned k,
                              uint32_t word, bool *bit)
{
    onebit_real z = compressed(config, x);
    if (!onebit_finite(z)) {
        return ONEBIT_STATE;
    }
    bool by_link = link_mode(config) && config->sent_thresholds != NULL;
    onebit_real threshold = by_link ? config->sent_thresholds[k] : config->threshold;
    *bit = (onebit_probability)(word >> 1) < onebit_distribution(threshold, z);
    return ONEBIT_OK;
}

onebit_status onebit_encode(const onebit_config *config, const onebit_real *x, unsigned k,
                            uint32_t word, bool *bit)
{
    if (config == NULL || x == NULL || bit == NULL) {
        return ONEBIT_NULL;
    }
    return k < message_count(config) ? draw_bit(config, x, k, word, bit) : ONEBIT_MESSAGE;
}

/* Message k of this step, drawn with its own word. */
static onebit_status draw_message(const onebit_config *config, const onebit_agent *agent,
                                  const onebit_real *x, unsigned k, onebit_message *message)
{
    onebit_status status = usable(config, agent, x);
    if (status != ONEBIT_OK) {
        return status;
    }
    if (k >= message_count(config)) {
        return ONEBIT_MESSAGE;
    }
    uint32_t link = link_mode(config) ? config->first_link + k : config->agent;
    message->sender = config->agent;
    message->receiver = link_mode(config) ? config->neighbours[k] : 0;
    message->step = (uint8_t)(agent->clock % ONEBIT_STEP_MODULUS);
    return draw_bit(config, x, k, onebit_random_word(config->seed, config->run, link, agent->clock),
                    &message->bit);
}

onebit_status onebit_send_message(const onebit_config *config, onebit_agent *agent,
                                  const onebit_real *x, unsigned k, onebit_message *message)
{
    onebit_message drawn;
    onebit_status status = draw_message(config, agent, x, k, &drawn);
    if (status == ONEBIT_OK && message == NULL) {
        return ONEBIT_NULL;
    }
    if (status == ONEBIT_OK) {
        *message = drawn;
        message->has_step = true;
    }
    return status;
}

onebit_status onebit_send(const onebit_config *config, onebit_agent *agent, const onebit_real *x,
                          unsigned k, onebit_frame *frame)
{
    onebit_message message;
    onebit_status status = draw_message(config, agent, x, k, &message);
    if (status != ONEBIT_OK) {
        return status;
    }
    if (frame == NULL) {
        return ONEBIT_NULL;
    }
    if (!framed(config)) {
        return ONEBIT_CONFIG_FORMAT;
    }
    onebit_write_frame(&config->format, &message, frame);
    return ONEBIT_OK;
}

static void count(uint16_t *counter)
{
    if (*counter != UINT16_MAX) {
        ++*counter;
    }
}

/* A frame's code on its way out: from ONEBIT_REFUSED_FIRST on it moves its counter. */
static onebit_status counted(onebit_agent *agent, onebit_status status)
{
    if (status >= ONEBIT_REFUSED_FIRST) {
        count(&agent->refused[status - ONEBIT_REFUSED_FIRST]);
    }
    return status;
}

/* onebit_receive_message without its counters. */
static onebit_status take(const onebit_config *config, onebit_agent *agent,
                          const onebit_message *message, uint32_t linked)
{
    if (link_mode(config) && message->receiver != config->agent) {
        return ONEBIT_REFUSED_UNKNOWN;
    }
    unsigned k = 0;
    while (k < config->neighbour_count && config->neighbours[k] != message->sender) {
        ++k;
    }
    if (k == config->neighbour_count) {
        return ONEBIT_REFUSED_UNKNOWN;
    }
    uint32_t own = (uint32_t)1 << k;
    if ((linked & own) == 0) {
        return ONEBIT_REFUSED_UNLINKED;
    }
    uint32_t error = message->has_step ? (message->step - agent->clock) % ONEBIT_STEP_MODULUS : 0;
    if (error != 0) {
        return error >= STALE_FROM ? ONEBIT_REFUSED_STALE : ONEBIT_REFUSED_EARLY;
    }
    if ((agent->heard & own) != 0) {
        return ONEBIT_REFUSED_REPEATED;
    }
    agent->heard |= own;
    const onebit_real *thresholds = config->heard_thresholds;
    onebit_update(&agent->estimates[k], &agent->gain,
                  thresholds != NULL ? thresholds[k] : config->threshold, &config->bound,
                  message->bit);
    return ONEBIT_OK;
}

onebit_status onebit_receive_message(const onebit_config *config, onebit_agent *agent,
                                     const onebit_message *message, uint32_t linked)
{
    onebit_status status = usable(config, agent, message);
    return status != ONEBIT_OK ? status : counted(agent, take(config, agent, message, linked));
}

onebit_status onebit_receive(const onebit_config *config, onebit_agent *agent,
                             const onebit_frame *frame, uint32_t linked, onebit_message *message)
{
    onebit_status status = usable(config, agent, frame);
    if (status != ONEBIT_OK) {
        return status;
    }
    if (!framed(config)) {
        return ONEBIT_CONFIG_FORMAT;
    }
    onebit_message decoded;
    status = onebit_read_frame(&config->format, frame, &decoded);
    if (status == ONEBIT_OK) {
        status = take(config, agent, &decoded, linked);
        if (message != NULL) {
            *message = decoded;
        }
    }
    return counted(agent, status);
}

/*
 * The clock runs on over 2^32 - 1, so that neither residues nor random words repeat soon; `wrapped`
 * tells that it has, and the gains then stay those of 2^32 - 1, whose reciprocal is given.
 */
static void begin_step(const onebit_config *config, onebit_agent *agent, uint32_t clock,
                       bool wrapped, onebit_reciprocal reciprocal)
{
    agent->clock = clock;
    agent->wrapped = wrapped;
    agent->heard = 0;
    agent->gain = onebit_gain_of(config->estimator_gain, reciprocal);
}

/* The sum of zhat - K2 x over the neighbours that were heard and are linked. */
static onebit_sum disagreement(const onebit_config *config, const onebit_agent *agent,
                               uint32_t linked, onebit_real z)
{
    onebit_sum sum = {0};
    linked &= agent->heard;
    /* To neighbour_count and not to the last bit, which a fault in memory may have set. */
    for (unsigned k = 0; k < config->neighbour_count; ++k, linked >>= 1) {
        if (linked & 1u) {
            onebit_add_difference(&sum, agent->estimates[k].value, z);
        }
    }
    return sum;
}

onebit_status onebit_control(const onebit_config *config, onebit_agent *agent, const onebit_real *x,
                             uint32_t linked, onebit_real *u)
{
    onebit_status status = usable(config, agent, x);
    if (status != ONEBIT_OK) {
        return status;
    }
    if (u == NULL) {
        return ONEBIT_NULL;
    }
    onebit_real z = compressed(config, x);
    onebit_sum sum = disagreement(config, agent, linked, z);
    onebit_real stabilizing =
        onebit_dot(config->stabilizing, x, config->state_count, STABILIZING_SHIFT(config));
    uint32_t next = agent->clock + 1u;
    bool wrapped = agent->wrapped || next == 0;
    onebit_reciprocal reciprocal = onebit_reciprocal_of(wrapped ? UINT32_MAX : next);
    onebit_real control =
        onebit_combine(stabilizing, onebit_gain_of(config->control_gain, reciprocal), sum,
                       CONSENSUS_SHIFT(config));
    if (!onebit_finite(control)) {
        return ONEBIT_STATE;
    }
    if (onebit_at_end(z) || onebit_at_end(stabilizing) || onebit_at_end(control)) {
        count(&agent->saturated);
    }
    *u = control;
    begin_step(config, agent, next, wrapped, reciprocal);
    return ONEBIT_OK;
}

onebit_status onebit_advance(const onebit_config *config, onebit_agent *agent, int32_t steps)
{
    onebit_status status = usable(config, agent, agent);
    if (status != ONEBIT_OK) {
        return status;
    }
    uint32_t clock = agent->clock + (uint32_t)steps;
    bool wrapped = agent->wrapped || (steps >= 0 && clock < agent->clock);
    if (!wrapped && (clock <= config->start || (steps < 0 && clock > agent->clock))) {
        return ONEBIT_CLOCK;
    }
    begin_step(config, agent, clock, wrapped, onebit_reciprocal_of(wrapped ? UINT32_MAX : clock));
    return ONEBIT_OK;
}
