/*
 * A model of one agent, for tests/fuzz_agent.c: what each call of lib/onebit.h may answer, by the
 * paper's Algorithm 1 and the sentences of the public headers and of nothing else. It includes no
 * private header and shares no way of computing with the library: products have 128 bits, floating
 * numbers are long double, F is erfcl. Compiled once for each arithmetic.
 *
 * Where the contract leaves room (the error of F and of a gain, a rounding, several reasons to
 * refuse a call at once) the model answers with all that is allowed: a set of codes, an interval.
 */
#ifndef ONEBIT_TESTS_AGENT_MODEL_H
#define ONEBIT_TESTS_AGENT_MODEL_H

#include "onebit.h"

#include <stddef.h>

/* A set of status codes: bit s is code s. */
typedef uint64_t codes;
#define CODE(status) ((codes)1 << (status))

typedef struct interval {
    long double low, high;
} interval;

/* Whether a number that the library computes is finite, where both can be within the contract too.
 */
typedef enum finiteness { FINITE, PERHAPS_FINITE, NOT_FINITE } finiteness;

/* The time of an agent, as a number that does not wrap. */
typedef uint64_t model_time;

/* Codes that onebit_check may answer. Null pointers within the configuration are allowed. */
codes model_check(const onebit_config *config);

/* Codes that onebit_start may answer for initial estimates, the configuration being right. */
codes model_initial(const onebit_config *config, const onebit_real *initial);

uint32_t model_agent_limit(const onebit_format *format);

/* The code of onebit_frame_encode; *frame is its frame, where that is ONEBIT_OK. */
onebit_status model_encode_frame(const onebit_format *format, const onebit_message *message,
                                 onebit_frame *frame);

/* The code of onebit_frame_decode; *message is its message, where that is ONEBIT_OK. */
onebit_status model_decode_frame(const onebit_format *format, const onebit_frame *frame,
                                 onebit_message *message);

/* What SYNC with a counter tells for time t; and what a frame that is SYNC tells. */
void model_sync(const onebit_format *format, uint32_t t, onebit_frame *frame);
bool model_is_sync(const onebit_format *format, const onebit_frame *frame, uint8_t *step);

/* First output word of Threefry-2x32-20, and Random123's known answers for it. */
uint32_t model_threefry(uint32_t key0, uint32_t key1, uint32_t counter0, uint32_t counter1);
bool model_knows_random123(void);

/* Number of the link whose words message k takes. */
uint32_t model_link(const onebit_config *config, unsigned k);

/* Whether K2 x is finite. */
finiteness model_compressed_finiteness(const onebit_config *config, const onebit_real *x);

/* 2^31 F((c - K2 x)/sigma) for message k. */
interval model_probability(const onebit_config *config, const onebit_real *x, unsigned k);

/*
 * Codes for a message at time t with `heard` of this step. *neighbour is the sender's place, where
 * the codes are not those of an unknown sender.
 */
codes model_receive(const onebit_config *config, model_time t, uint32_t heard,
                    const onebit_message *message, uint32_t linked, unsigned *neighbour);

/* Null if `after` may follow from `before` by neighbour k's bit at time t; else what is wrong. */
const char *model_update(const onebit_config *config, model_time t, unsigned k, bool bit,
                         const onebit_estimate *before, const onebit_estimate *after);

/* Whether `gain` is estimator_gain / t within its error. */
bool model_gain(const onebit_config *config, model_time t, onebit_gain gain);

/* Whether the estimate is one: within [-bound, bound]. */
bool model_estimate(const onebit_config *config, const onebit_estimate *estimate);

/* What the contract says of onebit_control: the codes; then whether u and the count are allowed. */
codes model_control(const onebit_config *config, model_time t, const onebit_estimate *estimates,
                    uint32_t summed, const onebit_real *x);
const char *model_control_result(const onebit_config *config, model_time t,
                                 const onebit_estimate *estimates, uint32_t summed,
                                 const onebit_real *x, onebit_real u, bool counted);

#endif
