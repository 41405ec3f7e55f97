/* The rule of alignment.h. Touches nothing but its arguments. */
#include "alignment.h"

#include "onebit_random.h"

#include <stdbool.h>

#define HALF (ONEBIT_STEP_MODULUS / 2u)

/* Of alignment.h's table, in steps. */
#define NEW 16u
#define UNCONFIRMED_MOVES 4u
#define DOUBTED_MOVES 8u
#define TOLD 8u

#define WEIGHT_AHEAD 4u
#define WEIGHT_BEHIND 1024u

/*
 * A node has at most 32 neighbours; the counts stop above that so that the comparison in draws()
 * holds in 32 bits whatever is on the bus: (2^16 - 1) (63 + 1024 * 63) < 2^32.
 */
#define COUNT_MAX 63u
#define PROBABILITY (7u << 13) /* 7/8 in units of 2^-16 */

/* Keeps these words apart from those of messages, whose key is (seed, run). */
#define KEY 0x616C6967u

static uint8_t one_more(uint8_t count, uint8_t most)
{
    return count < most ? (uint8_t)(count + 1u) : most;
}

void alignment_hear(struct alignment *alignment, uint32_t clock, const onebit_message *message)
{
    if (!message->has_step) {
        return;
    }
    uint8_t error = (uint8_t)((message->step - clock) % ONEBIT_STEP_MODULUS);
    if (error == 0) {
        alignment->on = one_more(alignment->on, COUNT_MAX);
        return;
    }
    /* The k-th takes the place of the one before with probability 1/k, so that all are equal. The
       generator is Knuth's and Lewis's; every word drawn seeds it anew. */
    alignment->off = one_more(alignment->off, COUNT_MAX);
    alignment->choice = alignment->choice * 1664525u + 1013904223u;
    if ((alignment->choice >> 16) * alignment->off < 0x10000u) {
        alignment->error = error;
    }
}

/* The nearest way to a clock that is `error` ahead modulo 128, and not below the first step. */
static int32_t nearest(uint8_t error, uint32_t next, uint32_t first)
{
    if (error < HALF || next - first < ONEBIT_STEP_MODULUS - error) {
        return error;
    }
    return (int32_t)error - (int32_t)ONEBIT_STEP_MODULUS;
}

/* Two clocks 64 apart differ in bit 6, which then says for both which one is ahead. */
static bool is_ahead(uint8_t error, uint32_t next)
{
    return error < HALF || (error == HALF && (next & HALF) == 0);
}

/* Draws whether the node moves, where it may. */
static bool draws(struct alignment *alignment, uint32_t agent, uint32_t next, uint32_t on,
                  uint32_t off)
{
    uint32_t weight = 1;
    if (alignment->confirmed >= NEW && alignment->unconfirmed < UNCONFIRMED_MOVES) {
        if (alignment->doubted < DOUBTED_MOVES) {
            return false;
        }
        on = on == 0 ? 1u : on;
        weight = is_ahead(alignment->error, next) ? WEIGHT_AHEAD : WEIGHT_BEHIND;
    }
    uint64_t words = onebit_threefry(agent, KEY, next, alignment->draws);
    ++alignment->draws;
    alignment->choice = (uint32_t)(words >> 32);
    return ((uint32_t)words >> 16) * (off + weight * on) < off * PROBABILITY;
}

int32_t alignment_end_step(struct alignment *alignment, uint32_t agent, uint32_t next,
                           uint32_t first)
{
    uint8_t on = alignment->on;
    uint8_t off = alignment->off;
    bool told = alignment->told != 0;
    alignment->on = 0;
    alignment->off = 0;
    if (told) {
        --alignment->told;
    }
    if (on != 0) {
        alignment->confirmed = one_more(alignment->confirmed, NEW);
        alignment->unconfirmed = 0;
    } else if (off != 0) {
        alignment->unconfirmed = one_more(alignment->unconfirmed, UNCONFIRMED_MOVES);
    }
    if (off != 0) {
        alignment->doubted = one_more(alignment->doubted, DOUBTED_MOVES);
    } else if (on != 0) {
        alignment->doubted = 0;
    }
    if (off == 0 || told || !draws(alignment, agent, next, on, off)) {
        return 0;
    }
    return nearest(alignment->error, next, first);
}

int32_t alignment_sync(struct alignment *alignment, uint8_t residue, uint32_t next, uint32_t first)
{
    alignment->told = TOLD;
    return nearest((uint8_t)((residue - next) % ONEBIT_STEP_MODULUS), next, first);
}
