/* The library's inner times in the arithmetic that this file is compiled for; see bench.h. */
#include "bench.h"

#include "group.h"
#include "onebit_estimator.h"
#include "onebit_random.h"

#include <omp.h>

#define ROUNDS 5
#define LINKS 64
#define NEIGHBOURS 3
#define STATES 4

/* The aircraft in units of its noise: threshold -2/4, bound 2/4, beta/sigma 1500/4. */
#define THRESHOLD (-0.5)
#define BOUND 0.5
#define FRACTION_BITS 26
#define ROW_FRACTION_BITS 29

/* Updates all links again and again with fresh bits; nanoseconds for one. */
static double time_update(double seconds)
{
    static const onebit_coefficient beta = ONEBIT_COEFFICIENT(375.0);
    onebit_estimate estimates[LINKS] = {{0}};
    onebit_real threshold = real_from_double(THRESHOLD, ONEBIT_NOISE_FRACTION_BITS);
    onebit_real bound = real_from_double(BOUND, ONEBIT_NOISE_FRACTION_BITS);
    double fastest = 1e300;
    uint32_t t = 100000;
    for (int round = 0; round < ROUNDS; ++round) {
        double begun = omp_get_wtime();
        double elapsed;
        double updates = 0;
        do {
            onebit_gain gain = onebit_gain_of(beta, onebit_reciprocal_of(t++));
            uint32_t word = onebit_random_word(1, 0, 1, t);
            for (unsigned k = 0; k < LINKS; ++k) {
                onebit_update(&estimates[k], &gain, threshold, &bound,
                              (word >> (k % 32u) & 1u) != 0);
            }
            updates += LINKS;
            elapsed = omp_get_wtime() - begun;
        } while (elapsed < seconds / ROUNDS);
        fastest = elapsed / updates < fastest ? elapsed / updates : fastest;
    }
    /* Read, so that no compiler leaves the updates out. */
    volatile onebit_real kept = estimates[t % LINKS].value;
    (void)kept;
    return 1e9 * fastest;
}

/* Whole steps of one agent with three neighbours, through the frame codec; nanoseconds for one. */
static double time_step(double seconds)
{
    static const uint32_t neighbours[NEIGHBOURS] = {2, 3, 4};
    onebit_real stabilizing[STATES];
    onebit_real compression[STATES];
    onebit_real x[STATES];
    for (unsigned k = 0; k < STATES; ++k) {
        stabilizing[k] = real_from_double(-0.2, ROW_FRACTION_BITS);
        compression[k] = real_from_double(0.2, ROW_FRACTION_BITS);
        x[k] = real_from_double(0.1, FRACTION_BITS);
    }
    onebit_config config = {
        .agent = 1,
        .neighbours = neighbours,
        .neighbour_count = NEIGHBOURS,
        .state_count = STATES,
        .format = ONEBIT_FORMAT_BROADCAST_PAYLOAD,
        .stabilizing = stabilizing,
        .compression = compression,
        .threshold = real_from_double(THRESHOLD, ONEBIT_NOISE_FRACTION_BITS),
        .bound = real_from_double(BOUND, ONEBIT_NOISE_FRACTION_BITS),
        .estimator_gain = ONEBIT_COEFFICIENT(375.0),
        .control_gain = ONEBIT_COEFFICIENT(4.0),
        .start = 10,
        .fraction_bits = {ROW_FRACTION_BITS, ROW_FRACTION_BITS, FRACTION_BITS, FRACTION_BITS},
        .seed = 1,
    };
    onebit_agent agent;
    onebit_estimate estimates[NEIGHBOURS];
    if (onebit_start(&config, &agent, estimates, NULL) != ONEBIT_OK) {
        return -1;
    }
    double fastest = 1e300;
    for (int round = 0; round < ROUNDS; ++round) {
        double begun = omp_get_wtime();
        double elapsed;
        double steps = 0;
        do {
            for (unsigned repeat = 0; repeat < 32; ++repeat) {
                uint8_t step = (uint8_t)(agent.clock % ONEBIT_STEP_MODULUS);
                onebit_frame frame = {0};
                onebit_real u = 0;
                onebit_send(&config, &agent, x, 0, &frame);
                bool bit = (frame.data[0] & 1u) != 0;
                for (unsigned k = 0; k < NEIGHBOURS; ++k) {
                    onebit_message message = {
                        .sender = neighbours[k], .step = step, .bit = bit != (k == 1)};
                    onebit_frame_encode(&config.format, &message, &frame);
                    onebit_receive(&config, &agent, &frame, ONEBIT_ALL_LINKED, NULL);
                }
                onebit_control(&config, &agent, x, ONEBIT_ALL_LINKED, &u);
            }
            steps += 32;
            elapsed = omp_get_wtime() - begun;
        } while (elapsed < seconds / ROUNDS);
        fastest = elapsed / steps < fastest ? elapsed / steps : fastest;
    }
    return 1e9 * fastest;
}

struct agent_times ONEBIT_NAME(bench_agent)(double seconds)
{
    struct agent_times times = {
        .update_ns = time_update(seconds),
        .step_ns = time_step(seconds),
        .agent_bytes = sizeof(onebit_agent),
        .estimate_bytes = sizeof(onebit_estimate),
        .config_bytes = sizeof(onebit_config),
    };
    return times;
}
