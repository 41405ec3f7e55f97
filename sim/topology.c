/* Builds and asks the graphs of topology.h. Touches nothing but its arguments and the heap. */
#include "topology.h"

#include <stdlib.h>
#include <string.h>

/* One direction of one edge of one graph; sorted, these are the links of the union. */
struct arc {
    uint32_t sender;
    uint32_t receiver;
    uint32_t graph;
    uint32_t edge;
};

static int by_number(uint32_t a, uint32_t b)
{
    return (a > b) - (a < b);
}

static int by_link(const void *left, const void *right)
{
    const struct arc *a = left;
    const struct arc *b = right;
    int order = by_number(a->sender, b->sender);
    order = order != 0 ? order : by_number(a->receiver, b->receiver);
    order = order != 0 ? order : by_number(a->graph, b->graph);
    return order != 0 ? order : by_number(a->edge, b->edge);
}

/* Both directions of all edges, sorted, after a check of each edge. */
static bool collect_arcs(struct arc *arcs, uint32_t agent_count, uint32_t graph_count,
                         const struct edge *const *edges, const uint32_t *edge_counts,
                         struct topology_place *place, struct problem *problem)
{
    size_t count = 0;
    for (uint32_t graph = 0; graph < graph_count; graph++) {
        for (uint32_t k = 0; k < edge_counts[graph]; k++) {
            uint32_t first = edges[graph][k].first;
            uint32_t second = edges[graph][k].second;
            uint32_t missing = first - 1u >= agent_count ? first : second;
            *place = (struct topology_place){TOPOLOGY_EDGE, graph, k};
            if (missing - 1u >= agent_count) {
                return problem_set(problem, "agent %u does not exist, there are agents 1 to %u",
                                   missing, agent_count);
            }
            if (first == second) {
                return problem_set(problem, "joins agent %u to itself, must join two", first);
            }
            arcs[count++] = (struct arc){first, second, graph, k};
            arcs[count++] = (struct arc){second, first, graph, k};
        }
    }
    qsort(arcs, count, sizeof *arcs, by_link);
    for (size_t k = 1; k < count; k++) {
        const struct arc *arc = &arcs[k];
        if (arc[-1].sender == arc->sender && arc[-1].receiver == arc->receiver &&
            arc[-1].graph == arc->graph) {
            *place = (struct topology_place){TOPOLOGY_EDGE, arc->graph, arc->edge};
            return problem_set(problem, "repeats edge %u of its graph, must stand once",
                               arc[-1].edge + 1u);
        }
    }
    *place = (struct topology_place){TOPOLOGY_MEMORY, 0, 0};
    return true;
}

/* Links of the union from its sorted arcs; link_count is known. */
static void fill_links(struct topology *topology, const struct arc *arcs, size_t arc_count)
{
    size_t links = topology->link_count;
    size_t link = 0;
    for (size_t k = 0; k < arc_count; k++) {
        const struct arc *arc = &arcs[k];
        if (k > 0 && (arc[-1].sender != arc->sender || arc[-1].receiver != arc->receiver)) {
            link++;
        }
        topology->link_sender[link] = arc->sender;
        topology->link_receiver[link] = arc->receiver;
        topology->linked[arc->graph * links + link] = 1;
    }
    link = 0;
    for (uint32_t agent = 0; agent <= topology->agent_count; agent++) {
        while (link < links && topology->link_sender[link] <= agent) {
            link++;
        }
        topology->first_link[agent] = (uint32_t)link;
    }
}

/* Components of the union by joining the trees of agents that a link connects. */
static uint32_t count_components(const struct topology *topology, uint32_t *parent)
{
    uint32_t components = topology->agent_count;
    for (uint32_t agent = 0; agent < topology->agent_count; agent++) {
        parent[agent] = agent;
    }
    for (uint32_t link = 0; link < topology->link_count; link++) {
        uint32_t roots[2] = {topology->link_sender[link] - 1u, topology->link_receiver[link] - 1u};
        for (int side = 0; side < 2; side++) {
            while (parent[roots[side]] != roots[side]) {
                parent[roots[side]] = parent[parent[roots[side]]]; /* halves the path */
                roots[side] = parent[roots[side]];
            }
        }
        if (roots[0] != roots[1]) {
            parent[roots[0]] = roots[1];
            components--;
        }
    }
    return components;
}

#define UNREACHED UINT32_MAX

/* Steps from graph 0 to each graph along (or, `backward`, against) the chain's transitions. */
static void reach(const struct topology *topology, bool backward, uint32_t *level, uint32_t *queue)
{
    size_t count = topology->graph_count;
    memset(level, 0xFF, count * sizeof *level);
    level[0] = 0;
    queue[0] = 0;
    for (size_t head = 0, tail = 1; head < tail; head++) {
        uint32_t here = queue[head];
        for (uint32_t next = 0; next < count; next++) {
            size_t entry = backward ? next * count + here : here * count + next;
            if (topology->transition[entry] > 0 && level[next] == UNREACHED) {
                level[next] = level[here] + 1u;
                queue[tail++] = next;
            }
        }
    }
}

static uint32_t greatest_common_divisor(uint32_t a, uint32_t b)
{
    while (b != 0) {
        uint32_t rest = a % b;
        a = b;
        b = rest;
    }
    return a;
}

/* Irreducibility and period, by the levels of a search in breadth. `work` holds 2 graph_count. */
static bool examine_chain(struct topology *topology, uint32_t *work, struct topology_place *place,
                          struct problem *problem)
{
    size_t count = topology->graph_count;
    uint32_t *level = work;
    for (int backward = 1; backward >= 0; backward--) {
        reach(topology, backward != 0, level, work + count);
        for (uint32_t graph = 0; graph < count; graph++) {
            if (level[graph] == UNREACHED) {
                *place = (struct topology_place){TOPOLOGY_TRANSITION, backward ? graph : 0, 0};
                return problem_set(problem,
                                   "the chain is reducible: from graph %u it never comes to graph "
                                   "%u; it must come from each to each",
                                   (backward ? graph : 0) + 1u, (backward ? 0 : graph) + 1u);
            }
        }
    }
    /* Every transition i -> j closes walks whose lengths differ by level(i) + 1 - level(j). */
    topology->period = 0;
    for (size_t i = 0; i < count; i++) {
        for (size_t j = 0; j < count; j++) {
            if (topology->transition[i * count + j] > 0) {
                int64_t slack = (int64_t)level[i] + 1 - (int64_t)level[j];
                topology->period = greatest_common_divisor(topology->period,
                                                           (uint32_t)(slack < 0 ? -slack : slack));
            }
        }
    }
    return true;
}

/*
 * Stationary law of the irreducible chain by eliminating one graph after the other (Grassmann,
 * Taksar, Heyman 1985): no subtraction, so every entry has full relative precision.
 */
static void solve_stationary(struct topology *topology, double *rest)
{
    size_t count = topology->graph_count;
    double *law = topology->stationary;
    memcpy(rest, topology->transition, count * count * sizeof *rest);
    for (size_t last = count - 1; last > 0; last--) {
        double leaving = 0;
        for (size_t j = 0; j < last; j++) {
            leaving += rest[last * count + j];
        }
        for (size_t i = 0; i < last; i++) {
            rest[i * count + last] /= leaving;
            for (size_t j = 0; j < last; j++) {
                rest[i * count + j] += rest[i * count + last] * rest[last * count + j];
            }
        }
    }
    double sum = law[0] = 1;
    for (size_t j = 1; j < count; j++) {
        law[j] = 0;
        for (size_t i = 0; i < j; i++) {
            law[j] += law[i] * rest[i * count + j];
        }
        sum += law[j];
    }
    for (size_t j = 0; j < count; j++) {
        law[j] /= sum;
    }
}

static void *array(size_t count, size_t size)
{
    return calloc(count > 0 ? count : 1, size); /* of no elements: not null either */
}

bool topology_build(struct topology *topology, uint32_t agent_count, uint32_t graph_count,
                    const struct edge *const *edges, const uint32_t *edge_counts,
                    const double *transition, struct topology_place *place, struct problem *problem)
{
    struct topology_place unread;
    place = place != NULL ? place : &unread;
    *place = (struct topology_place){TOPOLOGY_MEMORY, 0, 0};
    *topology = (struct topology){.agent_count = agent_count, .graph_count = graph_count};

    size_t arc_count = 0;
    for (uint32_t graph = 0; graph < graph_count; graph++) {
        arc_count += 2 * (size_t)edge_counts[graph];
    }
    size_t graphs = graph_count;
    struct arc *arcs = array(arc_count, sizeof *arcs);
    uint32_t *work = array((size_t)agent_count + 2 * graphs, sizeof *work);
    double *rest = array(graphs * graphs, sizeof *rest);
    topology->transition = array(graphs * graphs, sizeof *topology->transition);
    topology->stationary = array(graphs, sizeof *topology->stationary);
    topology->first_link = array((size_t)agent_count + 1, sizeof *topology->first_link);
    problem_set(problem, "too large for this machine's memory");
    bool built = arcs != NULL && work != NULL && rest != NULL && topology->transition != NULL &&
                 topology->stationary != NULL && topology->first_link != NULL &&
                 arc_count <= UINT32_MAX &&
                 collect_arcs(arcs, agent_count, graph_count, edges, edge_counts, place, problem);
    if (built) {
        size_t links = 0;
        for (size_t k = 0; k < arc_count; k++) {
            links += k == 0 || arcs[k - 1].sender != arcs[k].sender ||
                     arcs[k - 1].receiver != arcs[k].receiver;
        }
        topology->link_count = (uint32_t)links;
        topology->link_sender = array(links, sizeof *topology->link_sender);
        topology->link_receiver = array(links, sizeof *topology->link_receiver);
        topology->linked = array(graphs * links, sizeof *topology->linked);
        built = topology->link_sender != NULL && topology->link_receiver != NULL &&
                topology->linked != NULL;
    }
    if (built) {
        fill_links(topology, arcs, arc_count);
        topology->components = count_components(topology, work);
        topology->transition[0] = 1;
        if (transition != NULL) {
            memcpy(topology->transition, transition, graphs * graphs * sizeof *transition);
        }
        built = examine_chain(topology, work, place, problem);
    }
    if (built) {
        solve_stationary(topology, rest);
        problem->text[0] = '\0';
    } else {
        topology_free(topology);
    }
    free(arcs);
    free(work);
    free(rest);
    return built;
}

void topology_free(struct topology *topology)
{
    free(topology->transition);
    free(topology->stationary);
    free(topology->link_sender);
    free(topology->link_receiver);
    free(topology->first_link);
    free(topology->linked);
    *topology = (struct topology){0};
}

uint32_t topology_degree(const struct topology *topology, uint32_t graph, uint32_t agent)
{
    const uint8_t *linked = topology->linked + (size_t)graph * topology->link_count;
    uint32_t degree = 0;
    for (uint32_t link = topology->first_link[agent - 1u]; link < topology->first_link[agent];
         link++) {
        degree += linked[link];
    }
    return degree;
}

uint32_t topology_draw(const struct topology *topology, const double *law, uint32_t word)
{
    double cumulative = 0;
    uint32_t last = topology->graph_count - 1u;
    for (uint32_t graph = 0; graph < last; graph++) {
        cumulative += law[graph];
        if (cumulative * 0x1p31 > (double)(word >> 1)) {
            return graph;
        }
    }
    return last;
}
