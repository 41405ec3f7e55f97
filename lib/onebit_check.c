/*
 * onebit_check of onebit.h: whether a configuration is one that the verbs can work with. In an
 * object of its own: where onebit_start leaves the check to bring-up (README.md), firmware does not
 * link it. Touches nothing but its argument.
 */
#include "onebit.h"

#include "onebit_arithmetic.h"

#include <stddef.h>

#define RATIO_LIMIT ONEBIT_NOISE(4.0) /* of |threshold| + bound */
#define ESTIMATOR_GAIN_LIMIT_LOG2 16u /* noise units; the fixed-point gain's places from -14 */
#define ROW_BITS_LAST 46
#define SIGNAL_BITS_LAST 31

static onebit_status check_numbers(const onebit_config *config)
{
    /* Without frames there is no limit, and what is not valid has no agent at all. */
    bool framed = config->format.encoding != ONEBIT_ENCODING_NONE;
    uint32_t limit = framed ? onebit_frame_agent_limit(&config->format) : UINT32_MAX;
    if (limit == 0 || config->format.mode > ONEBIT_MODE_LINK) {
        return ONEBIT_CONFIG_FORMAT;
    }
    if (config->agent == 0 || config->agent > limit) {
        return ONEBIT_CONFIG_AGENT;
    }
    if (config->neighbour_count == 0 || config->neighbour_count > ONEBIT_NEIGHBOURS_MAX) {
        return ONEBIT_CONFIG_NEIGHBOURS;
    }
    uint32_t previous = 0;
    for (unsigned k = 0; k < config->neighbour_count; ++k) {
        uint32_t number = config->neighbours[k];
        if (number <= previous || number > limit || number == config->agent) {
            return ONEBIT_CONFIG_NEIGHBOURS;
        }
        previous = number;
    }
    return ONEBIT_OK;
}

static bool formats_valid(const onebit_config *config)
{
    /* Through uint8_t a negative number is above every limit. */
    return ONEBIT_ARITHMETIC != ONEBIT_Q31 ||
           ((uint8_t)config->fraction_bits.stabilizing <= ROW_BITS_LAST &&
            (uint8_t)config->fraction_bits.compression <= ROW_BITS_LAST &&
            (uint8_t)config->fraction_bits.state <= SIGNAL_BITS_LAST &&
            (uint8_t)config->fraction_bits.control <= SIGNAL_BITS_LAST);
}

static onebit_status check_rows(const onebit_config *config)
{
    if (config->state_count == 0 || config->state_count > ONEBIT_STATES_MAX) {
        return ONEBIT_CONFIG_STATES;
    }
    if (!formats_valid(config)) {
        return ONEBIT_CONFIG_FRACTION_BITS;
    }
    if (!onebit_row_valid(config->stabilizing, config->state_count)) {
        return ONEBIT_CONFIG_STABILIZING;
    }
    return onebit_row_valid(config->compression, config->state_count) ? ONEBIT_OK
                                                                      : ONEBIT_CONFIG_COMPRESSION;
}

/* Thresholds, `count` of them; null where there is no list. Written so that a NaN is refused. */
static onebit_status check_thresholds(const onebit_real *thresholds, unsigned count,
                                      onebit_real bound)
{
    for (unsigned k = 0; thresholds != NULL && k < count; ++k) {
        onebit_real threshold = thresholds[k];
        if (!(threshold < RATIO_LIMIT && threshold > -RATIO_LIMIT)) {
            return ONEBIT_CONFIG_THRESHOLD;
        }
        onebit_real distance = threshold < 0 ? -threshold : threshold;
        if (!(bound > 0 && bound <= RATIO_LIMIT - distance)) {
            return ONEBIT_CONFIG_BOUND;
        }
    }
    return ONEBIT_OK;
}

static onebit_status check_gains(const onebit_config *config)
{
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
    bool numbered = config->format.mode != ONEBIT_MODE_LINK || config->first_link != 0;
    return numbered ? ONEBIT_OK : ONEBIT_CONFIG_FIRST_LINK;
}

onebit_status onebit_check(const onebit_config *config)
{
    if (config == NULL || config->neighbours == NULL || config->stabilizing == NULL ||
        config->compression == NULL) {
        return ONEBIT_NULL;
    }
    onebit_status status = check_numbers(config);
    if (status == ONEBIT_OK) {
        status = check_rows(config);
    }
    const onebit_real *lists[] = {&config->threshold, config->heard_thresholds,
                                  config->sent_thresholds};
    for (unsigned k = 0; k < 3 && status == ONEBIT_OK; ++k) {
        status = check_thresholds(lists[k], k == 0 ? 1 : config->neighbour_count, config->bound);
    }
    return status == ONEBIT_OK ? check_gains(config) : status;
}
