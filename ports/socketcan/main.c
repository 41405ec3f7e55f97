/*
 * onebit-node: agents of a scenario on a CAN interface or a serial line, the master that steps
 * them, and a check of the interface. Reads the command line, calls the modules, turns their
 * results into exit status 0 (done), 2 (bad use or input) or 1 (failure).
 */
#include "check.h"
#include "command_line.h"
#include "master.h"
#include "node.h"
#include "serial_group.h"

#include <getopt.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define AGENTS_MAX 1024u /* in one process: one socket each */
#define PERIOD_MAX 86400.0

static const char help[] =
    "usage: onebit-node SCENARIO --interface vcan0 --agent I [options]     one agent\n"
    "       onebit-node SCENARIO --interface vcan0 --agents I-J [options]  several, a socket each\n"
    "       onebit-node SCENARIO --interface vcan0 --sync-master [--period 10ms] [--steps N]\n"
    "       onebit-node SCENARIO --interface slcan:/dev/ttyACM0 --agents I-J --sync-master\n"
    "                                                              part of a group, on a serial "
    "line\n"
    "       onebit-node check --interface vcan0    what is missing, the command that mends it\n"
    "\n"
    "Runs agents of a scenario, each with its plant, on a CAN interface or a serial line.\n"
    "\n"
    "  --interface NAME     the CAN interface; or slcan:PATH[@SPEED], a serial line (terminal,\n"
    "                       pty or Unix socket) that speaks slcan. There this process is the\n"
    "                       bus: its --agents and the --sync-master, the others behind it\n"
    "  --agent I            number of the agent, from 1; --agents 1-7 or 1,3,5-7: several\n"
    "  --sync               a step begins with each SYNC on the bus; else with each whole\n"
    "                       period of the system's clock\n"
    "  --sync-master        sends SYNC, and a stop to all nodes when it ends\n"
    "  --period T           of a step: 10ms, 500us, 0.5s, 2 (seconds); else the scenario's.\n"
    "                       With --sync a SYNC sooner than half of it is refused, without it\n"
    "                       none is. With --sync-master 0: as fast as the group answers\n"
    "  --steps N            ends after N steps; else at a stop on the bus, Ctrl-C or SIGTERM\n"
    "  --arith f64|f32|q31  arithmetic of the agents (f64)\n"
    "  --seed S, --run R    key of the random words, as in onebit-sim run (1, 0); the same in\n"
    "                       all processes\n"
    "  --csv FILE           a row a step: step,t,u,x1..xn,zhat_<j>.. (several agents: each its\n"
    "                       own, -<I> before the ending)\n"
    "  --json               the summary as JSON\n"
    "\n"
    "Prints a summary at its end. Exit status: 0 done, 2 bad use or input, 1 failure; check: 1\n"
    "when something is missing.\n";

struct options {
    const char *file;
    const char *interface;
    const char *csv;
    uint32_t agents[AGENTS_MAX];
    uint32_t agent_count;
    bool sync;
    bool master;
    bool json;
    bool has_period;
    double period;
    uint32_t steps;
    enum arithmetic arithmetic;
    uint32_t seed;
    uint32_t run;
};

#define PROGRAM "onebit-node"
/* One line on standard error; the status to end with. */
#define complain(...) command_line_complain(PROGRAM, __VA_ARGS__)

/* 3 or 1-7 or 1,3,5-7: ascending. */
static int read_agents(const char *name, const char *text, struct options *options)
{
    const char *rest = text;
    uint32_t least = 1;
    do {
        uint32_t first;
        rest += *rest == ',' && options->agent_count != 0;
        bool good = command_line_number(&rest, least, UINT32_MAX - 1u, &first);
        uint32_t last = good ? first : 0;
        if (good && *rest == '-') {
            ++rest;
            good = command_line_number(&rest, first, UINT32_MAX - 1u, &last);
        }
        if (!good || (*rest != ',' && *rest != '\0') ||
            last - first >= AGENTS_MAX - options->agent_count) {
            return complain(BAD_USE,
                            "--%s %s: must be numbers from 1 in rising order, at most %lu of them, "
                            "as 3 or 1-7 or 1,3,5-7",
                            name, text, (unsigned long)AGENTS_MAX);
        }
        for (uint32_t agent = first; agent <= last; ++agent) {
            options->agents[options->agent_count++] = agent;
        }
        least = last + 1;
    } while (*rest == ',');
    return DONE;
}

static int read_period(const char *text, struct options *options)
{
    static const struct {
        const char *name;
        double seconds;
    } units[] = {{"", 1}, {"s", 1}, {"ms", 1e-3}, {"us", 1e-6}};
    char *end;
    double value = strtod(text, &end);
    for (size_t k = 0; k < sizeof units / sizeof *units; ++k) {
        if (end != text && strcmp(end, units[k].name) == 0) {
            options->period = value * units[k].seconds;
            options->has_period = true;
        }
    }
    if (!options->has_period || !(options->period >= 0 && options->period <= PERIOD_MAX) ||
        (options->period > 0 && options->period < 1e-6)) {
        return complain(BAD_USE, "--period %s: must be a time from 1us to a day, as 10ms or 0.5s",
                        text);
    }
    return DONE;
}

static bool is_serial(const char *interface)
{
    return strncmp(interface, SERIAL_GROUP_PREFIX, strlen(SERIAL_GROUP_PREFIX)) == 0;
}

/* What does not go together. */
static int check_options(const struct options *options)
{
    if (options->interface == NULL) {
        return complain(BAD_USE, "--interface NAME is needed, as vcan0; see onebit-node --help");
    }
    if (is_serial(options->interface)) {
        if (!options->master || options->agent_count == 0 || options->sync) {
            return complain(BAD_USE,
                            "--interface %s: on a serial line goes with --agents and "
                            "--sync-master; for anything else slcand makes it a CAN interface",
                            options->interface);
        }
        return DONE;
    }
    if (options->master) {
        if (options->agent_count != 0 || options->sync || options->csv != NULL) {
            return complain(BAD_USE, "--sync-master: goes without --agent, --sync and --csv");
        }
        return DONE;
    }
    if (options->agent_count == 0) {
        return complain(BAD_USE, "--agent I is needed, or --sync-master; see onebit-node --help");
    }
    if (options->has_period && !(options->period > 0)) {
        return complain(BAD_USE, "--period 0: only a --sync-master can go as fast as it can");
    }
    return DONE;
}

static int read_options(struct options *options, int argument_count, char **arguments)
{
    static const struct option list[] = {
        {"interface", required_argument, NULL, 'i'},
        {"agent", required_argument, NULL, 'n'},
        {"agents", required_argument, NULL, 'g'},
        {"sync", no_argument, NULL, 'y'},
        {"sync-master", no_argument, NULL, 'm'},
        {"period", required_argument, NULL, 'p'},
        {"steps", required_argument, NULL, 't'},
        {"arith", required_argument, NULL, 'a'},
        {"seed", required_argument, NULL, 's'},
        {"run", required_argument, NULL, 'r'},
        {"csv", required_argument, NULL, 'c'},
        {"json", no_argument, NULL, 'j'},
        {"help", no_argument, NULL, 'h'},
        {NULL, 0, NULL, 0},
    };
    int status = DONE;
    int option;
    opterr = 0;
    while (status == DONE &&
           (option = getopt_long(argument_count, arguments, ":", list, NULL)) != -1) {
        switch (option) {
        case 'i':
            options->interface = optarg;
            break;
        case 'n':
        case 'g':
            options->agent_count = 0;
            status = option == 'g' ? read_agents("agents", optarg, options)
                                   : command_line_option(PROGRAM, "agent", optarg, 1,
                                                         UINT32_MAX - 1u, options->agents);
            options->agent_count = option == 'g' ? options->agent_count : 1;
            break;
        case 'y':
            options->sync = true;
            break;
        case 'm':
            options->master = true;
            break;
        case 'p':
            status = read_period(optarg, options);
            break;
        case 't':
            status = command_line_option(PROGRAM, "steps", optarg, 1, UINT32_MAX, &options->steps);
            break;
        case 'a':
            status = command_line_arithmetic(PROGRAM, optarg, &options->arithmetic);
            break;
        case 's':
            status = command_line_option(PROGRAM, "seed", optarg, 0, UINT32_MAX, &options->seed);
            break;
        case 'r':
            status = command_line_option(PROGRAM, "run", optarg, 0, UINT32_MAX, &options->run);
            break;
        case 'c':
            options->csv = optarg;
            break;
        case 'j':
            options->json = true;
            break;
        case 'h':
            fputs(help, stdout);
            exit(DONE);
        case ':':
            return complain(BAD_USE, "%s: needs a value", arguments[optind - 1]);
        default:
            return complain(BAD_USE, "%s: no such option; see onebit-node --help",
                            arguments[optind - 1]);
        }
    }
    if (status != DONE) {
        return status;
    }
    if (argument_count - optind != 1) {
        return complain(BAD_USE, "one scenario file wanted, %d given; see onebit-node --help",
                        argument_count - optind);
    }
    options->file = arguments[optind];
    return check_options(options);
}

static int run_agents(const struct options *options, const struct scenario *scenario)
{
    struct problem problem = {{0}};
    struct formats formats = {0};
    uint32_t limit = onebit_frame_agent_limit(&scenario->format);
    uint32_t highest = options->agents[options->agent_count - 1];
    if (highest > scenario->topology.agent_count) {
        return complain(BAD_USE, "agent %lu: %s has agents 1 to %lu", (unsigned long)highest,
                        scenario->path, (unsigned long)scenario->topology.agent_count);
    }
    if (highest > limit) {
        return complain(BAD_USE, "agent %lu: %s gives agents above %lu no identifier",
                        (unsigned long)highest, scenario->path, (unsigned long)limit);
    }
    if ((options->arithmetic == ARITHMETIC_Q31 || scenario->integer_plant) &&
        !formats_choose(scenario, &formats, &problem)) {
        return complain(BAD_USE, "%s", problem.text);
    }
    const struct nodes nodes = {
        .scenario = scenario,
        .formats = &formats,
        .interface = options->interface,
        .arithmetic = options->arithmetic,
        .agents = options->agents,
        .agent_count = options->agent_count,
        .seed = options->seed,
        .run = options->run,
        .sync = options->sync,
        /* Whose SYNC it is decides how often it comes, unless the user says. */
        .period = options->has_period ? options->period
                  : options->sync     ? 0
                                      : scenario->period,
        .steps = options->steps,
        .csv = options->csv,
        .json = options->json,
    };
    int status = is_serial(nodes.interface) ? serial_group_run(&nodes, &problem)
                                            : nodes_run(&nodes, &problem);
    return status == DONE ? DONE : complain(status, "%s", problem.text);
}

static int run_master(const struct options *options, const struct scenario *scenario)
{
    struct problem problem = {{0}};
    const struct master master = {
        .scenario = scenario,
        .interface = options->interface,
        .period = options->has_period ? options->period : scenario->period,
        .steps = options->steps,
        .seed = options->seed,
        .run = options->run,
        .json = options->json,
    };
    int status = master_run(&master, &problem);
    return status == DONE ? DONE : complain(status, "%s", problem.text);
}

static int check(int argument_count, char **arguments)
{
    if (argument_count == 3 && strcmp(arguments[1], "--interface") == 0) {
        return check_interface(arguments[2]) ? DONE : FAILURE;
    }
    return complain(BAD_USE, "check: usage is onebit-node check --interface NAME");
}

int main(int argument_count, char **arguments)
{
    if (argument_count > 1 && strcmp(arguments[1], "check") == 0) {
        return check(argument_count - 1, arguments + 1);
    }
    struct options options = {.seed = 1};
    int status = read_options(&options, argument_count, arguments);
    if (status != DONE) {
        return status;
    }
    struct problem problem = {{0}};
    struct scenario scenario;
    if (!scenario_load(&scenario, options.file, &problem)) {
        return complain(BAD_USE, "%s", problem.text);
    }
    status = options.agent_count == 0 ? run_master(&options, &scenario)
                                      : run_agents(&options, &scenario);
    scenario_free(&scenario);
    return status;
}
