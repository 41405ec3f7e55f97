/*
 * The README's firmware example, lib/example/pump.c, compiled as it stands: pump 1 of it and two
 * further pumps written here agree over a wire of frames.
 */
#include "pump.h"

#include "onebit.h"
#include "onebit_random.h"

#include <math.h>
#include <unity.h>

#define STEPS 20000
#define ONE_BAR 67108864.0 /* Q26 */

static onebit_frame sent[3];

void setUp(void)
{
}

void tearDown(void)
{
}

void pump_send(const onebit_frame *frame)
{
    sent[0] = *frame;
}

/*
 * An estimate's error has variance beta^2 F(1-F)/(2 beta f - 1)/t (Fisher information of a bit):
 * here 8.2/t, a standard deviation of 0.02 bar after 2e4 steps, and the pumps differ by less than
 * that. Five of them is the bound.
 */
static void test_three_pumps_agree(void)
{
    static const uint32_t neighbours[3][2] = {{2, 3}, {1, 3}, {1, 2}};
    static const int32_t stabilizing[] = {0};
    static const int32_t compression[] = {ONEBIT_REAL(1.0, 30)};
    onebit_config config[3];
    onebit_agent agent[3];
    onebit_estimate links[3][2];
    int32_t pressure[3] = {ONEBIT_REAL(1.5, 26), ONEBIT_REAL(-1.0, 26), ONEBIT_REAL(0.5, 26)};
    TEST_ASSERT_TRUE(pump_start());
    for (unsigned k = 1; k < 3; ++k) {
        config[k] = (onebit_config){
            .agent = k + 1,
            .neighbours = neighbours[k],
            .neighbour_count = 2,
            .state_count = 1,
            .format = {ONEBIT_MODE_BROADCAST, ONEBIT_ENCODING_PAYLOAD, ONEBIT_PAYLOAD_BASE},
            .stabilizing = stabilizing,
            .compression = compression,
            .threshold = 0,
            .bound = ONEBIT_REAL(2.0, 27),
            .estimator_gain = {25, 0},
            .control_gain = {1, 0},
            .start = 20,
            .fraction_bits = {30, 30, 26, 26},
        };
        TEST_ASSERT_EQUAL(ONEBIT_OK, onebit_start(&config[k], &agent[k], links[k], NULL));
    }
    for (unsigned step = 0; step < STEPS; ++step) {
        pump_step_begins(pressure[0]);
        for (unsigned k = 1; k < 3; ++k) {
            uint32_t t = agent[k].clock;
            onebit_message message = {.sender = k + 1, .step = (uint8_t)(t % ONEBIT_STEP_MODULUS)};
            onebit_encode(&config[k], &pressure[k], onebit_random_word(1, 0, k + 1, t),
                          &message.bit);
            onebit_frame_encode(&config[k].format, &message, &sent[k]);
        }
        for (unsigned k = 0; k < 3; ++k) {
            if (k != 0) {
                pump_receive(&sent[k]);
            }
            for (unsigned i = 1; i < 3; ++i) {
                if (i != k) {
                    TEST_ASSERT_EQUAL(ONEBIT_OK, onebit_receive(&config[i], &agent[i], &sent[k]));
                }
            }
        }
        pressure[0] += pump_step_ends();
        for (unsigned k = 1; k < 3; ++k) {
            int32_t change;
            TEST_ASSERT_EQUAL(ONEBIT_OK,
                              onebit_control(&config[k], &agent[k], &pressure[k], &change));
            pressure[k] += change;
        }
    }
    for (unsigned k = 1; k < 3; ++k) {
        TEST_ASSERT_DOUBLE_WITHIN(0.1, 0.0, (pressure[k] - pressure[0]) / ONE_BAR);
    }
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_three_pumps_agree);
    return UNITY_END();
}
