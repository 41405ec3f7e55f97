/* clang-format off */
/*
 * Constants of the system "aircraft-integer", written by onebit-design; change the system's file, not
 * this one. 7 agents of 4 states, broadcast mode, payload encoding, a step every
 * 0.5 s. In the paper's units:
 *
 *   beta = 1500.0, gamma = 1.0, t0 = 10, c = -2.0, M = 2.0, sigma = 4.0
 *
 * Firmware of one machine uses onebit_config_agent_<number> and the compiler drops the others;
 * firmware that learns its number later uses onebit_configs[number - 1]:
 *
 *   onebit_start(&onebit_config_agent_1, &agent, estimates, NULL);
 *
 * Initial estimates are 0, which NULL means.
 */
#ifndef ONEBIT_CONFIG_H
#define ONEBIT_CONFIG_H

#include "onebit.h"

#include <stddef.h>

#define ONEBIT_CONFIG_AGENTS 7
#define ONEBIT_CONFIG_STATES 4
/* Most neighbours of an agent: how many onebit_estimate each needs at most. */
#define ONEBIT_CONFIG_NEIGHBOURS 3
/* Between two SYNC. */
#define ONEBIT_CONFIG_PERIOD_NANOSECONDS UINT64_C(500000000)

/*
 * Formats in q31: value = integer / 2^bits. The floating arithmetics take the numbers as they are.
 *
 * States: 25 bits. In the worst case of the closed loop no state passes 19.32;
 *   32 bits then reach 64: 1.7 bits to spare, the most fraction bits with one spare.
 * Control: 28 bits. |u| passes 3.189 never, 32 bits reach 8: 1.3 bits to spare.
 * K1: 30 bits, K2 / sigma: 30 bits, the most with which the magnitudes of a row add to
 *   at most 2^31 - 1, so that no dot product overflows.
 * In units of the noise: 27 bits, the library's Q4.27.
 */
#define ONEBIT_CONFIG_STATE_FRACTION_BITS 25
#define ONEBIT_CONFIG_CONTROL_FRACTION_BITS 28
#define ONEBIT_CONFIG_ESTIMATE ONEBIT_REAL_AS(0.0, 0)

static const onebit_real onebit_config_stabilizing[] = {
    ONEBIT_REAL_AS(-0.922368108723336, -990385215),
    ONEBIT_REAL_AS(-0.18245865382311968, -195913488),
    ONEBIT_REAL_AS(0.0, 0),
    ONEBIT_REAL_AS(-0.17876328458981497, -191945615),
};
/* K2 = 3.8734107917296274, 0.9053854147375364, 0.35752656917962994, 0.8772553217364287 in the paper's units. */
static const onebit_real onebit_config_compression[] = {
    ONEBIT_REAL_AS(0.9683526979324069, 1039760792),
    ONEBIT_REAL_AS(0.2263463536843841, 243037547),
    ONEBIT_REAL_AS(0.08938164229490748, 95972808),
    ONEBIT_REAL_AS(0.21931383043410718, 235486432),
};

/*
 * The machine in integers as onebit-sim runs it (plant arithmetic q31; its step is
 * sim/integer_plant.c), row after row of A, and an agent's first states row after row. For firmware
 * that stands in for its own machine.
 */
#define ONEBIT_CONFIG_PLANT_A_FRACTION_BITS 28
#define ONEBIT_CONFIG_PLANT_B_FRACTION_BITS 30
static const int32_t onebit_config_plant_A[] = {
    197514809, 49365280, 0, 0,
    -197514809, 0, 0, 0,
    189864398, 20857435, 268435456, 134217728,
    721849785, 106407815, 0, 268435456,
};
static const int32_t onebit_config_plant_B[] = { 212815630, 592490738, -99857990, -286474319 };
static const int32_t onebit_config_initial_states[] = {
    0, 0, 167772160, 0,
    0, 0, 67108864, 0,
    0, 0, 134217728, 0,
    0, 0, 100663296, 0,
    0, 0, 50331648, 0,
    0, 0, 83886080, 0,
    0, 0, 33554432, 0,
};

#define ONEBIT_CONFIG_FRACTION_BITS \
    { 30, 30, 25, 28 }
#define ONEBIT_CONFIG_FORMAT \
    { ONEBIT_MODE_BROADCAST, ONEBIT_ENCODING_PAYLOAD, 256u, ONEBIT_SYNC_IDENTIFIER }

/* What all agents share, in the order of onebit_config. */
#define ONEBIT_CONFIG_CONSTANTS \
    onebit_config_stabilizing, onebit_config_compression, \
        ONEBIT_REAL_AS(-0.5, -67108864), /* c / sigma */ \
        ONEBIT_REAL_AS(0.5, 67108864), /* M / sigma */ \
        ONEBIT_COEFFICIENT_AS(375.0, 3145728000u, 23), /* beta / sigma */ \
        ONEBIT_COEFFICIENT_AS(4.0, 2147483648u, 29), /* gamma sigma */ \
        10u, ONEBIT_CONFIG_SEED, 0u

/* Of the random words, the same in all agents; onebit-sim's by default. */
#ifndef ONEBIT_CONFIG_SEED
#define ONEBIT_CONFIG_SEED 1u
#endif

static const uint32_t onebit_config_neighbours_1[] = { 2u, 5u, 7u };
static const onebit_config onebit_config_agent_1 = {
    1u, onebit_config_neighbours_1, 3u, ONEBIT_CONFIG_STATES,
    ONEBIT_CONFIG_FRACTION_BITS, ONEBIT_CONFIG_FORMAT, ONEBIT_CONFIG_CONSTANTS, 0u, NULL, NULL};
static const uint32_t onebit_config_neighbours_2[] = { 1u, 3u, 6u };
static const onebit_config onebit_config_agent_2 = {
    2u, onebit_config_neighbours_2, 3u, ONEBIT_CONFIG_STATES,
    ONEBIT_CONFIG_FRACTION_BITS, ONEBIT_CONFIG_FORMAT, ONEBIT_CONFIG_CONSTANTS, 0u, NULL, NULL};
static const uint32_t onebit_config_neighbours_3[] = { 2u, 4u };
static const onebit_config onebit_config_agent_3 = {
    3u, onebit_config_neighbours_3, 2u, ONEBIT_CONFIG_STATES,
    ONEBIT_CONFIG_FRACTION_BITS, ONEBIT_CONFIG_FORMAT, ONEBIT_CONFIG_CONSTANTS, 0u, NULL, NULL};
static const uint32_t onebit_config_neighbours_4[] = { 3u, 5u, 7u };
static const onebit_config onebit_config_agent_4 = {
    4u, onebit_config_neighbours_4, 3u, ONEBIT_CONFIG_STATES,
    ONEBIT_CONFIG_FRACTION_BITS, ONEBIT_CONFIG_FORMAT, ONEBIT_CONFIG_CONSTANTS, 0u, NULL, NULL};
static const uint32_t onebit_config_neighbours_5[] = { 1u, 4u, 6u };
static const onebit_config onebit_config_agent_5 = {
    5u, onebit_config_neighbours_5, 3u, ONEBIT_CONFIG_STATES,
    ONEBIT_CONFIG_FRACTION_BITS, ONEBIT_CONFIG_FORMAT, ONEBIT_CONFIG_CONSTANTS, 0u, NULL, NULL};
static const uint32_t onebit_config_neighbours_6[] = { 2u, 5u, 7u };
static const onebit_config onebit_config_agent_6 = {
    6u, onebit_config_neighbours_6, 3u, ONEBIT_CONFIG_STATES,
    ONEBIT_CONFIG_FRACTION_BITS, ONEBIT_CONFIG_FORMAT, ONEBIT_CONFIG_CONSTANTS, 0u, NULL, NULL};
static const uint32_t onebit_config_neighbours_7[] = { 1u, 4u, 6u };
static const onebit_config onebit_config_agent_7 = {
    7u, onebit_config_neighbours_7, 3u, ONEBIT_CONFIG_STATES,
    ONEBIT_CONFIG_FRACTION_BITS, ONEBIT_CONFIG_FORMAT, ONEBIT_CONFIG_CONSTANTS, 0u, NULL, NULL};

static const onebit_config *const onebit_configs[ONEBIT_CONFIG_AGENTS] = {
    &onebit_config_agent_1,
    &onebit_config_agent_2,
    &onebit_config_agent_3,
    &onebit_config_agent_4,
    &onebit_config_agent_5,
    &onebit_config_agent_6,
    &onebit_config_agent_7,
};

#endif
