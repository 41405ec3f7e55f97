/*
 * onebit: one agent of a one-bit consensus (An, Wang, Zhao, Zhang: One-bit consensus of
 * controllable linear multi-agent systems with communication noises, Algorithm 1).
 *
 * Each step t of an agent, from start + 1 on:
 *
 *   onebit_send     the frame that tells the own state in one bit, for the bus
 *   onebit_receive  a neighbour's frame, once for each heard; updates that neighbour's estimate
 *   onebit_control  the input of the plant; ends the step
 *
 * onebit_advance moves the clock where steps were missed. These read the constant onebit_config
 * (flash) and write one onebit_agent and its estimates (RAM, see onebit_types.h). The caller owns
 * all memory. The library has no variables, allocates nothing and blocks nowhere: calls for
 * different agents may run anywhere at once, calls for one agent must not overlap. Every function
 * refuses null pointers with ONEBIT_NULL and an agent that was not started with ONEBIT_NOT_STARTED;
 * a refused call changes nothing but the counter of a refused frame.
 *
 * Types, units, formats and the choice of the arithmetic stand in onebit_types.h, the ways to build
 * a smaller library in README.md.
 */
#ifndef ONEBIT_H
#define ONEBIT_H

#include "onebit_types.h"
#include "onebit_version.h"

#ifdef __cplusplus
extern "C" {
#endif

/* `linked` where the network does not switch: all neighbours are linked in every step. */
#define ONEBIT_ALL_LINKED UINT32_MAX

/*
 * Checks a configuration: ONEBIT_OK or the code that names a wrong field; the fields in the order
 * of the codes, but fraction bits before what is written in them. Pure.
 */
onebit_status onebit_check(const onebit_config *config);

/*
 * Whether the agent's variables can be what the functions below left there: memory that something
 * else wrote upon is found with them, not with certainty. Pure; about one onebit_gain and a
 * comparison an estimate, the same whatever the variables are. False for null.
 */
bool onebit_valid(const onebit_config *config, const onebit_agent *agent);

/*
 * Begins at t = start + 1 with the given initial estimates, one a neighbour (noise units; null: all
 * 0), after onebit_check. ONEBIT_ESTIMATE if one is outside [-bound, bound]. `estimates` holds
 * neighbour_count elements and must stay where it is as long as the agent is used.
 */
onebit_status onebit_start(const onebit_config *config, onebit_agent *agent,
                           onebit_estimate *estimates, const onebit_real *initial);

/* How many messages an agent sends in a step: one to all in broadcast, one to each in link mode. */
static inline unsigned onebit_message_count(const onebit_config *config)
{
    return config->format.mode == ONEBIT_MODE_LINK ? config->neighbour_count : 1u;
}

/*
 * The frame of message k, 0 .. onebit_message_count - 1, of this step for state x (n values): bit,
 * number, step and, in link mode, the receiver neighbours[k]. The bit is 1 with probability
 * F((c - K2 x)/sigma), which is the comparison z + noise <= c of the paper, in distribution; it is
 * drawn with the random word of (seed, run; link, t). The same call gives the same frame, so none
 * has to be kept. ONEBIT_MESSAGE if there is no message k, ONEBIT_STATE if K2 x is not finite,
 * ONEBIT_CONFIG_FORMAT where the format has no frames; then *frame is untouched. One dot product,
 * one random word and one CDF.
 */
onebit_status onebit_send(const onebit_config *config, onebit_agent *agent, const onebit_real *x,
                          unsigned k, onebit_frame *frame);

/* The same as a message, for a bus that is none of onebit_frame.h's. */
onebit_status onebit_send_message(const onebit_config *config, onebit_agent *agent,
                                  const onebit_real *x, unsigned k, onebit_message *message);

/*
 * The bit of message k alone, drawn with a uniform random word of the caller's (the upper 31 bits
 * count). Pure but for *bit. Whoever has physical noise compares for himself and calls
 * onebit_frame_encode.
 */
onebit_status onebit_encode(const onebit_config *config, const onebit_real *x, unsigned k,
                            uint32_t word, bool *bit);

/*
 * Takes a frame as it came from the bus, whatever it is: decodes it and updates the sender's
 * estimate, if bit k of `linked` says that neighbour k is linked in this step. ONEBIT_OK, or one of
 * the codes from ONEBIT_REFUSED_FIRST on, whose counter moves; ONEBIT_CONFIG_FORMAT where the
 * format has no frames. Where onebit_is_message(status), *message (or null) is what
 * the frame says, else it is untouched. Cost: a search over the neighbours and one update.
 */
onebit_status onebit_receive(const onebit_config *config, onebit_agent *agent,
                             const onebit_frame *frame, uint32_t linked, onebit_message *message);

/*
 * The same for a message that came another way than as a frame of the configured format.
 * ONEBIT_OK or a code for which onebit_is_message holds: of several the first of unknown, unlinked,
 * stale or early, repeated.
 */
onebit_status onebit_receive_message(const onebit_config *config, onebit_agent *agent,
                                     const onebit_message *message, uint32_t linked);

/*
 * Control input u(t) = K1 x + gamma/(t+1) sum (zhat - K2 x) over the neighbours that were heard and
 * are linked, then t becomes t + 1. ONEBIT_STATE if x, or the u that follows from it, is not
 * finite; the clock then stands. q31: two dot products in 64 bits and the consensus term, each
 * rounded to the nearest and saturated; their sum saturates, and a consensus term at an end of the
 * range is u, whatever K1 x. A step with K1 x, K2 x or u at an end of its range counts in
 * `saturated`.
 */
onebit_status onebit_control(const onebit_config *config, onebit_agent *agent, const onebit_real *x,
                             uint32_t linked, onebit_real *u);

/*
 * Moves the clock by `steps` without estimating or controlling, forward for steps that were missed,
 * backward to align with the group; forgets what was heard in this step. ONEBIT_CLOCK if t would
 * fall below start + 1. Beyond t = 2^32 - 1 the clock goes on modulo 2^32 and the gains stay what
 * they were there, wherever it is moved.
 */
onebit_status onebit_advance(const onebit_config *config, onebit_agent *agent, int32_t steps);

#ifdef __cplusplus
}
#endif

#endif
