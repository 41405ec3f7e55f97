/* The replay of replay.h in the arithmetic that this file is compiled for. */
#include "replay.h"

#include "chain.h"
#include "group.h"
#include "plant.h"

#include <string.h>

/* The agent, its plant and the graph of the step that it is in. */
struct state {
    const struct scenario *scenario;
    const struct formats *formats;
    const struct replay *what;
    struct group group;
    struct plant plant;
    double x[ONEBIT_STATES_MAX];
    struct chain chain;
    const uint8_t *linked;
    uint32_t step;
};

static void begin_step(struct state *state)
{
    const struct topology *topology = &state->scenario->topology;
    uint32_t graph = chain_graph(&state->chain, state->group.agents[state->what->agent - 1].clock);
    state->linked = &topology->linked[(size_t)graph * topology->link_count];
}

/* Controls, prints the row and moves the plant. */
static void end_step(struct state *state, FILE *stream)
{
    uint32_t index = state->what->agent - 1;
    const onebit_config *config = &state->group.configs[index];
    onebit_agent *agent = &state->group.agents[index];
    uint32_t t = agent->clock;
    onebit_real measured[ONEBIT_STATES_MAX];
    for (unsigned k = 0; k < config->state_count; ++k) {
        measured[k] = real_from_double(state->x[k], state->formats->state);
    }
    onebit_real control = 0;
    onebit_control(config, agent, measured, ONEBIT_ALL_LINKED, &control);
    double u = double_from_real(control, state->formats->control);
    group_write_row(&state->group, index, state->step, t, u, state->x, stream);
    plant_step(&state->plant, state->x, u);
    ++state->step;
}

/* Bit k: neighbour k is linked in this step's graph. */
static uint32_t linked_mask(const struct state *state, const onebit_config *config)
{
    const uint8_t *linked = &state->linked[state->scenario->topology.first_link[config->agent - 1]];
    uint32_t mask = 0;
    for (unsigned k = 0; k < config->neighbour_count; ++k) {
        mask |= (uint32_t)(linked[k] != 0) << k;
    }
    return mask;
}

static void take(struct state *state, const onebit_frame *frame)
{
    uint32_t index = state->what->agent - 1;
    const onebit_config *config = &state->group.configs[index];
    onebit_receive(config, &state->group.agents[index], frame, linked_mask(state, config), NULL);
}

bool ONEBIT_NAME(replay)(const struct scenario *scenario, const struct formats *formats,
                         const struct replay *what, struct log_reader *log, FILE *stream,
                         struct problem *problem)
{
    struct state state = {.scenario = scenario, .formats = formats, .what = what};
    if (!group_build(&state.group, scenario, formats, what->seed, what->run, problem)) {
        return false;
    }
    uint32_t n = scenario->state_count;
    plant_build(&state.plant, scenario, formats);
    memcpy(state.x, &scenario->initial_states[(size_t)(what->agent - 1) * n], n * sizeof *state.x);
    plant_begin(&state.plant, state.x);
    chain_begin(&state.chain, &scenario->topology, what->seed, what->run, scenario->t0 + 1u);
    group_write_heading(&state.group, what->agent - 1, stream);

    onebit_frame frame;
    uint8_t told;
    int status;
    while ((status = log_reader_next(log, &frame, problem)) > 0) {
        if (onebit_frame_is_sync(&scenario->format, &frame, &told)) {
            if (state.linked != NULL) {
                end_step(&state, stream);
            }
            begin_step(&state);
        } else if (state.linked != NULL) {
            take(&state, &frame);
        }
    }
    if (status == 0 && state.linked != NULL) {
        end_step(&state, stream);
    }
    group_free(&state.group);
    return status == 0;
}
