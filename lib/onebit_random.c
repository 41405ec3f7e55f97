/* Threefry-2x32-20 of onebit_random.h. Touches nothing but its arguments. */
#include "onebit_random.h"

#include <stddef.h>

/* Skein's key schedule parity for 32-bit words. */
#define PARITY 0x1BD11BDAu

static inline uint32_t rotate(uint32_t word, unsigned places)
{
    return (word << places) | (word >> (32u - places));
}

/* Four rounds and the key injection that follows them; `a` and `b` are the next two key words. */
#define FOUR_ROUNDS(r0, r1, r2, r3, a, b, injection)                                               \
    do {                                                                                           \
        x0 += x1;                                                                                  \
        x1 = rotate(x1, r0) ^ x0;                                                                  \
        x0 += x1;                                                                                  \
        x1 = rotate(x1, r1) ^ x0;                                                                  \
        x0 += x1;                                                                                  \
        x1 = rotate(x1, r2) ^ x0;                                                                  \
        x0 += x1;                                                                                  \
        x1 = rotate(x1, r3) ^ x0;                                                                  \
        x0 += (a);                                                                                 \
        x1 += (b) + (injection);                                                                   \
    } while (0)

uint32_t onebit_threefry(uint32_t key0, uint32_t key1, uint32_t counter0, uint32_t counter1,
                         uint32_t *second)
{
    uint32_t key2 = PARITY ^ key0 ^ key1;
    uint32_t x0 = counter0 + key0;
    uint32_t x1 = counter1 + key1;
    FOUR_ROUNDS(13u, 15u, 26u, 6u, key1, key2, 1u);
    FOUR_ROUNDS(17u, 29u, 16u, 24u, key2, key0, 2u);
    FOUR_ROUNDS(13u, 15u, 26u, 6u, key0, key1, 3u);
    FOUR_ROUNDS(17u, 29u, 16u, 24u, key1, key2, 4u);
    FOUR_ROUNDS(13u, 15u, 26u, 6u, key2, key0, 5u);
    if (second != NULL) {
        *second = x1;
    }
    return x0;
}
