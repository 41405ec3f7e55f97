/* Chooses between the copies of simulation.c and replay.c. */
#include "replay.h"
#include "simulation.h"

const char *const arithmetic_names[ARITHMETIC_COUNT] = {"f64", "f32", "q31"};

bool simulate(enum arithmetic arithmetic, const struct scenario *scenario,
              const struct formats *formats, struct run *run, struct problem *problem)
{
    static simulate_function *const functions[ARITHMETIC_COUNT] = {
        onebit_f64_simulate, onebit_f32_simulate, onebit_q31_simulate};
    return functions[arithmetic](scenario, formats, run, problem);
}

bool replay(enum arithmetic arithmetic, const struct scenario *scenario,
            const struct formats *formats, const struct replay *what, struct log_reader *log,
            FILE *stream, struct problem *problem)
{
    static replay_function *const functions[ARITHMETIC_COUNT] = {
        onebit_f64_replay, onebit_f32_replay, onebit_q31_replay};
    return functions[arithmetic](scenario, formats, what, log, stream, problem);
}
