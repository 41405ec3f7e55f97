/* The machine of machine.h in the arithmetic that this file is compiled for. */
#include "machine.h"

#include "alignment.h"
#include "chain.h"
#include "group.h"
#include "plant.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

struct machine {
    const struct scenario *scenario;
    struct formats formats;
    struct machine_choice choice;
    struct group group; /* of all agents; the machine is one of them */
    const onebit_config *config;
    onebit_agent *agent;
    struct plant plant;
    double x[ONEBIT_STATES_MAX];
    onebit_real measured[ONEBIT_STATES_MAX];
    struct chain chain;
    uint32_t linked; /* bit k: neighbour k is linked in this step's graph */
    struct alignment alignment;
    struct machine_report report;
};

static void measure(struct machine *machine)
{
    for (unsigned k = 0; k < machine->config->state_count; ++k) {
        machine->measured[k] = real_from_double(machine->x[k], machine->formats.state);
    }
}

static void destroy(struct machine *machine)
{
    if (machine != NULL) {
        group_free(&machine->group);
        free(machine);
    }
}

static struct machine *create(const struct scenario *scenario, const struct formats *formats,
                              const struct machine_choice *choice, struct problem *problem)
{
    struct machine *machine = calloc(1, sizeof *machine);
    if (machine == NULL) {
        problem_set(problem, "not enough memory");
        return NULL;
    }
    machine->scenario = scenario;
    machine->formats = *formats;
    machine->choice = *choice;
    if (!group_build(&machine->group, scenario, formats, choice->seed, choice->run, problem)) {
        free(machine);
        return NULL;
    }
    uint32_t index = choice->agent - 1;
    uint32_t n = scenario->state_count;
    machine->config = &machine->group.configs[index];
    machine->agent = &machine->group.agents[index];
    plant_build(&machine->plant, scenario, &machine->formats);
    memcpy(machine->x, &scenario->initial_states[(size_t)index * n], n * sizeof *machine->x);
    plant_begin(&machine->plant, machine->x);
    measure(machine);
    chain_begin(&machine->chain, &scenario->topology, choice->seed, choice->run,
                machine->agent->clock);
    machine->report.disagreement = (double)NAN;
    return machine;
}

/* Moves the clock by the steps that an alignment asks for. */
static void move_clock(struct machine *machine, int32_t steps)
{
    if (steps != 0) {
        onebit_advance(machine->config, machine->agent, steps);
        ++machine->report.aligned;
    }
}

static void align(struct machine *machine, uint8_t step)
{
    if (step != ONEBIT_NO_STEP) {
        move_clock(machine, alignment_sync(&machine->alignment, step, machine->agent->clock,
                                           machine->config->start + 1u));
    }
}

static uint32_t begin(struct machine *machine, onebit_frame frames[MACHINE_FRAMES_MAX])
{
    const struct topology *topology = &machine->scenario->topology;
    const onebit_config *config = machine->config;
    uint32_t graph = chain_graph(&machine->chain, machine->agent->clock);
    const uint8_t *linked = &topology->linked[(size_t)graph * topology->link_count +
                                              topology->first_link[config->agent - 1]];
    machine->linked = 0;
    for (unsigned k = 0; k < config->neighbour_count; ++k) {
        machine->linked |= (uint32_t)(linked[k] != 0) << k;
    }
    bool link_mode = config->format.mode == ONEBIT_MODE_LINK;
    uint32_t count = 0;
    for (unsigned k = 0; k < onebit_message_count(config); ++k) {
        if ((!link_mode || (machine->linked >> k & 1u) != 0) &&
            onebit_send(config, machine->agent, machine->measured, k, &frames[count]) ==
                ONEBIT_OK) {
            ++count;
        }
    }
    return count;
}

static bool hear(struct machine *machine, const onebit_frame *frame)
{
    onebit_message message;
    onebit_status status =
        onebit_receive(machine->config, machine->agent, frame, machine->linked, &message);
    if (status != ONEBIT_REFUSED_UNKNOWN && onebit_is_message(status)) {
        /* The clock is the group's whether or not this step's graph has the link. */
        alignment_hear(&machine->alignment, machine->agent->clock, &message);
    }
    if (status == ONEBIT_OK) {
        ++machine->report.taken;
        return true;
    }
    ++machine->report.refused[status - ONEBIT_REFUSED_FIRST];
    return false;
}

/* Before the step ends and forgets what was heard. */
static void note_disagreement(struct machine *machine)
{
    double z = 0;
    for (unsigned k = 0; k < machine->config->state_count; ++k) {
        z += machine->scenario->compression[k] * machine->x[k];
    }
    double sum = 0;
    unsigned count = 0;
    for (unsigned k = 0; k < machine->config->neighbour_count; ++k) {
        if (machine->agent->heard >> k & 1u) {
            double estimate =
                machine->group.sigma *
                double_from_real(machine->agent->estimates[k].value, ONEBIT_NOISE_FRACTION_BITS);
            sum += (estimate - z) * (estimate - z);
            ++count;
        }
    }
    if (count != 0) {
        machine->report.disagreement = sum / count;
    }
}

static void write_header(const struct machine *machine, FILE *csv)
{
    group_write_heading(&machine->group, machine->choice.agent - 1, csv);
}

static void end(struct machine *machine, FILE *csv)
{
    onebit_agent *agent = machine->agent;
    uint32_t t = agent->clock;
    onebit_real control = 0;
    note_disagreement(machine);
    /* A state that is not finite is refused and the clock stands: the plant then gets no input. */
    if (onebit_control(machine->config, agent, machine->measured, ONEBIT_ALL_LINKED, &control) !=
        ONEBIT_OK) {
        onebit_advance(machine->config, agent, 1);
    }
    double u = double_from_real(control, machine->formats.control);
    if (csv != NULL) {
        group_write_row(&machine->group, machine->choice.agent - 1, machine->report.steps, t, u,
                        machine->x, csv);
    }
    plant_step(&machine->plant, machine->x, u);
    measure(machine);
    machine->report.steps += machine->report.steps != UINT32_MAX;
    move_clock(machine, alignment_end_step(&machine->alignment, machine->config->agent,
                                           agent->clock, machine->config->start + 1u));
}

static void miss(struct machine *machine, int32_t steps)
{
    onebit_advance(machine->config, machine->agent, steps);
}

static void report(const struct machine *machine, struct machine_report *report)
{
    *report = machine->report;
    report->clock = machine->agent->clock;
}

static uint32_t neighbours(const struct machine *machine, const uint32_t **numbers)
{
    *numbers = machine->config->neighbours;
    return machine->config->neighbour_count;
}

const struct machine_verbs ONEBIT_NAME(machine) = {
    .create = create,
    .destroy = destroy,
    .align = align,
    .begin = begin,
    .hear = hear,
    .end = end,
    .miss = miss,
    .write_header = write_header,
    .report = report,
    .neighbours = neighbours,
};
