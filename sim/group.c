/* Turns a scenario into library instances; see group.h. Compiled once for each arithmetic. */
#include "group.h"

#include <math.h>
#include <stdlib.h>

/* The coefficient nearest to a positive value; 0, which the library refuses, if there is none. */
static onebit_coefficient coefficient(double value)
{
#if ONEBIT_ARITHMETIC == ONEBIT_Q31
    onebit_coefficient result = {0, 0};
    int exponent;
    double scaled = round(ldexp(frexp(value, &exponent), 32));
    if (scaled > 4294967295.0) { /* rounded up to a power of two */
        scaled /= 2;
        ++exponent;
    }
    if (exponent >= -30 && exponent <= 32) {
        result.value = (uint32_t)scaled;
        result.fraction_bits = (uint16_t)(32 - exponent);
    }
    return result;
#else
    return (onebit_coefficient)value;
#endif
}

/* The scenario's key whose value the library refuses. */
static const char *refused_key(onebit_status status)
{
    switch (status) {
    case ONEBIT_CONFIG_NEIGHBOURS:
        return "topology.graphs";
    case ONEBIT_CONFIG_STABILIZING:
        return "gains.stabilizing";
    case ONEBIT_CONFIG_COMPRESSION:
        return "gains.compression";
    case ONEBIT_CONFIG_THRESHOLD:
        return "quantizer.threshold";
    case ONEBIT_CONFIG_BOUND:
        return "quantizer.bound";
    case ONEBIT_CONFIG_ESTIMATOR_GAIN:
        return "gains.beta";
    case ONEBIT_CONFIG_CONTROL_GAIN:
        return "gains.gamma";
    case ONEBIT_ESTIMATE:
        return "initial.estimates";
    default:
        return "scenario";
    }
}

bool group_build(struct group *group, const struct scenario *scenario,
                 const struct formats *formats, uint32_t seed, uint32_t run,
                 struct problem *problem)
{
    const struct topology *topology = &scenario->topology;
    uint32_t n = scenario->state_count;
    group->agent_count = topology->agent_count;
    group->sigma = scenario->sigma;
    group->configs = calloc(topology->agent_count, sizeof *group->configs);
    group->agents = calloc(topology->agent_count, sizeof *group->agents);
    group->estimates = calloc(topology->link_count, sizeof *group->estimates);
    group->framed = topology->agent_count <= onebit_frame_agent_limit(&scenario->format);
    group->rows = calloc(2 * (size_t)n, sizeof *group->rows);
    onebit_real initial[ONEBIT_NEIGHBOURS_MAX];
    if (group->configs == NULL || group->agents == NULL || group->estimates == NULL ||
        group->rows == NULL) {
        group_free(group);
        return problem_set(problem, "%s: not enough memory for %lu agents", scenario->path,
                           (unsigned long)topology->agent_count);
    }
    for (uint32_t k = 0; k < n; ++k) {
        group->rows[k] = real_from_double(scenario->stabilizing[k], formats->stabilizing);
        group->rows[n + k] =
            real_from_double(scenario->compression[k] / scenario->sigma, formats->compression);
    }
    for (uint32_t k = 0; k < ONEBIT_NEIGHBOURS_MAX; ++k) {
        initial[k] = real_from_double(scenario->initial_estimate / scenario->sigma,
                                      ONEBIT_NOISE_FRACTION_BITS);
    }
    for (uint32_t i = 0; i < topology->agent_count; ++i) {
        uint32_t first = topology->first_link[i];
        onebit_config *config = &group->configs[i];
        config->agent = i + 1;
        /* Undirected graphs: the agents that i sends to are those that it hears. */
        config->neighbours = &topology->link_receiver[first];
        config->neighbour_count = (uint8_t)(topology->first_link[i + 1] - first);
        config->state_count = (uint8_t)n;
        config->format = scenario->format;
        if (!group->framed) {
            config->format.encoding = ONEBIT_ENCODING_NONE;
        }
        config->stabilizing = group->rows;
        config->compression = group->rows + n;
        config->threshold =
            real_from_double(scenario->threshold / scenario->sigma, ONEBIT_NOISE_FRACTION_BITS);
        config->bound =
            real_from_double(scenario->bound / scenario->sigma, ONEBIT_NOISE_FRACTION_BITS);
        /* (|c| + M)/sigma = 4 is allowed, and rounding each must not carry their sum beyond. */
        onebit_real distance = config->threshold < 0 ? -config->threshold : config->threshold;
        onebit_real room = ONEBIT_NOISE(4.0) - distance;
        config->bound = config->bound < room ? config->bound : room;
        config->estimator_gain = coefficient(scenario->beta / scenario->sigma);
        config->control_gain = coefficient(scenario->gamma * scenario->sigma);
        config->start = scenario->t0;
        config->seed = seed;
        config->run = run;
        config->first_link = first + 1u;
        config->fraction_bits.stabilizing = (int8_t)formats->stabilizing;
        config->fraction_bits.compression = (int8_t)formats->compression;
        config->fraction_bits.state = (int8_t)formats->state;
        config->fraction_bits.control = (int8_t)formats->control;
        onebit_status status =
            onebit_start(config, &group->agents[i], &group->estimates[first], initial);
        if (status != ONEBIT_OK) {
            group_free(group);
            return problem_set(problem, "%s: %s: the library refuses this value (%s)",
                               scenario->path, refused_key(status), onebit_status_name(status));
        }
    }
    return true;
}

void group_free(struct group *group)
{
    free(group->configs);
    free(group->agents);
    free(group->estimates);
    free(group->rows);
    *group = (struct group){0};
}

void group_write_heading(const struct group *group, uint32_t index, FILE *stream)
{
    const onebit_config *config = &group->configs[index];
    fputs("step,t,u", stream);
    for (unsigned k = 1; k <= config->state_count; ++k) {
        fprintf(stream, ",x%u", k);
    }
    for (unsigned k = 0; k < config->neighbour_count; ++k) {
        fprintf(stream, ",zhat_%lu", (unsigned long)config->neighbours[k]);
    }
    fputc('\n', stream);
}

void group_write_row(const struct group *group, uint32_t index, uint32_t step, uint32_t t, double u,
                     const double *x, FILE *stream)
{
    const onebit_config *config = &group->configs[index];
    const onebit_estimate *estimates = group->agents[index].estimates;
    fprintf(stream, "%lu,%lu,%.17g", (unsigned long)step, (unsigned long)t, u);
    for (unsigned k = 0; k < config->state_count; ++k) {
        fprintf(stream, ",%.17g", x[k]);
    }
    for (unsigned k = 0; k < config->neighbour_count; ++k) {
        fprintf(stream, ",%.17g",
                group->sigma * double_from_real(estimates[k].value, ONEBIT_NOISE_FRACTION_BITS));
    }
    fputc('\n', stream);
}
