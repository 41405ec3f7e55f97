/*
 * The README's firmware example, lib/example/pump.c, compiled as it stands, in each arithmetic:
 * pump 1 of it and two further pumps written here agree over a wire of frames.
 */
#include "pump.h"

#include <math.h>
#include <string.h>
#include <unity.h>

#define STEPS 20000
#if ONEBIT_ARITHMETIC == ONEBIT_Q31
#define BAR 67108864.0 /* Q5.26 */
#else
#define BAR 1.0
#endif

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
    static const onebit_real stabilizing[] = {0};
    static const onebit_real compression[] = {ONEBIT_REAL(1.0, 30)};
    onebit_config config[3];
    onebit_agent agent[3];
    onebit_estimate estimates[3][2];
    onebit_real pressure[3] = {ONEBIT_REAL(1.5, 26), ONEBIT_REAL(-1.0, 26), ONEBIT_REAL(0.5, 26)};
    TEST_ASSERT_TRUE(pump_start());
    for (unsigned k = 1; k < 3; ++k) {
        config[k] = (onebit_config){
            .agent = k + 1,
            .neighbours = neighbours[k],
            .neighbour_count = 2,
            .state_count = 1,
            .format = ONEBIT_FORMAT_BROADCAST_PAYLOAD,
            .stabilizing = stabilizing,
            .compression = compression,
            .threshold = 0,
            .bound = ONEBIT_NOISE(2.0),
            .estimator_gain = ONEBIT_COEFFICIENT(25.0),
            .control_gain = ONEBIT_COEFFICIENT(1.0),
            .start = 20,
            .fraction_bits = {30, 30, 26, 26},
            .seed = 1,
        };
        TEST_ASSERT_EQUAL(ONEBIT_OK, onebit_start(&config[k], &agent[k], estimates[k], NULL));
    }
    for (unsigned step = 0; step < STEPS; ++step) {
        TEST_ASSERT_TRUE(pump_step_begins(pressure[0]));
        for (unsigned k = 1; k < 3; ++k) {
            TEST_ASSERT_EQUAL(ONEBIT_OK,
                              onebit_send(&config[k], &agent[k], &pressure[k], 0, &sent[k]));
        }
        for (unsigned k = 0; k < 3; ++k) {
            if (k != 0) {
                pump_receive(&sent[k]);
            }
            for (unsigned i = 1; i < 3; ++i) {
                if (i != k) {
                    TEST_ASSERT_EQUAL(ONEBIT_OK, onebit_receive(&config[i], &agent[i], &sent[k],
                                                                ONEBIT_ALL_LINKED, NULL));
                }
            }
        }
        onebit_real change;
        TEST_ASSERT_TRUE(pump_step_ends(&change));
        pressure[0] += change;
        for (unsigned k = 1; k < 3; ++k) {
            TEST_ASSERT_EQUAL(ONEBIT_OK, onebit_control(&config[k], &agent[k], &pressure[k],
                                                        ONEBIT_ALL_LINKED, &change));
            pressure[k] += change;
        }
    }
    for (unsigned k = 1; k < 3; ++k) {
        TEST_ASSERT_DOUBLE_WITHIN(0.1, 0.0, (double)(pressure[k] - pressure[0]) / BAR);
    }
}

#if ONEBIT_ARITHMETIC != ONEBIT_Q31
/* A sensor's NaN sends nothing. */
static void test_a_pressure_that_is_not_finite(void)
{
    TEST_ASSERT_TRUE(pump_start());
    memset(&sent[0], 0xA5, sizeof sent[0]);
    onebit_frame untouched = sent[0];
    TEST_ASSERT_FALSE(pump_step_begins((onebit_real)NAN));
    TEST_ASSERT_EQUAL_MEMORY(&untouched, &sent[0], sizeof untouched);
    onebit_real change = 0;
    TEST_ASSERT_FALSE(pump_step_ends(&change));
}
#endif

int main(void)
{
    UNITY_BEGIN();
#if ONEBIT_ARITHMETIC != ONEBIT_Q31
    RUN_TEST(test_a_pressure_that_is_not_finite);
#endif
    RUN_TEST(test_three_pumps_agree);
    return UNITY_END();
}
