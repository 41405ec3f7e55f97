/*
 * onebit: one agent of a one-bit consensus (An, Wang, Zhao, Zhang: One-bit consensus of
 * controllable linear multi-agent systems with communication noises, Algorithm 1).
 *
 * Each step t of an agent, from start + 1 on:
 *
 *   onebit_encode   the bit to send, from the own state        -> onebit_frame_encode -> the bus
 *   onebit_receive  a neighbour's frame, once for each heard; updates that neighbour's estimate
 *   onebit_control  the input of the plant; ends the step
 *
 * onebit_advance moves the clock where steps were missed. The four verbs read the constant
 * onebit_config (flash) and, but for encode, write one onebit_agent and its links (RAM: 32 bytes
 * and 8 a neighbour in f32 and q31 on a 32-bit target). The caller owns all memory. The library has
 * no variables, allocates nothing and blocks nowhere: calls for different agents may run anywhere
 * at once, calls for one agent must not overlap. Every function refuses null pointers with
 * ONEBIT_NULL, and a refused call changes nothing but the counter of a refused frame.
 *
 * Units: compressed quantities are divided by the noise's standard deviation sigma once, at design
 * time: threshold c/sigma, bound M/sigma, compression row K2/sigma, estimator gain beta/sigma,
 * control gain gamma sigma. In q31 these are Q4.27; rows, states and control have formats of their
 * own (fraction_bits), and ONEBIT_FIXED(value, bits) writes a constant in one.
 *
 * The arithmetic is chosen by ONEBIT_ARITHMETIC, see onebit_arithmetic.h.
 */
#ifndef ONEBIT_H
#define ONEBIT_H

#include "onebit_arithmetic.h"
#include "onebit_frame.h"
#include "onebit_limits.h"
#include "onebit_status.h"

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/*
 * A constant as an integer with `bits` fraction bits, rounded to the nearest; for initializers.
 * Where double has 32 bits (avr-gcc without -mdouble=64) it keeps 24 bits of them: write integers
 * there.
 */
#define ONEBIT_FIXED(value, bits)                                                                  \
    ((int32_t)((value) * (double)((uint64_t)1 << (bits)) + ((value) < 0 ? -0.5 : 0.5)))

typedef struct onebit_config {
    uint32_t agent;             /* own number on the bus, from 1 */
    const uint32_t *neighbours; /* their numbers, ascending, without the own */
    uint8_t neighbour_count;    /* 1..ONEBIT_NEIGHBOURS_MAX */
    uint8_t state_count;        /* n, 1..ONEBIT_STATES_MAX */
    onebit_format format;       /* of the bus, see onebit_frame.h */

    /* Rows of n. q31: the magnitudes of a row's integers add to at most 2^31 - 1. */
    const onebit_real *stabilizing; /* K1: control unit per state unit */
    const onebit_real *compression; /* K2 / sigma: noise units per state unit */

    onebit_real threshold; /* c / sigma; |threshold| + bound <= 4: beyond, the CDF is flat */
    onebit_real bound;     /* M / sigma, positive */

    onebit_coefficient estimator_gain; /* beta / sigma, in (0, 65536] */
    onebit_coefficient control_gain;   /* gamma sigma, positive: control unit per noise unit */
    uint32_t start;                    /* t0, 1..2^32 - 2; the first step is t0 + 1 */

#if ONEBIT_ARITHMETIC == ONEBIT_Q31
    /* Formats: an integer stands for integer / 2^bits. */
    struct {
        int8_t stabilizing; /* 0..46 */
        int8_t compression; /* 0..46 */
        int8_t state;       /* 0..31 */
        int8_t control;     /* 0..31 */
    } fraction_bits;
#endif
} onebit_config;

/* One agent's variables. Read what you like; write through the functions below only. */
typedef struct onebit_agent {
    onebit_link *links;                /* one a neighbour, in the order of config.neighbours */
    uint32_t clock;                    /* t; after 2^32 - 1 comes 2^32 - 128 */
    uint32_t heard;                    /* bit k: neighbour k was heard in this step */
    onebit_gain gain;                  /* estimator_gain / t */
    uint16_t refused[ONEBIT_REFUSALS]; /* frames by code, see onebit_status.h; stop at 65535 */
} onebit_agent;

/*
 * Checks a configuration: ONEBIT_OK or the code that names a wrong field; the fields in the order
 * of the codes, but fraction bits before what is written in them.
 */
onebit_status onebit_check(const onebit_config *config);

/*
 * Begins at t = start + 1 with the given initial estimates (noise units; null: all 0), after
 * onebit_check. ONEBIT_ESTIMATE if one is outside [-bound, bound]. `links` holds neighbour_count
 * elements and must stay where it is as long as the agent is used.
 */
onebit_status onebit_start(const onebit_config *config, onebit_agent *agent, onebit_link *links,
                           const onebit_real *estimates);

/*
 * The bit for state x (n values): 1 with probability F((c - K2 x)/sigma), drawn with a uniform
 * random word (onebit_random_word; the upper 31 bits count). This is the comparison z + noise <= c
 * of the paper, in distribution; a caller with physical noise compares for itself. One dot product
 * and one CDF. ONEBIT_STATE if K2 x is not finite. Pure but for *bit.
 */
onebit_status onebit_encode(const onebit_config *config, const onebit_real *x, uint32_t word,
                            bool *bit);

/*
 * Takes a frame as it came from the bus, whatever it is: decodes it and updates the sender's
 * estimate. ONEBIT_OK, or one of the codes from ONEBIT_UNKNOWN on, and that code's counter moves.
 * Cost: a search over the neighbours and one onebit_estimate.
 */
onebit_status onebit_receive(const onebit_config *config, onebit_agent *agent,
                             const onebit_frame *frame);

/* The same for a message that came another way than as a frame of the configured format. */
onebit_status onebit_receive_message(const onebit_config *config, onebit_agent *agent,
                                     const onebit_message *message);

/*
 * Control input u(t) = K1 x + gamma/(t+1) sum over heard neighbours (zhat - K2 x), then t becomes
 * t + 1. ONEBIT_STATE if x, or the u that follows from it, is not finite. q31: two dot products in
 * 64 bits, each rounded to the nearest and saturated; the sum saturates.
 */
onebit_status onebit_control(const onebit_config *config, onebit_agent *agent, const onebit_real *x,
                             onebit_real *u);

/*
 * Moves the clock by `steps` without estimating or controlling, forward for steps that were missed,
 * backward to align with the group; forgets what was heard in this step. ONEBIT_CLOCK if the clock
 * would fall below start + 1.
 */
onebit_status onebit_advance(const onebit_config *config, onebit_agent *agent, int32_t steps);

#ifdef __cplusplus
}
#endif

#endif
