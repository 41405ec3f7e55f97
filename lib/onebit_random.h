/*
 * Random words: Threefry-2x32 with 20 rounds (Salmon, Moraes, Dror, Shaw: Parallel random numbers:
 * as easy as 1, 2, 3; SC'11). A pure function of key and counter: no state, any order, any thread,
 * the same word on every processor. About 100 additions, rotations and exclusive-ors of 32-bit
 * words.
 */
#ifndef ONEBIT_RANDOM_H
#define ONEBIT_RANDOM_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/*
 * Threefry-2x32-20 of counter {counter0, counter1} under key {key0, key1}: the first output word in
 * the lower half of the result, the second in the upper.
 */
uint64_t onebit_threefry(uint32_t key0, uint32_t key1, uint32_t counter0, uint32_t counter1);

/*
 * The word of a link at clock t modulo 2^32: key (seed, run), counter (link, t), first output word.
 * `link` is the sender's number in broadcast, the place (from 1) of the directed link in the list
 * sorted by sender then receiver in link mode, and 0 for the chain that switches the topology.
 */
static inline uint32_t onebit_random_word(uint32_t seed, uint32_t run, uint32_t link, uint32_t t)
{
    return onebit_threefry(seed, run, link, t) & 0xFFFFFFFFu;
}

#ifdef __cplusplus
}
#endif

#endif
