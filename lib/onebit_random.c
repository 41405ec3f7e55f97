/* Threefry-2x32-20 of onebit_random.h. Touches nothing but its arguments. */
#include "onebit_random.h"

#include "onebit_processor.h"

/* Skein's key schedule parity for 32-bit words. */
#define PARITY 0x1BD11BDAu

/*
 * The rotations of four rounds, the first in the lowest byte: to the right, as Cortex-M0 rotates,
 * where the paper's 13, 15, 26, 6 and 17, 29, 16, 24 are to the left.
 */
#define ODD_ROTATIONS 0x1A061113u
#define EVEN_ROTATIONS 0x0810030Fu

static inline void round_of(uint32_t x[2], uint32_t rotation)
{
    x[0] += x[1];
    x[1] = onebit_rotated(x[1], (unsigned)rotation) ^ x[0];
}

/*
 * Four rounds and the key injection that follows them. A function, which a compiler for size makes
 * once and a compiler for speed five times.
 */
static inline void four_rounds(uint32_t x[2], uint32_t rotations, uint32_t key0, uint32_t key1)
{
    round_of(x, rotations & 31u);
    round_of(x, rotations >> 8 & 31u);
    round_of(x, rotations >> 16 & 31u);
    round_of(x, rotations >> 24 & 31u);
    x[0] += key0;
    x[1] += key1;
}

uint64_t onebit_threefry(uint32_t key0, uint32_t key1, uint32_t counter0, uint32_t counter1)
{
    uint32_t key2 = PARITY ^ key0 ^ key1;
    uint32_t x[2] = {counter0 + key0, counter1 + key1};
    four_rounds(x, ODD_ROTATIONS, key1, key2 + 1u);
    four_rounds(x, EVEN_ROTATIONS, key2, key0 + 2u);
    four_rounds(x, ODD_ROTATIONS, key0, key1 + 3u);
    four_rounds(x, EVEN_ROTATIONS, key1, key2 + 4u);
    four_rounds(x, ODD_ROTATIONS, key2, key0 + 5u);
    return (uint64_t)x[1] << 32 | x[0];
}
