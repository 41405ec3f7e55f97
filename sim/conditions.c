/*
 * The figures of the paper's Theorems 1-4 and the warnings that follow from them. Reads the
 * scenario, writes what it is given; LAPACK finds the eigenvalues.
 *
 * The norms of the paper need no matrix with a row a link: with D_i the degrees in graph i and D
 * those of the union, ||J W_i||^2 is the largest eigenvalue of J D_i J, ||Q W_i||^2 that of
 * D^(1/2) D_i D^(1/2), which is diagonal, and ||Q L_i T||^2 that of L_i D L_i.
 */
#include "conditions.h"

#include "onebit_limits.h"

#include <lapacke.h>
#include <math.h>
#include <stdlib.h>

#define GAIN_ROUNDING 1e-6 /* relative, of K2 (A + B K1) = K2 and K2 B = 1 */

static uint32_t union_degree(const struct topology *topology, uint32_t agent)
{
    return topology->first_link[agent] - topology->first_link[agent - 1u];
}

/* Adds `weight` times the Laplacian of one graph. */
static void add_laplacian(const struct topology *topology, uint32_t graph, double weight,
                          double *matrix)
{
    size_t count = topology->agent_count;
    for (size_t link = 0; link < topology->link_count; link++) {
        if (topology->linked[graph * (size_t)topology->link_count + link]) {
            size_t sender = topology->link_sender[link] - 1u;
            size_t receiver = topology->link_receiver[link] - 1u;
            matrix[sender * count + sender] += weight;
            matrix[sender * count + receiver] -= weight;
        }
    }
}

/* J D_i J */
static void add_centred_degrees(const struct topology *topology, uint32_t graph, double *matrix)
{
    size_t count = topology->agent_count;
    double sum = 0;
    for (uint32_t agent = 1; agent <= count; agent++) {
        sum += topology_degree(topology, graph, agent);
    }
    for (uint32_t row = 1; row <= count; row++) {
        double degree = topology_degree(topology, graph, row);
        for (size_t k = 0; k < count; k++) {
            matrix[(row - 1u) * count + k] += (sum / (double)count - degree) / (double)count;
            matrix[k * count + (row - 1u)] -= degree / (double)count;
        }
        matrix[(row - 1u) * count + (row - 1u)] += degree;
    }
}

/* L_i D L_i as the sum over agents of D's entry times column times row of L_i. */
static void add_weighted_square(const struct topology *topology, uint32_t graph, double *matrix)
{
    size_t count = topology->agent_count;
    const uint8_t *linked = topology->linked + (size_t)graph * topology->link_count;
    for (uint32_t agent = 1; agent <= count; agent++) {
        double weight = union_degree(topology, agent);
        double degree = topology_degree(topology, graph, agent);
        uint32_t first = topology->first_link[agent - 1u];
        uint32_t end = topology->first_link[agent];
        /* The column's entries: the agent's own, then one for each neighbour. */
        for (uint32_t a = first; a <= end; a++) {
            for (uint32_t b = first; b <= end; b++) {
                if ((a < end && !linked[a]) || (b < end && !linked[b])) {
                    continue;
                }
                size_t row = (a < end ? topology->link_receiver[a] : agent) - 1u;
                size_t column = (b < end ? topology->link_receiver[b] : agent) - 1u;
                matrix[row * count + column] +=
                    weight * (a < end ? -1 : degree) * (b < end ? -1 : degree);
            }
        }
    }
}

struct spectrum {
    lapack_int size;
    double *matrix; /* symmetric; all zero between uses */
    double *values; /* ascending */
};

static bool find_eigenvalues(struct spectrum *spectrum)
{
    size_t size = (size_t)spectrum->size;
    bool found = LAPACKE_dsyev(LAPACK_COL_MAJOR, 'N', 'U', spectrum->size, spectrum->matrix,
                               spectrum->size, spectrum->values) == 0;
    for (size_t k = 0; k < size * size; k++) {
        spectrum->matrix[k] = 0;
    }
    return found;
}

static bool find_norms(const struct topology *topology, struct spectrum *spectrum,
                       struct conditions *conditions)
{
    uint32_t count = topology->agent_count;
    for (uint32_t graph = 0; graph < topology->graph_count; graph++) {
        add_laplacian(topology, graph, topology->stationary[graph], spectrum->matrix);
    }
    if (!find_eigenvalues(spectrum)) {
        return false;
    }
    conditions->lambda_2 = topology->components == 1 ? spectrum->values[1] : 0;
    for (uint32_t graph = 0; graph < topology->graph_count; graph++) {
        add_centred_degrees(topology, graph, spectrum->matrix);
        if (!find_eigenvalues(spectrum)) {
            return false;
        }
        conditions->lambda_G = fmax(conditions->lambda_G, spectrum->values[count - 1u]);
        add_weighted_square(topology, graph, spectrum->matrix);
        if (!find_eigenvalues(spectrum)) {
            return false;
        }
        conditions->lambda_QL = fmax(conditions->lambda_QL, spectrum->values[count - 1u]);
    }
    return true;
}

/* The figures that need no eigenvalues; whatever the size of the group. */
static void find_simple(const struct scenario *scenario, struct conditions *conditions)
{
    const struct topology *topology = &scenario->topology;
    double reach = (fabs(scenario->threshold) + scenario->bound) / scenario->sigma;
    *conditions = (struct conditions){.pi_min = 1};
    conditions->f_M =
        exp(-reach * reach / 2) / (scenario->sigma * sqrt(8 * atan(1))); /* 8 atan 1 = 2 pi */
    for (uint32_t graph = 0; graph < topology->graph_count; graph++) {
        conditions->pi_min = fmin(conditions->pi_min, topology->stationary[graph]);
        for (uint32_t agent = 1; agent <= topology->agent_count; agent++) {
            uint32_t degree = topology_degree(topology, graph, agent);
            double product = (double)degree * union_degree(topology, agent);
            conditions->d_max = degree > conditions->d_max ? degree : conditions->d_max;
            conditions->lambda_QW = fmax(conditions->lambda_QW, product);
        }
    }
    conditions->t0_min = scenario->gamma * conditions->d_max - 1;
}

bool conditions_compute(const struct scenario *scenario, struct conditions *conditions)
{
    const struct topology *topology = &scenario->topology;
    size_t count = topology->agent_count;
    find_simple(scenario, conditions);
    if (count > CONDITIONS_AGENTS_MAX) {
        return false;
    }
    struct spectrum spectrum = {.size = (lapack_int)count,
                                .matrix = calloc(count * count, sizeof(double)),
                                .values = calloc(count, sizeof(double))};
    bool found = spectrum.matrix != NULL && spectrum.values != NULL &&
                 find_norms(topology, &spectrum, conditions);
    free(spectrum.matrix);
    free(spectrum.values);

    double lambda_2 = conditions->lambda_2;
    double lambda_G = conditions->lambda_G;
    double gamma = scenario->gamma;
    double scale = 1 / (2 * conditions->f_M * conditions->pi_min);
    conditions->alpha =
        2 * sqrt(conditions->lambda_QW) + conditions->lambda_QL * lambda_2 / lambda_G;
    conditions->beta_consensus = conditions->beta_rate = HUGE_VAL;
    if (lambda_2 > 0) {
        conditions->beta_consensus =
            scale * gamma * (lambda_G * lambda_G / pow(lambda_2, 3) + conditions->alpha);
    }
    if (gamma * lambda_2 > 1) {
        double ratio = gamma * lambda_G / lambda_2;
        conditions->beta_rate =
            scale * (ratio * ratio / (gamma * lambda_2 - 1) + gamma * conditions->alpha + 1);
    }
    return found;
}

/* A + B K1, row-major. */
static void close_loop(const struct scenario *scenario, double *closed)
{
    size_t n = scenario->state_count;
    for (size_t row = 0; row < n; row++) {
        for (size_t k = 0; k < n; k++) {
            closed[row * n + k] =
                scenario->A[row * n + k] + scenario->B[row] * scenario->stabilizing[k];
        }
    }
}

/* Largest |K2 (A + B K1) - K2| over largest |K2|. */
static double row_error(const struct scenario *scenario, const double *closed)
{
    size_t n = scenario->state_count;
    double error = 0;
    double size = 0;
    for (size_t k = 0; k < n; k++) {
        double moved = -scenario->compression[k];
        for (size_t row = 0; row < n; row++) {
            moved += scenario->compression[row] * closed[row * n + k];
        }
        error = fmax(error, fabs(moved));
        size = fmax(size, fabs(scenario->compression[k]));
    }
    return error / size;
}

/* How far the eigenvalue nearest to 1 is from it, and the largest magnitude of the others. */
static bool find_roots(const double *closed, size_t n, double *error, double *others)
{
    double copy[ONEBIT_STATES_MAX * ONEBIT_STATES_MAX];
    double real[ONEBIT_STATES_MAX];
    double imaginary[ONEBIT_STATES_MAX];
    lapack_int size = (lapack_int)n;
    for (size_t k = 0; k < n * n; k++) {
        copy[k] = closed[k];
        if (!isfinite(copy[k])) {
            return false; /* LAPACK would end the program */
        }
    }
    if (LAPACKE_dgeev(LAPACK_ROW_MAJOR, 'N', 'N', size, copy, size, real, imaginary, NULL, size,
                      NULL, size) != 0) {
        return false;
    }
    size_t nearest = 0;
    *error = HUGE_VAL;
    for (size_t k = 0; k < n; k++) {
        if (hypot(real[k] - 1, imaginary[k]) < *error) {
            *error = hypot(real[k] - 1, imaginary[k]);
            nearest = k;
        }
    }
    *others = 0;
    for (size_t k = 0; k < n; k++) {
        *others = k == nearest ? *others : fmax(*others, hypot(real[k], imaginary[k]));
    }
    return true;
}

/* `lambda_2` 0: not known. */
static void warn_gains(const struct scenario *scenario, double lambda_2, FILE *stream)
{
    double closed[ONEBIT_STATES_MAX * ONEBIT_STATES_MAX];
    close_loop(scenario, closed);
    double error = row_error(scenario, closed);
    if (!(error <= GAIN_ROUNDING)) {
        fprintf(stream,
                "warning: gains: K2 (A + B K1) differs from K2 by %.2g of its size, may by %g: "
                "compute both rows from A and B as the file has them, to all digits\n",
                error, GAIN_ROUNDING);
    }
    double unit = 0;
    for (size_t k = 0; k < scenario->state_count; k++) {
        unit += scenario->compression[k] * scenario->B[k];
    }
    if (!(fabs(unit - 1) <= GAIN_ROUNDING)) {
        fprintf(stream,
                "warning: gains.compression: K2 B is %.9g, not 1: compute the row from A and B as "
                "the file has them, to all digits\n",
                unit);
    }
    double others;
    if (!find_roots(closed, scenario->state_count, &error, &others)) {
        fprintf(stream, "warning: gains.stabilizing: the eigenvalues of A + B K1 cannot be "
                        "computed: use numbers of moderate size\n");
        return;
    }
    if (others >= 1) {
        fprintf(stream,
                "warning: gains.stabilizing: A + B K1 has, beside 1, an eigenvalue of magnitude "
                "%.6g: choose roots below 1\n",
                others);
    }
    double horizon = scenario->gamma * lambda_2 / error;
    double end = (double)scenario->t0 + scenario->steps;
    if (lambda_2 > 0 && horizon < end) {
        fprintf(stream,
                "warning: gains.stabilizing: the eigenvalue 1 of A + B K1 is off by %.2g, so from "
                "about t = %.3g on the gain no longer holds the group, and the run goes to %.0f: "
                "compute the gains to all digits, or run fewer steps\n",
                error, horizon, end);
    }
}

static void warn_beta_gamma(const struct scenario *scenario, const struct conditions *conditions,
                            FILE *stream)
{
    if (!(scenario->gamma * conditions->lambda_2 > 1)) {
        fprintf(stream,
                "warning: gains.gamma: %.6g is %.3g of 1/lambda_2 = %.6g, the rate 1/t needs more: "
                "raise it above that\n",
                scenario->gamma, scenario->gamma * conditions->lambda_2, 1 / conditions->lambda_2);
    }
    if (!(scenario->beta > conditions->beta_consensus)) {
        fprintf(stream,
                "warning: gains.beta: %.6g is %.3g of %.6g, consensus needs more: raise it above",
                scenario->beta, scenario->beta / conditions->beta_consensus,
                conditions->beta_consensus);
        if (isfinite(conditions->beta_rate)) {
            fprintf(stream, " %.6g, where the rate 1/t begins\n", conditions->beta_rate);
        } else {
            fprintf(stream, " that\n");
        }
    } else if (scenario->gamma * conditions->lambda_2 > 1 &&
               !(scenario->beta > conditions->beta_rate)) {
        fprintf(stream,
                "warning: gains.beta: %.6g is %.3g of %.6g, the rate 1/t needs more: raise it "
                "above that\n",
                scenario->beta, scenario->beta / conditions->beta_rate, conditions->beta_rate);
    }
}

void conditions_warn(const struct scenario *scenario, FILE *stream)
{
    const struct topology *topology = &scenario->topology;
    struct conditions conditions;
    bool computed = conditions_compute(scenario, &conditions);
    if (!computed) {
        fprintf(
            stream,
            "warning: gains: the bounds on beta and gamma were not computed for %u agents: %s\n",
            topology->agent_count,
            topology->agent_count > CONDITIONS_AGENTS_MAX ? "too many" : "memory is short");
    }
    if (topology->components > 1) {
        fprintf(stream,
                "warning: topology.graphs: the union falls into %u parts, which never agree: "
                "join them by %u more edges\n",
                topology->components, topology->components - 1u);
    } else if (computed) {
        warn_beta_gamma(scenario, &conditions, stream);
    }
    if (topology->period > 1) {
        fprintf(stream,
                "warning: topology.transition: the chain has period %u, the theorems need 1: let a "
                "graph stay with some probability\n",
                topology->period);
    }
    if (!(scenario->t0 > conditions.t0_min)) {
        fprintf(stream,
                "warning: gains.t0: %u is not above gamma d_max - 1 = %.6g, so |K2 x| may leave "
                "the bound: raise it to %.0f\n",
                scenario->t0, conditions.t0_min, floor(conditions.t0_min) + 1);
    }
    warn_gains(scenario, conditions.lambda_2, stream);
}
