/*
 * onebit-bench-socketcan, which `onebit-bench socketcan` runs: what the port and the nodes take on
 * a CAN interface, best a vcan0 that nobody else uses. Sends frames there, starts onebit-node from
 * its own folder. Figures for a person, or with --json for a program; none of them is a test.
 */
#include "loop.h"
#include "machine.h"
#include "scenario.h"
#include "socketcan.h"

#include <cjson/cJSON.h>
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#define SECONDS 1.0   /* of each measurement of the port */
#define BURST 100     /* frames that the receive queue holds whatever the system's settings */
#define SAMPLES 5000u /* of the latency */
#define GROUP_STEPS 2000
#define AGENTS 7
#define START_SECONDS 1 /* in which all nodes have opened their sockets */

static const char help[] =
    "usage: onebit-bench socketcan [--interface vcan0] [--json]\n"
    "Measures on a CAN interface: frames per second through the port, out and in, and processor\n"
    "time per frame; time from a neighbour's send to the estimate in another process (q31); steps\n"
    "per second of the seven aircraft, a process each, as fast as SYNC allows; a node's resident\n"
    "memory. Exit status: 0 done, 2 bad use, 1 failure.\n";

struct figures {
    double out_rate; /* frames per second */
    double out_cpu;  /* seconds per frame */
    double in_rate;
    double in_cpu;
    double latency_median; /* seconds */
    double latency_tail;   /* 99.9 % */
    double step_rate;      /* steps per second */
    double resident;       /* KiB, the largest of the nodes */
};

static double seconds_now(void)
{
    return (double)loop_now(CLOCK_MONOTONIC) / LOOP_SECOND;
}

static double processor_now(void)
{
    return (double)loop_now(CLOCK_PROCESS_CPUTIME_ID) / LOOP_SECOND;
}

/* --- the port --- */

static bool send_burst(struct transport *out, uint32_t identifier, int count)
{
    const onebit_frame frame = {.identifier = identifier, .length = 1};
    for (int k = 0; k < count; ++k) {
        enum transport_status status;
        while ((status = out->send(out->context, &frame)) == TRANSPORT_LATER) {
            loop_wait(NULL, 0, LOOP_RETRY);
        }
        if (status == TRANSPORT_DOWN) {
            return false;
        }
    }
    return true;
}

static bool measure_port(const char *interface, struct figures *figures, struct problem *problem)
{
    const struct socketcan_filter one = {0x101, 0x7FF, false};
    struct socketcan sender;
    struct socketcan receiver;
    if (!socketcan_open(&sender, interface, NULL, 0, problem)) {
        return false;
    }
    if (!socketcan_open(&receiver, interface, &one, 1, problem)) {
        socketcan_close(&sender);
        return false;
    }
    struct transport out = socketcan_transport(&sender);
    struct transport in = socketcan_transport(&receiver);
    bool good = true;

    /* Out: an identifier that nobody here listens to. */
    double begun = seconds_now();
    double processor = processor_now();
    double frames = 0;
    while (good && seconds_now() - begun < SECONDS) {
        good = send_burst(&out, 0x102, BURST);
        frames += BURST;
    }
    figures->out_rate = frames / (seconds_now() - begun);
    figures->out_cpu = (processor_now() - processor) / frames;

    /* In: bursts that wait in the queue, only the receiving is timed. */
    double time = 0;
    processor = 0;
    frames = 0;
    while (good && time < SECONDS) {
        good = send_burst(&out, 0x101, BURST);
        double from = seconds_now();
        double processor_from = processor_now();
        onebit_frame frame;
        uint64_t stamp;
        for (int k = 0; k < BURST && good; ++k) {
            /* The kernel delivers within send on vcan, a little later on hardware. */
            while (in.receive(in.context, &frame, &stamp) == TRANSPORT_LATER) {
                struct pollfd file = {.fd = receiver.handle, .events = POLLIN};
                loop_wait(&file, 1, LOOP_SECOND);
                good = file.revents != 0;
                if (!good) {
                    break;
                }
            }
        }
        time += seconds_now() - from;
        processor += processor_now() - processor_from;
        frames += BURST;
    }
    figures->in_rate = frames / time;
    figures->in_cpu = processor / frames;
    socketcan_close(&sender);
    socketcan_close(&receiver);
    return good || problem_set(problem, "%s: frames did not come through", interface);
}

/* --- latency --- */

struct shared {
    uint64_t estimated; /* when the neighbour's estimate stood, monotonic */
};

/* The neighbour: a frame, an estimate, a step; says so through the pipe. */
static void neighbour(const char *interface, struct machine *machine, struct shared *shared,
                      int ready)
{
    const struct machine_verbs *verbs = &onebit_q31_machine;
    /* Link mode's frames from agent 1 to agent 2. */
    const struct socketcan_filter filter = {ONEBIT_LINK_BASE + (1u << 14) + (2u << 1), 0x1FFFFFFE,
                                            true};
    struct problem problem;
    struct socketcan socketcan;
    onebit_frame frames[MACHINE_FRAMES_MAX];
    if (!socketcan_open(&socketcan, interface, &filter, 1, &problem)) {
        _exit(1);
    }
    struct transport in = socketcan_transport(&socketcan);
    verbs->begin(machine, frames);
    while (write(ready, "", 1) == 1) {
        struct pollfd file = {.fd = socketcan.handle, .events = POLLIN};
        onebit_frame frame;
        uint64_t stamp;
        while (in.receive(in.context, &frame, &stamp) != TRANSPORT_DONE) {
            loop_wait(&file, 1, LOOP_SECOND);
        }
        verbs->hear(machine, &frame);
        shared->estimated = loop_now(CLOCK_MONOTONIC);
        verbs->end(machine, NULL);
        verbs->begin(machine, frames);
    }
    _exit(0);
}

static int compare(const void *left, const void *right)
{
    double difference = *(const double *)left - *(const double *)right;
    return (difference > 0) - (difference < 0);
}

/* The sender's side: SAMPLES steps, each when the neighbour waits again. */
static bool sample(struct transport *out, struct machine *machine, const struct shared *shared,
                   int ready, double *samples)
{
    const struct machine_verbs *verbs = &onebit_q31_machine;
    char byte;
    bool good = read(ready, &byte, 1) == 1;
    for (uint32_t k = 0; good && k < SAMPLES; ++k) {
        onebit_frame frames[MACHINE_FRAMES_MAX];
        verbs->begin(machine, frames);
        /* Long enough for the neighbour to be asleep again, as it is in a real step. */
        loop_wait(NULL, 0, LOOP_RETRY / 5);
        uint64_t from = loop_now(CLOCK_MONOTONIC);
        good = out->send(out->context, &frames[0]) == TRANSPORT_DONE && read(ready, &byte, 1) == 1;
        samples[k] = (double)(shared->estimated - from) / LOOP_SECOND;
        verbs->end(machine, NULL);
    }
    return good;
}

static bool measure_latency(const char *interface, struct figures *figures, struct problem *problem)
{
    static double samples[SAMPLES];
    struct scenario scenario;
    struct formats formats;
    if (!scenario_load(&scenario, ONEBIT_SCENARIOS "/two-agents.yaml", problem)) {
        return false;
    }
    const struct machine_choice first = {1, 1, 0};
    const struct machine_choice second = {2, 1, 0};
    struct socketcan socketcan = {.handle = -1};
    struct machine *machines[2] = {NULL, NULL};
    struct shared *shared =
        mmap(NULL, sizeof *shared, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    int ends[2];
    bool good = formats_choose(&scenario, &formats, problem);
    if (good) {
        machines[0] = onebit_q31_machine.create(&scenario, &formats, &first, problem);
        machines[1] = onebit_q31_machine.create(&scenario, &formats, &second, problem);
        good = machines[0] != NULL && machines[1] != NULL && shared != MAP_FAILED &&
               socketcan_open(&socketcan, interface, NULL, 0, problem) && pipe(ends) == 0;
    }
    if (good) {
        pid_t child = fork();
        if (child == 0) {
            close(ends[0]);
            neighbour(interface, machines[1], shared, ends[1]);
        }
        close(ends[1]);
        struct transport out = socketcan_transport(&socketcan);
        good = child > 0 && sample(&out, machines[0], shared, ends[0], samples);
        close(ends[0]);
        if (child > 0) {
            kill(child, SIGKILL);
            waitpid(child, NULL, 0);
        }
        qsort(samples, SAMPLES, sizeof *samples, compare);
        figures->latency_median = samples[SAMPLES / 2];
        figures->latency_tail = samples[SAMPLES - 1 - SAMPLES / 1000];
    }
    onebit_q31_machine.destroy(machines[0]);
    onebit_q31_machine.destroy(machines[1]);
    socketcan_close(&socketcan);
    if (shared != MAP_FAILED) {
        munmap(shared, sizeof *shared);
    }
    scenario_free(&scenario);
    return good || problem->text[0] != '\0' || problem_set(problem, "the neighbour did not answer");
}

/* --- the group --- */

/* Starts onebit-node from this program's folder, its standard output as given. */
static pid_t start(const char *const *arguments, int output)
{
    char path[4096];
    ssize_t length = readlink("/proc/self/exe", path, sizeof path - 16);
    char *slash = length > 0 ? memrchr(path, '/', (size_t)length) : NULL;
    if (slash == NULL) {
        return -1;
    }
    strcpy(slash + 1, "onebit-node");
    pid_t child = fork();
    if (child == 0) {
        int nothing = open("/dev/null", O_RDWR);
        dup2(output >= 0 ? output : nothing, STDOUT_FILENO);
        dup2(nothing, STDERR_FILENO); /* no status line */
        execv(path, (char *const *)arguments);
        _exit(127);
    }
    return child;
}

static double resident_of(pid_t process)
{
    char path[64];
    char line[256];
    double resident = 0;
    snprintf(path, sizeof path, "/proc/%ld/status", (long)process);
    FILE *file = fopen(path, "r");
    while (file != NULL && fgets(line, sizeof line, file) != NULL) {
        if (strncmp(line, "VmHWM:", 6) == 0) {
            resident = strtod(line + 6, NULL);
        }
    }
    if (file != NULL) {
        fclose(file);
    }
    return resident;
}

/* The master's summary: steps per second. */
static double read_rate(int handle)
{
    char text[4096];
    size_t count = 0;
    ssize_t part;
    while (count < sizeof text - 1 &&
           (part = read(handle, text + count, sizeof text - 1 - count)) > 0) {
        count += (size_t)part;
    }
    text[count] = '\0';
    cJSON *object = cJSON_Parse(text);
    double steps = cJSON_GetNumberValue(cJSON_GetObjectItem(object, "syncs"));
    double seconds = cJSON_GetNumberValue(cJSON_GetObjectItem(object, "seconds"));
    cJSON_Delete(object);
    return steps / seconds;
}

static bool measure_group(const char *interface, struct figures *figures, struct problem *problem)
{
    static const char scenario[] = ONEBIT_SCENARIOS "/aircraft-fixed-broadcast.yaml";
    char numbers[AGENTS][16];
    pid_t nodes[AGENTS];
    char steps[16];
    int ends[2];
    bool good = pipe(ends) == 0;
    for (int k = 0; k < AGENTS; ++k) {
        snprintf(numbers[k], sizeof numbers[k], "%d", k + 1);
        const char *const node[] = {"onebit-node", scenario,  "--interface", interface, "--agent",
                                    numbers[k],    "--arith", "q31",         "--sync",  NULL};
        nodes[k] = start(node, -1);
    }
    sleep(START_SECONDS);
    for (int k = 0; k < AGENTS; ++k) {
        double resident = resident_of(nodes[k]);
        figures->resident = resident > figures->resident ? resident : figures->resident;
    }
    snprintf(steps, sizeof steps, "%d", GROUP_STEPS);
    const char *const master[] = {"onebit-node",   scenario,   "--interface", interface,
                                  "--sync-master", "--period", "0",           "--steps",
                                  steps,           "--json",   NULL};
    pid_t process = start(master, ends[1]);
    close(ends[1]);
    figures->step_rate = read_rate(ends[0]);
    close(ends[0]);
    int status = 1;
    good = process > 0 && waitpid(process, &status, 0) == process && status == 0 && good;
    for (int k = 0; k < AGENTS; ++k) {
        if (nodes[k] <= 0) {
            good = false;
            continue;
        }
        if (!good) {
            kill(nodes[k], SIGTERM);
        }
        good = waitpid(nodes[k], &status, 0) == nodes[k] && status == 0 && good;
    }
    return good || problem_set(problem, "the group of onebit-node did not run to its end");
}

/* --- the figures --- */

static void print_figures(const struct figures *figures)
{
    printf("port out        %8.0f frames/s, %.2f us of processor a frame\n", figures->out_rate,
           1e6 * figures->out_cpu);
    printf("port in         %8.0f frames/s, %.2f us of processor a frame\n", figures->in_rate,
           1e6 * figures->in_cpu);
    printf("send to estimate %7.1f us median, %.1f us at 99.9 %%\n", 1e6 * figures->latency_median,
           1e6 * figures->latency_tail);
    printf("group of seven  %8.0f steps/s\n", figures->step_rate);
    printf("a node          %8.0f KiB resident at most\n", figures->resident);
}

static void print_json(const struct figures *figures)
{
    cJSON *object = cJSON_CreateObject();
    cJSON_AddNumberToObject(object, "out_frames", figures->out_rate);
    cJSON_AddNumberToObject(object, "out_processor_seconds", figures->out_cpu);
    cJSON_AddNumberToObject(object, "in_frames", figures->in_rate);
    cJSON_AddNumberToObject(object, "in_processor_seconds", figures->in_cpu);
    cJSON_AddNumberToObject(object, "latency_median_seconds", figures->latency_median);
    cJSON_AddNumberToObject(object, "latency_999_seconds", figures->latency_tail);
    cJSON_AddNumberToObject(object, "group_steps", figures->step_rate);
    cJSON_AddNumberToObject(object, "resident_kib", figures->resident);
    char *text = cJSON_Print(object);
    puts(text != NULL ? text : "{}");
    cJSON_free(text);
    cJSON_Delete(object);
}

int main(int argument_count, char **arguments)
{
    const char *interface = "vcan0";
    bool json = false;
    for (int k = 1; k < argument_count; ++k) {
        if (strcmp(arguments[k], "--help") == 0) {
            fputs(help, stdout);
            return 0;
        }
        if (strcmp(arguments[k], "--json") == 0) {
            json = true;
        } else if (strcmp(arguments[k], "--interface") == 0 && k + 1 < argument_count) {
            interface = arguments[++k];
        } else {
            fprintf(stderr, "onebit-bench: %s: no such option; see onebit-bench socketcan --help\n",
                    arguments[k]);
            return 2;
        }
    }
    struct figures figures = {0};
    struct problem problem = {{0}};
    struct socketcan trial;
    if (!socketcan_open(&trial, interface, NULL, 0, &problem)) {
        fprintf(stderr, "onebit-bench: %s\n", problem.text);
        return 2;
    }
    socketcan_close(&trial);
    if (!measure_port(interface, &figures, &problem) ||
        !measure_latency(interface, &figures, &problem) ||
        !measure_group(interface, &figures, &problem)) {
        fprintf(stderr, "onebit-bench: %s\n", problem.text);
        return 1;
    }
    if (json) {
        print_json(&figures);
    } else {
        print_figures(&figures);
    }
    return 0;
}
