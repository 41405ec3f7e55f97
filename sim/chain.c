/* The chain of chain.h. Touches nothing but its argument. */
#include "chain.h"

#include "onebit_random.h"

#include <string.h>

void chain_begin(struct chain *chain, const struct topology *topology, uint32_t seed, uint32_t run,
                 uint32_t first)
{
    memset(chain, 0, sizeof *chain);
    chain->topology = topology;
    chain->law = topology->stationary;
    chain->seed = seed;
    chain->run = run;
    chain->next = first;
}

uint32_t chain_graph(struct chain *chain, uint32_t t)
{
    const struct topology *topology = chain->topology;
    if (topology->graph_count == 1) {
        return 0;
    }
    /* A clock that returned from 2^32 - 1 finds the graphs of its residues. */
    for (; chain->next != 0 && chain->next <= t; ++chain->next) {
        uint32_t graph = topology_draw(topology, chain->law,
                                       onebit_random_word(chain->seed, chain->run, 0, chain->next));
        chain->law = &topology->transition[(size_t)graph * topology->graph_count];
        chain->graphs[chain->next % ONEBIT_STEP_MODULUS] = graph;
    }
    return chain->graphs[t % ONEBIT_STEP_MODULUS];
}
