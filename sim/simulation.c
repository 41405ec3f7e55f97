/* The run of simulation.h in the arithmetic that this file is compiled for. */
#include "simulation.h"

#include "chain.h"
#include "group.h"
#include "plant.h"

#include <stdlib.h>
#include <string.h>

/* What a run works on. */
struct state {
    const struct scenario *scenario;
    const struct formats *formats;
    const struct topology *topology;
    struct group group;
    struct plant plant;
    struct bus *bus;
    double *x;             /* agent_count x n, the plants' states */
    onebit_real *measured; /* the same as the agents see them */
    double *average;       /* n: (A + B K1)^k xbar(0) */
    struct chain chain;
};

static void measure(struct state *state, uint32_t agent_index)
{
    uint32_t n = state->scenario->state_count;
    int fraction_bits = state->formats->state;
    const double *x = &state->x[(size_t)agent_index * n];
    onebit_real *measured = &state->measured[(size_t)agent_index * n];
    for (uint32_t k = 0; k < n; ++k) {
        measured[k] = real_from_double(x[k], fraction_bits);
    }
}

static bool begin(struct state *state, const struct run *run, struct problem *problem)
{
    const struct scenario *scenario = state->scenario;
    const struct topology *topology = state->topology;
    uint32_t n = scenario->state_count;
    size_t entries = (size_t)topology->agent_count * n;
    if (!group_build(&state->group, scenario, state->formats, run->seed, run->number, problem)) {
        return false;
    }
    plant_build(&state->plant, scenario, state->formats);
    uint32_t frames =
        scenario->format.mode == ONEBIT_MODE_LINK ? topology->link_count : topology->agent_count;
    state->bus =
        bus_create(scenario->bus_model, scenario->bitrate, scenario->period, frames, run->log);
    state->x = malloc(entries * sizeof *state->x);
    state->measured = malloc(entries * sizeof *state->measured);
    state->average = calloc(n, sizeof *state->average);
    if (state->bus == NULL || state->x == NULL || state->measured == NULL ||
        state->average == NULL) {
        return problem_set(problem, "%s: not enough memory for %lu agents", scenario->path,
                           (unsigned long)topology->agent_count);
    }
    memcpy(state->x, scenario->initial_states, entries * sizeof *state->x);
    for (uint32_t i = 0; i < topology->agent_count; ++i) {
        double *x = &state->x[(size_t)i * n];
        plant_begin(&state->plant, x);
        for (uint32_t k = 0; k < n; ++k) {
            state->average[k] += x[k] / (double)topology->agent_count;
        }
        measure(state, i);
    }
    chain_begin(&state->chain, topology, run->seed, run->number, scenario->t0 + 1u);
    return true;
}

static void end(struct state *state)
{
    group_free(&state->group);
    bus_free(state->bus);
    free(state->x);
    free(state->measured);
    free(state->average);
}

/*
 * Message k of sender j; `link` is its first link in the topology. Where the agents outnumber the
 * identifiers, only those that have one send a frame, and the others' messages are handed over.
 */
static void send(struct state *state, uint32_t j, unsigned k, uint32_t link, const uint8_t *linked)
{
    const struct topology *topology = state->topology;
    const onebit_config *config = &state->group.configs[j - 1];
    onebit_message message;
    /* Scenarios have finite states, so nothing is refused. */
    onebit_send_message(config, &state->group.agents[j - 1],
                        &state->measured[(size_t)(j - 1) * state->scenario->state_count], k,
                        &message);
    onebit_frame frame;
    if (onebit_frame_encode(&state->scenario->format, &message, &frame) == ONEBIT_OK) {
        bus_send(state->bus, &frame, link);
        return;
    }
    uint32_t last = message.receiver != 0 ? link + 1u : topology->first_link[j];
    for (; link < last; ++link) {
        if (linked[link]) {
            uint32_t i = topology->link_receiver[link];
            onebit_receive_message(&state->group.configs[i - 1], &state->group.agents[i - 1],
                                   &message, ONEBIT_ALL_LINKED);
        }
    }
}

/* All agents send. */
static void send_all(struct state *state, const uint8_t *linked)
{
    const struct topology *topology = state->topology;
    bool link_mode = state->scenario->format.mode == ONEBIT_MODE_LINK;
    for (uint32_t j = 1; j <= topology->agent_count; ++j) {
        uint32_t first = topology->first_link[j - 1];
        uint32_t count = onebit_message_count(&state->group.configs[j - 1]);
        for (uint32_t k = 0; k < count; ++k) {
            if (!link_mode || linked[first + k]) {
                send(state, j, k, first + k, linked);
            }
        }
    }
}

static void receive(struct state *state, uint32_t i, const onebit_frame *frame)
{
    const onebit_config *config = &state->group.configs[i - 1];
    onebit_agent *agent = &state->group.agents[i - 1];
    onebit_message message;
    if (state->group.framed) {
        onebit_receive(config, agent, frame, ONEBIT_ALL_LINKED, NULL);
    } else if (onebit_frame_decode(&state->scenario->format, frame, &message) == ONEBIT_OK) {
        onebit_receive_message(config, agent, &message, ONEBIT_ALL_LINKED);
    }
}

/* What the bus delivers goes to the agents that are linked to the sender in this step's graph. */
static void receive_all(struct state *state, const uint8_t *linked)
{
    const struct topology *topology = state->topology;
    bool link_mode = state->scenario->format.mode == ONEBIT_MODE_LINK;
    const onebit_frame *frame;
    uint32_t first;
    while (bus_receive(state->bus, &frame, &first)) {
        uint32_t last = link_mode ? first + 1 : topology->first_link[topology->link_sender[first]];
        for (uint32_t link = first; link < last; ++link) {
            if (linked[link]) {
                receive(state, topology->link_receiver[link], frame);
            }
        }
    }
}

/* All agents control, all plants move. */
static void control_all(struct state *state)
{
    uint32_t n = state->scenario->state_count;
    for (uint32_t i = 0; i < state->group.agent_count; ++i) {
        onebit_real u = 0;
        onebit_control(&state->group.configs[i], &state->group.agents[i],
                       &state->measured[(size_t)i * n], ONEBIT_ALL_LINKED, &u);
        plant_step(&state->plant, &state->x[(size_t)i * n],
                   double_from_real(u, state->formats->control));
        measure(state, i);
    }
}

static void move_average(struct state *state)
{
    const struct scenario *scenario = state->scenario;
    uint32_t n = scenario->state_count;
    double next[ONEBIT_STATES_MAX];
    double u = 0;
    for (uint32_t k = 0; k < n; ++k) {
        u += scenario->stabilizing[k] * state->average[k];
    }
    for (uint32_t i = 0; i < n; ++i) {
        next[i] = scenario->B[i] * u;
        for (uint32_t k = 0; k < n; ++k) {
            next[i] += scenario->A[i * n + k] * state->average[k];
        }
    }
    memcpy(state->average, next, n * sizeof *next);
}

static double distance_squared(const double *a, const double *b, uint32_t count)
{
    double sum = 0;
    for (uint32_t k = 0; k < count; ++k) {
        sum += (a[k] - b[k]) * (a[k] - b[k]);
    }
    return sum;
}

static struct sample sample(const struct state *state)
{
    const struct scenario *scenario = state->scenario;
    const struct topology *topology = state->topology;
    uint32_t n = scenario->state_count;
    double agent_count = (double)topology->agent_count;
    double mean[ONEBIT_STATES_MAX] = {0};
    for (uint32_t i = 0; i < topology->agent_count; ++i) {
        for (uint32_t k = 0; k < n; ++k) {
            mean[k] += state->x[(size_t)i * n + k] / agent_count;
        }
    }
    struct sample result = {0};
    for (uint32_t i = 0; i < topology->agent_count; ++i) {
        const double *x = &state->x[(size_t)i * n];
        result.mse += distance_squared(x, mean, n) / agent_count;
        result.average_error += distance_squared(x, state->average, n) / agent_count;
    }
    /* Link i -> j of the list stands for i's estimate of j: the graphs are undirected. */
    for (uint32_t link = 0; link < topology->link_count; ++link) {
        const double *x = &state->x[(size_t)(topology->link_receiver[link] - 1) * n];
        double z = 0;
        for (uint32_t k = 0; k < n; ++k) {
            z += scenario->compression[k] * x[k];
        }
        double error = scenario->sigma * double_from_real(state->group.estimates[link].value,
                                                          ONEBIT_NOISE_FRACTION_BITS) -
                       z;
        result.estimate_mse += error * error / (double)topology->link_count;
    }
    return result;
}

static void step(struct state *state, uint32_t completed)
{
    const struct topology *topology = state->topology;
    uint32_t t = state->scenario->t0 + 1u + completed;
    uint32_t graph = chain_graph(&state->chain, t);
    const uint8_t *linked = &topology->linked[(size_t)graph * topology->link_count];
    onebit_frame sync;
    onebit_frame_sync(&state->scenario->format, t, &sync);
    bus_begin_step(state->bus, &sync);
    send_all(state, linked);
    receive_all(state, linked);
    control_all(state);
    move_average(state);
}

bool ONEBIT_NAME(simulate)(const struct scenario *scenario, const struct formats *formats,
                           struct run *run, struct problem *problem)
{
    struct state state = {
        .scenario = scenario, .formats = formats, .topology = &scenario->topology};
    bool begun = begin(&state, run, problem);
    uint32_t completed = 0;
    size_t entries = (size_t)scenario->topology.agent_count * scenario->state_count;
    for (uint32_t row = 0; begun && row < run->row_count; ++row) {
        for (; completed < run->rows[row]; ++completed) {
            step(&state, completed);
        }
        run->samples[row] = sample(&state);
        if (run->trajectory != NULL) {
            memcpy(&run->trajectory[row * entries], state.x, entries * sizeof *state.x);
        }
    }
    if (begun) {
        run->traffic = *bus_traffic(state.bus);
    }
    end(&state);
    return begun;
}
