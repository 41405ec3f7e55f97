/*
 * Who hears whom: the graphs of a scenario, the union's directed links, and the Markov chain that
 * switches between the graphs. Agents are numbered from 1, graphs and links from 0.
 */
#ifndef TOPOLOGY_H
#define TOPOLOGY_H

#include "problem.h"

#include <stdbool.h>
#include <stdint.h>

struct edge {
    uint32_t first; /* agent numbers; undirected */
    uint32_t second;
};

struct topology {
    uint32_t agent_count;
    uint32_t graph_count;
    double *transition;  /* graph_count x graph_count, rows sum to one; {1} for one graph */
    double *stationary;  /* graph_count: the chain's stationary law */
    uint32_t period;     /* of the chain; 1 is aperiodic */
    uint32_t components; /* connected components of the union */

    /* Directed links of the union, both ways of every edge, sorted by sender, then receiver. */
    uint32_t link_count;
    uint32_t *link_sender;
    uint32_t *link_receiver;
    uint32_t
        *first_link; /* agent_count + 1: links of sender j are first_link[j-1] .. first_link[j]-1 */
    uint8_t *linked; /* graph_count x link_count: 1 where the graph has the link */
};

/* What topology_build refused. */
struct topology_place {
    enum { TOPOLOGY_MEMORY, TOPOLOGY_EDGE, TOPOLOGY_TRANSITION } part;
    uint32_t graph; /* of the edge, or the row of the transition matrix; from 0 */
    uint32_t edge;  /* in its graph's list, from 0 */
};

/*
 * Builds the topology of `graph_count` edge lists in O(links log links + graph_count^3). Edges must
 * name two different agents in 1..agent_count, once per graph; the chain must be irreducible, its
 * rows hold probabilities that sum to one. On failure says why in *problem and where in *place
 * (null is allowed), allocates nothing. `transition` may be null for one graph.
 */
bool topology_build(struct topology *topology, uint32_t agent_count, uint32_t graph_count,
                    const struct edge *const *edges, const uint32_t *edge_counts,
                    const double *transition, struct topology_place *place,
                    struct problem *problem);

void topology_free(struct topology *topology);

/* Degree of an agent in one graph. */
uint32_t topology_degree(const struct topology *topology, uint32_t graph, uint32_t agent);

/*
 * The graph of a step, drawn with the upper 31 bits of `word`: the first graph whose cumulative
 * probability times 2^31 exceeds word >> 1, the last one if none does. `law` is the stationary law
 * at the first step, the previous graph's row of the transition matrix later.
 */
uint32_t topology_draw(const struct topology *topology, const double *law, uint32_t word);

#endif
