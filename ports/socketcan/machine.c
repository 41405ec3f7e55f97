/* The machine of machine.h in the arithmetic that this file is compiled for. */
#include "machine.h"

#include "alignment.h"
#include "chain.h"
#include "group.h"
#include "onebit_random.h"
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
    const uint8_t *linked; /* union's links in this step's graph */
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
    if (!group_build(&machine->group, scenario, formats, problem)) {
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

/* The frame of the bit for a receiver (0: all), drawn with the random word of `link`. */
static void encode(const struct machine *machine, uint32_t receiver, uint32_t link,
                   onebit_frame *frame)
{
    uint32_t t = machine->agent->clock;
    onebit_message message = {
        .sender = machine->choice.agent,
        .receiver = receiver,
        .step = (uint8_t)(t % ONEBIT_STEP_MODULUS),
    };
    onebit_encode(machine->config, machine->measured,
                  onebit_random_word(machine->choice.seed, machine->choice.run, link, t),
                  &message.bit);
    onebit_frame_encode(&machine->config->format, &message, frame);
}

static uint32_t begin(struct machine *machine, onebit_frame frames[MACHINE_FRAMES_MAX])
{
    const struct topology *topology = &machine->scenario->topology;
    uint32_t graph = chain_graph(&machine->chain, machine->agent->clock);
    machine->linked = &topology->linked[(size_t)graph * topology->link_count];
    if (machine->config->format.mode != ONEBIT_LINK) {
        encode(machine, 0, machine->choice.agent, &frames[0]);
        return 1;
    }
    uint32_t count = 0;
    uint32_t last = topology->first_link[machine->choice.agent];
    for (uint32_t link = topology->first_link[machine->choice.agent - 1]; link < last; ++link) {
        if (machine->linked[link]) {
            encode(machine, topology->link_receiver[link], link + 1, &frames[count++]);
        }
    }
    return count;
}

/* The place of a number among the neighbours; their count if it is none. */
static unsigned place_of(const onebit_config *config, uint32_t number)
{
    unsigned k = 0;
    while (k < config->neighbour_count && config->neighbours[k] != number) {
        ++k;
    }
    return k;
}

static bool hear(struct machine *machine, const onebit_frame *frame)
{
    const onebit_config *config = machine->config;
    onebit_message message;
    if (onebit_frame_decode(&config->format, frame, &message) == ONEBIT_OK) {
        unsigned place = place_of(config, message.sender);
        if (place < config->neighbour_count &&
            (config->format.mode != ONEBIT_LINK || message.receiver == config->agent)) {
            /* The clock is the group's whether or not this step's graph has the link. */
            alignment_hear(&machine->alignment, machine->agent->clock, &message);
            uint32_t first = machine->scenario->topology.first_link[config->agent - 1];
            if (!machine->linked[first + place]) {
                ++machine->report.unlinked;
                return false;
            }
        }
    }
    onebit_status status = onebit_receive(config, machine->agent, frame);
    if (status == ONEBIT_OK) {
        ++machine->report.taken;
        return true;
    }
    ++machine->report.refused[status - ONEBIT_UNKNOWN];
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
                double_from_real(machine->agent->links[k].estimate, NOISE_FRACTION_BITS);
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
    if (onebit_control(machine->config, agent, machine->measured, &control) != ONEBIT_OK) {
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
    int32_t steps = alignment_end_step(&machine->alignment, machine->config->agent, agent->clock,
                                       machine->config->start + 1u);
    if (steps != 0) {
        onebit_advance(machine->config, agent, steps);
        ++machine->report.aligned;
    }
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
    .begin = begin,
    .hear = hear,
    .end = end,
    .miss = miss,
    .write_header = write_header,
    .report = report,
    .neighbours = neighbours,
};
