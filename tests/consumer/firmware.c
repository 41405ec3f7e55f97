/*
 * A program of somebody else's that takes the library, for tests/test_consumers.py: one agent hears
 * two neighbours for fifty steps and prints the arithmetic and what it believes and commands. C99
 * and C++11; touches standard output.
 */
#include "onebit.h"
#include "onebit_random.h"

#include <stdio.h>

#define STEPS 50

#if ONEBIT_ARITHMETIC == ONEBIT_Q31
#define VALUE(number, bits) ((double)(number) / (double)((uint64_t)1 << (bits)))
#else
#define VALUE(number, bits) ((double)(number))
#endif

int main(void)
{
    static const uint32_t neighbours[] = {2, 3};
    static const onebit_format format = ONEBIT_FORMAT_BROADCAST_PAYLOAD;
    static const onebit_real stabilizing[] = {ONEBIT_REAL(-0.5, 30)};
    static const onebit_real compression[] = {ONEBIT_REAL(1.0, 30)};
    static const onebit_coefficient estimator_gain = ONEBIT_COEFFICIENT(5.0);
    static const onebit_coefficient control_gain = ONEBIT_COEFFICIENT(2.0);
    static onebit_config config;
    onebit_agent agent;
    onebit_estimate estimates[2];
    onebit_real x = ONEBIT_REAL(0.25, 26);
    onebit_real u = 0;

    config.agent = 1;
    config.neighbours = neighbours;
    config.neighbour_count = 2;
    config.state_count = 1;
    config.format = format;
    config.stabilizing = stabilizing;
    config.compression = compression;
    config.threshold = ONEBIT_NOISE(-0.5);
    config.bound = ONEBIT_NOISE(2.0);
    config.estimator_gain = estimator_gain;
    config.control_gain = control_gain;
    config.start = 10;
    config.fraction_bits.stabilizing = 30;
    config.fraction_bits.compression = 30;
    config.fraction_bits.state = 26;
    config.fraction_bits.control = 26;
    if (onebit_start(&config, &agent, estimates, NULL) != ONEBIT_OK) {
        return 1;
    }
    printf("%d %d\n", ONEBIT_ARITHMETIC, (int)sizeof(onebit_real));
    /* Threefry's third known answer, first word c4923a9c (Random123). */
    printf("%lx\n",
           (unsigned long)onebit_random_word(0x13198a2e, 0x03707344, 0x243f6a88, 0x85a308d3));
    for (int step = 0; step < STEPS; ++step) {
        for (uint32_t sender = 2; sender <= 3; ++sender) {
            static onebit_message message;
            onebit_frame frame;
            message.sender = sender;
            message.step = (uint8_t)(agent.clock % ONEBIT_STEP_MODULUS);
            message.bit = (7 * agent.clock + 3 * sender) % 5 < 2;
            if (onebit_frame_encode(&config.format, &message, &frame) != ONEBIT_OK ||
                onebit_receive(&config, &agent, &frame, ONEBIT_ALL_LINKED, NULL) != ONEBIT_OK) {
                return 1;
            }
        }
        if (onebit_control(&config, &agent, &x, ONEBIT_ALL_LINKED, &u) != ONEBIT_OK) {
            return 1;
        }
        printf("%.15f %.15f %.15f\n", VALUE(estimates[0].value, 27), VALUE(estimates[1].value, 27),
               VALUE(u, 26));
    }
    return 0;
}
