/*
 * onebit-bench: how long the library's and the simulator's parts take on this machine, one core.
 * Figures for a person, or with --json for a program; none of them is a test.
 */
#include "bench.h"

#include "bus.h"
#include "formats.h"
#include "scenario.h"
#include "simulation.h"

#include <cjson/cJSON.h>
#include <omp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define RUN_STEPS 100000u
#define BUS_SENDERS 20u
#define ROUNDS 5

static const char help[] =
    "usage: onebit-bench [SCENARIO] [--json]\n"
    "       onebit-bench socketcan --help\n"
    "Measures on one core, for each arithmetic: ns per estimator update and per agent step (n = "
    "4,\n"
    "3 neighbours), and edge updates per second of a whole run of SCENARIO (default: the seven\n"
    "aircraft) in broadcast and in link mode; frames per second of both bus models; memory.\n";

/* Million frames per second through a bus, steps of BUS_SENDERS frames in link or broadcast form.
 */
static double time_bus(enum bus_model model)
{
    /* A period long enough for all frames. */
    struct bus *bus = bus_create(model, 1e6, 1.0, BUS_SENDERS, NULL);
    if (bus == NULL) {
        return -1;
    }
    const onebit_format format = ONEBIT_FORMAT_BROADCAST_PAYLOAD;
    double fastest = 0;
    for (int round = 0; round < ROUNDS; ++round) {
        double begun = omp_get_wtime();
        double elapsed;
        double frames = 0;
        uint32_t step = 0;
        do {
            onebit_frame sync;
            onebit_frame_sync(&format, step, &sync);
            bus_begin_step(bus, &sync);
            for (uint32_t j = BUS_SENDERS; j >= 1; --j) {
                onebit_message message = {
                    .sender = j, .step = (uint8_t)(step % ONEBIT_STEP_MODULUS), .bit = j % 3 == 0};
                onebit_frame frame;
                onebit_frame_encode(&format, &message, &frame);
                bus_send(bus, &frame, j);
            }
            const onebit_frame *heard;
            uint32_t tag;
            while (bus_receive(bus, &heard, &tag)) {
                ++frames;
            }
            ++step;
            elapsed = omp_get_wtime() - begun;
        } while (elapsed < 0.1);
        fastest = frames / elapsed > fastest ? frames / elapsed : fastest;
    }
    bus_free(bus);
    return 1e-6 * fastest;
}

/* Million edge updates per second of a whole run: library, codec, bus and plants. */
static double time_run(enum arithmetic arithmetic, const struct scenario *scenario,
                       const struct formats *formats)
{
    const uint32_t rows[] = {RUN_STEPS};
    double fastest = 0;
    for (int round = 0; round < ROUNDS; ++round) {
        struct sample sample;
        struct problem problem;
        struct run run = {.seed = 1, .rows = rows, .row_count = 1, .samples = &sample};
        double begun = omp_get_wtime();
        if (!simulate(arithmetic, scenario, formats, &run, &problem)) {
            return -1;
        }
        double updates = (double)RUN_STEPS * scenario->topology.link_count;
        double rate = updates / (omp_get_wtime() - begun);
        fastest = rate > fastest ? rate : fastest;
    }
    return 1e-6 * fastest;
}

/*
 * Sizes of the library's objects at -Os: what `size` printed of them when they were built. A line's
 * path has the form .../size_<part>.dir/.../<object>, part being an arithmetic or base.
 */
static void print_object_sizes(void)
{
    FILE *file = fopen(ONEBIT_OBJECT_SIZES, "r");
    if (file == NULL) {
        return;
    }
    puts("\nobjects at -Os       text  data  bss (bytes)");
    char line[4096];
    while (fgets(line, sizeof line, file) != NULL) {
        long text;
        long data;
        long bss;
        char *part = strstr(line, "size_");
        char *object = strrchr(line, '/');
        if (part == NULL || object == NULL ||
            sscanf(line, "%ld %ld %ld", &text, &data, &bss) != 3) {
            continue; /* the heading */
        }
        part += strlen("size_");
        part[strcspn(part, ".")] = '\0';
        object[strcspn(object, ".")] = '\0';
        printf("%-4s %-16s%5ld %5ld %4ld\n", part, object + 1, text, data, bss);
    }
    fclose(file);
}

/*
 * Becomes the port's own benchmark, which stands beside this program: the simulator does not know
 * the ports. Returns only where there is none.
 */
static int become(const char *name, char **arguments)
{
    char path[4096];
    ssize_t length = readlink("/proc/self/exe", path, sizeof path - 64);
    if (length > 0) {
        path[length] = '\0';
        snprintf(strrchr(path, '/') + 1, 64, "onebit-bench-%s", name);
        execv(path, arguments);
    }
    fprintf(stderr, "onebit-bench: %s: not built here\n", name);
    return 2;
}

int main(int argument_count, char **arguments)
{
    if (argument_count > 1 && strcmp(arguments[1], "socketcan") == 0) {
        return become(arguments[1], arguments + 1);
    }
    const char *path = ONEBIT_DEFAULT_SCENARIO;
    bool json = false;
    for (int k = 1; k < argument_count; ++k) {
        if (strcmp(arguments[k], "--help") == 0) {
            fputs(help, stdout);
            return 0;
        }
        if (strcmp(arguments[k], "--json") == 0) {
            json = true;
        } else if (arguments[k][0] == '-') {
            fprintf(stderr, "onebit-bench: %s: no such option; see onebit-bench --help\n",
                    arguments[k]);
            return 2;
        } else {
            path = arguments[k];
        }
    }
    struct problem problem = {{0}};
    struct scenario scenario;
    struct formats formats;
    if (!scenario_load(&scenario, path, &problem)) {
        fprintf(stderr, "onebit-bench: %s\n", problem.text);
        return 2;
    }
    if (!formats_choose(&scenario, &formats, &problem)) {
        fprintf(stderr, "onebit-bench: %s\n", problem.text);
        scenario_free(&scenario);
        return 2;
    }
    scenario.bus_model = BUS_IDEAL;
    static bench_agent_function *const agents[ARITHMETIC_COUNT] = {
        onebit_f64_bench_agent, onebit_f32_bench_agent, onebit_q31_bench_agent};
    cJSON *object = cJSON_CreateObject();
    if (!json) {
        puts("            estimator    agent step   edge updates (million/s)   bytes here");
        puts("            update (ns)  (ns)         broadcast    link          agent  estimate  "
             "config");
    }
    for (int k = 0; k < ARITHMETIC_COUNT; ++k) {
        struct agent_times times = agents[k](0.5);
        scenario.format.mode = ONEBIT_MODE_BROADCAST;
        scenario.format.base = ONEBIT_PAYLOAD_BASE;
        scenario.format.encoding = ONEBIT_ENCODING_PAYLOAD;
        double broadcast = time_run((enum arithmetic)k, &scenario, &formats);
        scenario.format.mode = ONEBIT_MODE_LINK;
        double link = time_run((enum arithmetic)k, &scenario, &formats);
        if (!json) {
            printf("%-10s  %-11.2f  %-11.1f  %-11.1f  %-12.1f  %-5zu  %-8zu  %zu\n",
                   arithmetic_names[k], times.update_ns, times.step_ns, broadcast, link,
                   times.agent_bytes, times.estimate_bytes, times.config_bytes);
        }
        cJSON *entry = cJSON_AddObjectToObject(object, arithmetic_names[k]);
        cJSON_AddNumberToObject(entry, "update_ns", times.update_ns);
        cJSON_AddNumberToObject(entry, "step_ns", times.step_ns);
        cJSON_AddNumberToObject(entry, "broadcast_edge_updates", 1e6 * broadcast);
        cJSON_AddNumberToObject(entry, "link_edge_updates", 1e6 * link);
        cJSON_AddNumberToObject(entry, "agent_bytes", (double)times.agent_bytes);
        cJSON_AddNumberToObject(entry, "estimate_bytes", (double)times.estimate_bytes);
        cJSON_AddNumberToObject(entry, "config_bytes", (double)times.config_bytes);
    }
    double ideal = time_bus(BUS_IDEAL);
    double can = time_bus(BUS_CAN);
    cJSON_AddNumberToObject(object, "ideal_bus_frames", 1e6 * ideal);
    cJSON_AddNumberToObject(object, "can_bus_frames", 1e6 * can);
    if (json) {
        char *text = cJSON_Print(object);
        puts(text != NULL ? text : "{}");
        cJSON_free(text);
    } else {
        printf("\nbus frames (million/s)      ideal %.1f   can %.1f\n", ideal, can);
        print_object_sizes();
    }
    cJSON_Delete(object);
    scenario_free(&scenario);
    return 0;
}
