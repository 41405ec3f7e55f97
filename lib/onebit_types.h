/*
 * The public types and macros of the agent library: the arithmetic, its numbers, configuration and
 * agent. No function stands here, and nothing of how the library computes.
 *
 * The arithmetic of a translation unit is chosen by ONEBIT_ARITHMETIC, and public names are mapped
 * to it: with ONEBIT_Q31, the default, onebit_control links as onebit_q31_control. So f64, f32 and
 * q31 can live in one program. The source text is the same for all three; what differs is
 * onebit_real, and with the macros below so is the text of a configuration.
 *
 * Units: compressed quantities are divided by the noise's standard deviation sigma once, at design
 * time: threshold c/sigma, bound M/sigma, compression row K2/sigma, estimator gain beta/sigma,
 * control gain gamma sigma. In q31 these are Q4.27; rows, states and control have formats of their
 * own (fraction_bits).
 */
#ifndef ONEBIT_TYPES_H
#define ONEBIT_TYPES_H

#include "onebit_frame.h"
#include "onebit_limits.h"
#include "onebit_status.h"

#include <stdbool.h>
#include <stdint.h>

#define ONEBIT_F64 64 /* double, erfc of libm: the reference */
#define ONEBIT_F32 32 /* float, CDF by table; needs no libm */
#define ONEBIT_Q31 31 /* 32-bit fixed point; the same bits on every processor */

#ifndef ONEBIT_ARITHMETIC
#define ONEBIT_ARITHMETIC ONEBIT_Q31
#endif

#if ONEBIT_ARITHMETIC == ONEBIT_F64
#define ONEBIT_NAME(name) onebit_f64_##name
#elif ONEBIT_ARITHMETIC == ONEBIT_F32
#define ONEBIT_NAME(name) onebit_f32_##name
#elif ONEBIT_ARITHMETIC == ONEBIT_Q31
#define ONEBIT_NAME(name) onebit_q31_##name
#else
#error "ONEBIT_ARITHMETIC must be ONEBIT_F64, ONEBIT_F32 or ONEBIT_Q31"
#endif

#define onebit_agent ONEBIT_NAME(agent)
#define onebit_config ONEBIT_NAME(config)
#define onebit_estimate ONEBIT_NAME(estimate)

#define onebit_check ONEBIT_NAME(check)
#define onebit_valid ONEBIT_NAME(valid)
#define onebit_start ONEBIT_NAME(start)
#define onebit_encode ONEBIT_NAME(encode)
#define onebit_send ONEBIT_NAME(send)
#define onebit_send_message ONEBIT_NAME(send_message)
#define onebit_receive ONEBIT_NAME(receive)
#define onebit_receive_message ONEBIT_NAME(receive_message)
#define onebit_control ONEBIT_NAME(control)
#define onebit_advance ONEBIT_NAME(advance)

/* ---- numbers ---- */

#if ONEBIT_ARITHMETIC == ONEBIT_Q31

typedef int32_t onebit_real;

/* A positive constant: value / 2^fraction_bits, in [2^-31, 2^32). */
typedef struct onebit_coefficient {
    uint32_t value;         /* bit 31 is set */
    uint16_t fraction_bits; /* 0..62 */
} onebit_coefficient;

/* A coefficient over t, about mantissa / 2^(places + 13); the mantissa's bit 15 is set. */
typedef struct onebit_gain {
    uint16_t mantissa;
    int16_t places;
} onebit_gain;

/*
 * One neighbour's estimate in Q4.27, and in `carry` the 32 bits that follow it: together Q4.59.
 * Without them a step that shrinks as 1/t meets rounding that does not, and the estimate drifts.
 */
typedef struct onebit_estimate {
    int32_t value;
    uint32_t carry;
} onebit_estimate;

#else

#if ONEBIT_ARITHMETIC == ONEBIT_F64
typedef double onebit_real;
#else
typedef float onebit_real;
#endif

typedef onebit_real onebit_coefficient; /* beta / sigma, gamma sigma; positive */
typedef onebit_real onebit_gain;        /* a coefficient over t */

/* One neighbour's estimate, in units of the noise, and what rounding has kept from it so far. */
typedef struct onebit_estimate {
    onebit_real value;
    onebit_real carry;
} onebit_estimate;

#endif

/*
 * Constants for initializers of static data, the same text in every arithmetic. Their arguments are
 * constants and are evaluated many times. A number out of range is an error of the compiler's in
 * every arithmetic ("initializer element is not constant": a division by zero); outside of static
 * initializers, and in C++ but for constexpr, a warning.
 *
 * ONEBIT_REAL: a state, a control or an entry of a row with so many fraction bits, which the
 * floating arithmetics ignore; rounded to the nearest, |number| < 2^(31 - bits).
 * ONEBIT_NOISE: threshold, bound and estimates, in units of the noise, below 16.
 * ONEBIT_COEFFICIENT: a gain, from 2^-31 and below 2^32.
 *
 * Where double has 32 bits (avr-gcc without -mdouble=64) the first three keep 24 bits. A program
 * that writes constants gives q31 its integers (bits of other processors or of a simulator) beside
 * the number for the others: ONEBIT_REAL_AS, ONEBIT_COEFFICIENT_AS.
 */
#define ONEBIT_NOISE_FRACTION_BITS 27
#define ONEBIT_NOISE(number) ONEBIT_REAL(number, ONEBIT_NOISE_FRACTION_BITS)

#ifdef __cplusplus
#define ONEBIT_CAST_(type, value) static_cast<type>(value)
#else
#define ONEBIT_CAST_(type, value) ((type)(value))
#endif
#define ONEBIT_OUT_OF_RANGE_UNLESS_(type, in_range)                                                \
    ONEBIT_CAST_(type, 0 / ONEBIT_CAST_(int, in_range))
#define ONEBIT_SCALED_(number, bits)                                                               \
    ((number)*ONEBIT_CAST_(double, ONEBIT_CAST_(uint64_t, 1) << (bits)))
#define ONEBIT_FITS_(scaled) ((scaled) > -2147483648.5 && (scaled) < 2147483647.5)

/* How many of 2^0 first .. 2^7 first are not above the number. */
#define ONEBIT_REACHED_(number, first)                                                             \
    (((number) >= (first)) + ((number) >= 2 * (first)) + ((number) >= 4 * (first)) +               \
     ((number) >= 8 * (first)) + ((number) >= 16 * (first)) + ((number) >= 32 * (first)) +         \
     ((number) >= 64 * (first)) + ((number) >= 128 * (first)))
/* 32 + the floor of the number's binary logarithm, from 2^-31 on: 1..63, else 0 or 64. */
#define ONEBIT_LOGARITHM_(number)                                                                  \
    (ONEBIT_REACHED_(number, 1.0 / 2147483648.0) + ONEBIT_REACHED_(number, 1.0 / 8388608.0) +      \
     ONEBIT_REACHED_(number, 1.0 / 32768.0) + ONEBIT_REACHED_(number, 1.0 / 128.0) +               \
     ONEBIT_REACHED_(number, 2.0) + ONEBIT_REACHED_(number, 512.0) +                               \
     ONEBIT_REACHED_(number, 131072.0) + ONEBIT_REACHED_(number, 33554432.0))
#define ONEBIT_NORMAL_(number) (ONEBIT_LOGARITHM_(number) >= 1 && ONEBIT_LOGARITHM_(number) <= 63)

#if ONEBIT_ARITHMETIC == ONEBIT_Q31
#define ONEBIT_REAL(number, bits)                                                                  \
    (ONEBIT_CAST_(int32_t, ONEBIT_SCALED_(number, bits) + ((number) < 0 ? -0.5 : 0.5)) +           \
     ONEBIT_OUT_OF_RANGE_UNLESS_(int32_t, ONEBIT_FITS_(ONEBIT_SCALED_(number, bits))))
/* 2^31 <= scaled < 2^32; what would round to 2^32 stays below. */
#define ONEBIT_WORD_(scaled)                                                                       \
    ((scaled) >= 4294967295.0 ? 4294967295u : ONEBIT_CAST_(uint32_t, (scaled) + 0.5))
#define ONEBIT_COEFFICIENT(number)                                                                 \
    {                                                                                              \
        ONEBIT_WORD_(ONEBIT_SCALED_(number, 63 - ONEBIT_LOGARITHM_(number))),                      \
            ONEBIT_CAST_(uint16_t, 63 - ONEBIT_LOGARITHM_(number) +                                \
                                       ONEBIT_OUT_OF_RANGE_UNLESS_(int, ONEBIT_NORMAL_(number)))   \
    }
#define ONEBIT_REAL_AS(number, integer) (integer)
#define ONEBIT_COEFFICIENT_AS(number, value, fraction_bits)                                        \
    {                                                                                              \
        value, fraction_bits                                                                       \
    }
#else
#define ONEBIT_REAL(number, bits)                                                                  \
    (ONEBIT_CAST_(onebit_real, number) +                                                           \
     ONEBIT_OUT_OF_RANGE_UNLESS_(onebit_real, ONEBIT_FITS_(ONEBIT_SCALED_(number, bits))))
#define ONEBIT_COEFFICIENT(number)                                                                 \
    (ONEBIT_CAST_(onebit_real, number) +                                                           \
     ONEBIT_OUT_OF_RANGE_UNLESS_(onebit_real, ONEBIT_NORMAL_(number)))
#define ONEBIT_REAL_AS(number, integer) ONEBIT_CAST_(onebit_real, number)
#define ONEBIT_COEFFICIENT_AS(number, value, fraction_bits) ONEBIT_CAST_(onebit_real, number)
#endif

/* ---- configuration and agent ---- */

/*
 * The constants of one agent, for flash. All that is not asked for may be left 0. Small and often
 * used fields come first: small processors reach those in one instruction.
 */
typedef struct onebit_config {
    uint32_t agent;             /* own number on the bus, from 1 */
    const uint32_t *neighbours; /* their numbers, ascending, without the own */
    uint8_t neighbour_count;    /* 1..ONEBIT_NEIGHBOURS_MAX */
    uint8_t state_count;        /* n, 1..ONEBIT_STATES_MAX */

    /* Formats in q31: an integer stands for integer / 2^bits. The floating ones ignore them. */
    struct {
        int8_t stabilizing; /* 0..46 */
        int8_t compression; /* 0..46 */
        int8_t state;       /* 0..31 */
        int8_t control;     /* 0..31 */
    } fraction_bits;

    onebit_format format; /* of the bus, see onebit_frame.h; the numbers above fit it */

    /* Rows of n. q31: the magnitudes of a row's integers add to at most 2^31 - 1. */
    const onebit_real *stabilizing; /* K1: control unit per state unit */
    const onebit_real *compression; /* K2 / sigma: noise units per state unit */

    onebit_real threshold; /* c / sigma; |threshold| + bound <= 4: beyond, the CDF is flat */
    onebit_real bound;     /* M / sigma, positive */

    onebit_coefficient estimator_gain; /* beta / sigma, at most 65536 */
    onebit_coefficient control_gain;   /* gamma sigma: control unit per noise unit */
    uint32_t start;                    /* t0, 1..2^32 - 2; the first step is t0 + 1 */

    /* Of the random words (onebit_random.h): the same in all agents, so that runs repeat. */
    uint32_t seed;
    uint32_t run;        /* of a simulator's; else 0 */
    uint32_t first_link; /* link mode: place, from 1, of the link to the first neighbour in the list
                            of the network's directed links by sender, then receiver; two agents
                            with the same would draw the same words. Broadcast: not used */

    /*
     * Thresholds by neighbour, in their order, in place of `threshold`; null where all are equal.
     * `heard_thresholds` are what the neighbours compare with when they send to this agent (the
     * paper's c_ij, i this agent), `sent_thresholds` what this agent compares with when it sends to
     * each (c_ji; link mode only: in broadcast its one bit is compared with `threshold`).
     */
    const onebit_real *heard_thresholds;
    const onebit_real *sent_thresholds;
} onebit_config;

/*
 * One agent's variables, at most 40 bytes on a 32-bit target in f32 and q31. Read what you like;
 * write through the functions of onebit.h only. All zero is an agent that was not started.
 */
typedef struct onebit_agent {
    onebit_estimate *estimates;        /* one a neighbour, in the order of config.neighbours */
    uint32_t clock;                    /* t modulo 2^32 */
    uint32_t heard;                    /* bit k: neighbour k was heard in this step */
    onebit_gain gain;                  /* estimator_gain / t */
    bool wrapped;                      /* t was beyond 2^32 - 1: gains stay what they were there */
    uint16_t refused[ONEBIT_REFUSALS]; /* frames by code - ONEBIT_REFUSED_FIRST; stop at 65535 */
    uint16_t saturated; /* q31: controls with K1 x, K2 x or u at an end of its range; to 65535 */
} onebit_agent;

#endif
