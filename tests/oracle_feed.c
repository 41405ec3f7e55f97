/*
 * Feeds the bits and states that tests/oracle.py drew to the library's agents and writes what they
 * believed and commanded, for tests/test_oracle_long.py. Compiled once for each arithmetic.
 *
 * usage: oracle-feed-<arithmetic> SCENARIO INPUT OUTPUT
 *
 * INPUT, a record a step: agent_count x n doubles, the states x_i(t); then a byte for each directed
 * link of the union (by sender, then receiver): 0 or 1 the bit, 255 not heard. OUTPUT, a record a
 * step: a double zhat for each link in that order, then a double u for each agent; paper's units.
 * Every bit passes through the frame codec.
 */
#include "group.h"

#include <stdio.h>
#include <stdlib.h>

#define NOT_HEARD 255

static int fail(const char *what, const char *which)
{
    fprintf(stderr, "oracle-feed: %s: %s\n", which, what);
    return 1;
}

/* Where the receiver keeps its estimate of the sender: the link back, graphs being undirected. */
static uint32_t link_back(const struct topology *topology, uint32_t link)
{
    uint32_t back = topology->first_link[topology->link_receiver[link] - 1];
    while (topology->link_receiver[back] != topology->link_sender[link]) {
        ++back;
    }
    return back;
}

static int feed(const struct scenario *scenario, const struct formats *formats, struct group *group,
                FILE *input, FILE *output)
{
    const struct topology *topology = &scenario->topology;
    uint32_t n = scenario->state_count;
    uint32_t link_mode = scenario->format.mode == ONEBIT_MODE_LINK;
    size_t state_entries = (size_t)topology->agent_count * n;
    double *x = malloc(state_entries * sizeof *x);
    uint8_t *bits = malloc(topology->link_count);
    double *believed = malloc(topology->link_count * sizeof *believed);
    double *commanded = malloc(topology->agent_count * sizeof *commanded);
    int status = x != NULL && bits != NULL && believed != NULL && commanded != NULL ? 0 : 1;
    while (status == 0 && fread(x, sizeof *x, state_entries, input) == state_entries) {
        if (fread(bits, 1, topology->link_count, input) != topology->link_count) {
            status = 1;
            break;
        }
        for (uint32_t link = 0; link < topology->link_count; ++link) {
            if (bits[link] == NOT_HEARD) {
                continue;
            }
            uint32_t i = topology->link_receiver[link] - 1;
            onebit_message message = {
                .sender = topology->link_sender[link],
                .receiver = link_mode ? topology->link_receiver[link] : 0,
                .step = (uint8_t)(group->agents[i].clock % ONEBIT_STEP_MODULUS),
                .bit = bits[link] != 0,
            };
            onebit_frame frame;
            if (onebit_frame_encode(&scenario->format, &message, &frame) != ONEBIT_OK ||
                onebit_receive(&group->configs[i], &group->agents[i], &frame, ONEBIT_ALL_LINKED,
                               NULL) != ONEBIT_OK) {
                status = 1;
            }
        }
        for (uint32_t link = 0; link < topology->link_count; ++link) {
            believed[link] = scenario->sigma *
                             double_from_real(group->estimates[link_back(topology, link)].value,
                                              ONEBIT_NOISE_FRACTION_BITS);
        }
        for (uint32_t i = 0; i < topology->agent_count; ++i) {
            onebit_real measured[ONEBIT_STATES_MAX];
            onebit_real u;
            for (uint32_t k = 0; k < n; ++k) {
                measured[k] = real_from_double(x[(size_t)i * n + k], formats->state);
            }
            if (onebit_control(&group->configs[i], &group->agents[i], measured, ONEBIT_ALL_LINKED,
                               &u) != ONEBIT_OK) {
                status = 1;
            }
            commanded[i] = double_from_real(u, formats->control);
        }
        fwrite(believed, sizeof *believed, topology->link_count, output);
        fwrite(commanded, sizeof *commanded, topology->agent_count, output);
    }
    free(x);
    free(bits);
    free(believed);
    free(commanded);
    return status;
}

int main(int argument_count, char **arguments)
{
    if (argument_count != 4) {
        return fail("SCENARIO INPUT OUTPUT wanted", "arguments");
    }
    struct problem problem = {{0}};
    struct scenario scenario;
    struct formats formats;
    struct group group;
    if (!scenario_load(&scenario, arguments[1], &problem)) {
        return fail(problem.text, "scenario");
    }
    int status = 1;
    if (!formats_choose(&scenario, &formats, &problem) ||
        !group_build(&group, &scenario, &formats, 1, 0, &problem)) {
        fail(problem.text, "scenario");
    } else {
        FILE *input = fopen(arguments[2], "rb");
        FILE *output = fopen(arguments[3], "wb");
        if (input == NULL || output == NULL) {
            fail("cannot be opened", input == NULL ? arguments[2] : arguments[3]);
        } else {
            status = feed(&scenario, &formats, &group, input, output);
            if (status != 0 || ferror(output) != 0) {
                status = fail("a record is cut short or refused", arguments[2]);
            }
        }
        if (input != NULL) {
            fclose(input);
        }
        if (output != NULL && fclose(output) != 0) {
            status = fail("cannot be written", arguments[3]);
        }
        group_free(&group);
    }
    scenario_free(&scenario);
    return status;
}
