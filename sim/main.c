/*
 * onebit-sim: runs scenarios and replays bus logs. Reads the command line, calls the modules, turns
 * their results into exit status 0 (done), 2 (bad use or input) or 1 (failure).
 */
#include "command_line.h"
#include "conditions.h"
#include "ensemble.h"
#include "record.h"
#include "replay.h"

#include <getopt.h>
#include <omp.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static const char usage[] = "usage: onebit-sim run FILE [options]\n"
                            "       onebit-sim replay FILE LOG --agent I [options]\n"
                            "       onebit-sim run --help | replay --help\n";

static const char run_help[] =
    "usage: onebit-sim run FILE [options]\n"
    "Runs a scenario: every agent a library instance, every message a frame on the bus.\n"
    "\n"
    "  --arith f64|f32|q31    arithmetic of the agents (f64)\n"
    "  --runs R               size of the ensemble (1)\n"
    "  --steps T              steps of a run, in place of the file's\n"
    "  --seed S               seed, 0..2^32-1 (1)\n"
    "  --threads K            threads; the result is the same for any number (all cores)\n"
    "  --out DIR              writes summary.json, mse.csv and trajectory.csv there\n"
    "  --log FILE             writes the frames of run 0: candump -L text, pcap if FILE ends in "
    ".pcap\n"
    "  --slope-window A B     steps over which the log-log slope is fitted (the last decade)\n"
    "\n"
    "Prints a summary. Exit status: 0 done, 2 bad use or input, 1 failure.\n";

static const char replay_help[] = "usage: onebit-sim replay FILE LOG --agent I [options]\n"
                                  "Feeds a recorded bus log (candump -L text, or pcap) to one "
                                  "agent of a scenario and prints as CSV\n"
                                  "what it believed and commanded: step,t,u,x1..xn,zhat_<j>.. (x "
                                  "and zhat of the clock t, before\n"
                                  "the plant moves). SYNC bounds the steps.\n"
                                  "\n"
                                  "  --agent I              number of the agent, from 1\n"
                                  "  --arith f64|f32|q31    its arithmetic (f64)\n"
                                  "  --seed S, --run R      seed (1) and run (0) that the log is "
                                  "of: where the topology switches\n"
                                  "                         they say which graph each step had\n"
                                  "\n"
                                  "Exit status: 0 done, 2 bad use or input, 1 failure.\n";

/* What the command line says. */
struct options {
    const char *file;
    const char *log;
    const char *out;
    enum arithmetic arithmetic;
    uint32_t runs;
    uint32_t steps; /* 0: the file's */
    uint32_t seed;
    uint32_t run;
    uint32_t agent;
    uint32_t threads; /* 0: all cores */
    bool has_window;
    uint32_t window[2];
};

#define PROGRAM "onebit-sim"
/* One line on standard error; the status to end with. */
#define complain(...) command_line_complain(PROGRAM, __VA_ARGS__)

struct number_option {
    const char *name;
    uint32_t least;
    uint32_t most;
    uint32_t *number;
};

/* The two numbers of --slope-window; the second is the argument that follows. */
static int read_window(struct options *options, int argument_count, char **arguments)
{
    const char *first = optarg;
    const char *second = optind < argument_count ? arguments[optind++] : "";
    const char *rest = second;
    if (!command_line_number(&first, 0, UINT32_MAX, &options->window[0]) || *first != '\0' ||
        !command_line_number(&rest, 0, UINT32_MAX, &options->window[1]) || *rest != '\0' ||
        options->window[0] >= options->window[1]) {
        return complain(BAD_USE,
                        "--slope-window %s %s: must be two steps, the first below the second",
                        optarg, second);
    }
    options->has_window = true;
    return DONE;
}

/* Reads the arguments after the verb; DONE, or the status to end with after a line. */
static int read_options(struct options *options, bool replays, int argument_count, char **arguments)
{
    const struct number_option numbers[] = {
        {"runs", 1, 1000000, &options->runs},      {"steps", 1, UINT32_MAX - 2, &options->steps},
        {"seed", 0, UINT32_MAX, &options->seed},   {"threads", 1, 1024, &options->threads},
        {"agent", 1, UINT32_MAX, &options->agent}, {"run", 0, UINT32_MAX, &options->run},
    };
    static const struct option run_options[] = {
        {"runs", required_argument, NULL, 0},    {"steps", required_argument, NULL, 1},
        {"seed", required_argument, NULL, 2},    {"threads", required_argument, NULL, 3},
        {"arith", required_argument, NULL, 'a'}, {"out", required_argument, NULL, 'o'},
        {"log", required_argument, NULL, 'l'},   {"slope-window", required_argument, NULL, 'w'},
        {"help", no_argument, NULL, 'h'},        {NULL, 0, NULL, 0},
    };
    static const struct option replay_options[] = {
        {"seed", required_argument, NULL, 2}, {"agent", required_argument, NULL, 4},
        {"run", required_argument, NULL, 5},  {"arith", required_argument, NULL, 'a'},
        {"help", no_argument, NULL, 'h'},     {NULL, 0, NULL, 0},
    };
    opterr = 0;
    int status = DONE;
    int option;
    while (status == DONE &&
           (option = getopt_long(argument_count, arguments, ":",
                                 replays ? replay_options : run_options, NULL)) != -1) {
        switch (option) {
        case 'a':
            status = command_line_arithmetic(PROGRAM, optarg, &options->arithmetic);
            break;
        case 'o':
            options->out = optarg;
            break;
        case 'l':
            options->log = optarg;
            break;
        case 'w':
            status = read_window(options, argument_count, arguments);
            break;
        case 'h':
            fputs(replays ? replay_help : run_help, stdout);
            exit(DONE);
        case ':':
            return complain(BAD_USE, "%s: needs a value", arguments[optind - 1]);
        case '?':
            return complain(BAD_USE, "%s: no such option; see onebit-sim %s --help",
                            arguments[optind - 1], replays ? "replay" : "run");
        default:
            status =
                command_line_option(PROGRAM, numbers[option].name, optarg, numbers[option].least,
                                    numbers[option].most, numbers[option].number);
        }
    }
    if (status != DONE) {
        return status;
    }
    int wanted = replays ? 2 : 1;
    if (argument_count - optind != wanted) {
        return complain(BAD_USE, "%s: %d file%s wanted, %d given; see onebit-sim %s --help",
                        replays ? "replay" : "run", wanted, wanted == 1 ? "" : "s",
                        argument_count - optind, replays ? "replay" : "run");
    }
    options->file = arguments[optind];
    if (replays) {
        options->log = arguments[optind + 1];
        if (options->agent == 0) {
            return complain(BAD_USE, "replay: --agent I is needed: which agent hears the log");
        }
    }
    return DONE;
}

/* Runs the ensemble and leaves its files. */
static int run_scenario(const struct options *options, const struct scenario *scenario,
                        const struct formats *formats)
{
    struct problem problem = {{0}};
    struct ensemble ensemble = {
        .arithmetic = options->arithmetic,
        .runs = options->runs,
        .steps = scenario->steps,
        .seed = options->seed,
        .threads = options->threads != 0 ? (int)options->threads : omp_get_max_threads(),
        .progress = isatty(STDERR_FILENO) != 0 && options->runs > 1,
    };
    if (options->out != NULL && !record_prepare(options->out, &problem)) {
        return complain(BAD_USE, "--out %s", problem.text);
    }
    if (options->log != NULL && (ensemble.log = log_writer_open(options->log, &problem)) == NULL) {
        return complain(BAD_USE, "--log %s", problem.text);
    }
    double begun = omp_get_wtime();
    bool good = ensemble_run(&ensemble, scenario, formats, &problem);
    struct summary summary = {.seconds = omp_get_wtime() - begun};
    if (good) {
        summary.slope_first = options->has_window ? options->window[0] : ensemble.steps / 10;
        summary.slope_last = options->has_window ? options->window[1] : ensemble.steps;
        summary.slope =
            ensemble_slope(&ensemble, scenario->t0, summary.slope_first, summary.slope_last);
        good = options->out == NULL ||
               record_write(options->out, &ensemble, scenario, &summary, &problem);
    }
    if (good && ensemble.log != NULL) {
        good = log_writer_commit(ensemble.log, &problem);
    } else {
        log_writer_discard(ensemble.log);
    }
    if (good) {
        record_print(stdout, &ensemble, scenario, &summary);
        good = fflush(stdout) == 0 || problem_set(&problem, "standard output: a write failed");
    }
    ensemble_free(&ensemble);
    return good ? DONE : complain(FAILURE, "%s", problem.text);
}

static int replay_log(const struct options *options, const struct scenario *scenario,
                      const struct formats *formats)
{
    if (options->agent > scenario->topology.agent_count) {
        return complain(BAD_USE, "--agent %lu: %s has agents 1 to %lu",
                        (unsigned long)options->agent, scenario->path,
                        (unsigned long)scenario->topology.agent_count);
    }
    struct problem problem = {{0}};
    struct log_reader *log = log_reader_open(options->log, &problem);
    if (log == NULL) {
        return complain(BAD_USE, "%s", problem.text);
    }
    const struct replay what = {options->agent, options->seed, options->run};
    bool good = replay(options->arithmetic, scenario, formats, &what, log, stdout, &problem);
    log_reader_close(log);
    if (!good) {
        return complain(BAD_USE, "%s", problem.text);
    }
    return fflush(stdout) == 0 ? DONE : complain(FAILURE, "standard output: a write failed");
}

/* What the conditions and the bus have to say about a run, before it. */
static void warn(const struct scenario *scenario)
{
    uint32_t limit = onebit_frame_agent_limit(&scenario->format);
    conditions_warn(scenario, stderr);
    if (scenario->topology.agent_count > limit) {
        fprintf(stderr,
                "warning: agents above %lu have no identifier in this encoding; their messages go "
                "unencoded\n",
                (unsigned long)limit);
    }
}

/* The verb's work on a scenario that is loaded. */
static int work(const struct options *options, bool replays, struct scenario *scenario)
{
    if (options->steps > UINT32_MAX - 1u - scenario->t0) {
        return complain(BAD_USE, "--steps %lu: the clock begins at %lu and would pass 2^32 - 1",
                        (unsigned long)options->steps, (unsigned long)scenario->t0);
    }
    if (options->steps != 0) {
        scenario->steps = options->steps;
    }
    /* Only fixed point has formats, and only it can fail to have them. */
    struct formats formats = {0};
    struct problem problem = {{0}};
    bool fixed = options->arithmetic == ARITHMETIC_Q31 || scenario->integer_plant;
    if (fixed && !formats_choose(scenario, &formats, &problem)) {
        return complain(BAD_USE, "%s", problem.text);
    }
    if (replays) {
        return replay_log(options, scenario, &formats);
    }
    warn(scenario);
    return run_scenario(options, scenario, &formats);
}

int main(int argument_count, char **arguments)
{
    const char *verb = argument_count > 1 ? arguments[1] : "";
    bool replays = strcmp(verb, "replay") == 0;
    if (strcmp(verb, "--help") == 0) {
        fputs(usage, stdout);
        return DONE;
    }
    if (!replays && strcmp(verb, "run") != 0) {
        return complain(BAD_USE, "%s: no such verb; it is run or replay, see onebit-sim --help",
                        verb[0] == '\0' ? "(nothing)" : verb);
    }
    struct options options = {.arithmetic = ARITHMETIC_F64, .runs = 1, .seed = 1};
    int status = read_options(&options, replays, argument_count - 1, arguments + 1);
    if (status != DONE) {
        return status;
    }
    struct problem problem = {{0}};
    struct scenario scenario;
    if (!scenario_load(&scenario, options.file, &problem)) {
        return complain(BAD_USE, "%s", problem.text);
    }
    status = work(&options, replays, &scenario);
    scenario_free(&scenario);
    return status;
}
