/*
 * Worst-case ranges of the closed loop and the fixed-point formats that hold them. Pure but for
 * short-lived heap memory.
 *
 * With K2 (A + B K1) = K2, K2 B = 1 and v = gamma/(t+1) sum (zhat - K2 x) the loop is
 * x' = (A + B K1) x + B v. Let v1 be the eigenvector of A + B K1 for the eigenvalue 1, K2 v1 = 1.
 * Then x = v1 (K2 x) + s, where s' = (A + B K1) s + (I - v1 K2) B v decays but for v. As |K2 x|
 * stays within M and |v| within gamma d_max 2 M / (t0 + 2), if t0 is as the theorems ask, component
 * k of x stays within
 *
 *   |v1_k| M + max over m, agents of |(S^m s(0))_k| + max|v| sum over m of |(S^m (I - v1 K2) B)_k|
 *
 * with S = A + B K1 - v1 K2, which on such s is A + B K1 without the eigenvalue 1.
 */
#include "formats.h"

#include "onebit_limits.h"

#include <math.h>
#include <string.h>

#define STATES ONEBIT_STATES_MAX
#define FRACTION_BITS_MAX 31
#define ROW_FRACTION_BITS_MAX 46 /* the library's range of a row's fraction bits */

/* The sums end where a power of S has shrunk so far; a loop that takes longer is refused. */
#define NEGLIGIBLE 1e-9
#define POWERS_MAX 100000u

struct loop {
    size_t n;
    double agreed[STATES];           /* v1 */
    double decaying[STATES][STATES]; /* S */
    double unagreed[STATES][STATES]; /* I - v1 K2 */
};

/*
 * Solves matrix solution = right in place, the solution left in `right`; false if it is singular.
 * Elimination with the largest pivot of each column: at most STATES rows are not worth LAPACK,
 * whose libraries would be most of a bus node's memory.
 */
static bool solve(size_t n, double (*matrix)[STATES], double *right)
{
    for (size_t column = 0; column < n; column++) {
        size_t pivot = column;
        for (size_t row = column + 1; row < n; row++) {
            pivot = fabs(matrix[row][column]) > fabs(matrix[pivot][column]) ? row : pivot;
        }
        if (!(fabs(matrix[pivot][column]) > 0)) {
            return false;
        }
        for (size_t k = 0; k < n; k++) {
            double element = matrix[column][k];
            matrix[column][k] = matrix[pivot][k];
            matrix[pivot][k] = element;
        }
        double element = right[column];
        right[column] = right[pivot];
        right[pivot] = element;
        for (size_t row = column + 1; row < n; row++) {
            double factor = matrix[row][column] / matrix[column][column];
            for (size_t k = column; k < n; k++) {
                matrix[row][k] -= factor * matrix[column][k];
            }
            right[row] -= factor * right[column];
        }
    }
    for (size_t row = n; row-- > 0;) {
        for (size_t k = row + 1; k < n; k++) {
            right[row] -= matrix[row][k] * right[k];
        }
        right[row] /= matrix[row][row];
    }
    return true;
}

/* v1 from (I - (A + B K1) + B K2) v1 = B, which holds for no other vector. */
static bool find_agreed(const struct scenario *scenario, struct loop *loop)
{
    double matrix[STATES][STATES];
    size_t n = loop->n;
    for (size_t row = 0; row < n; row++) {
        loop->agreed[row] = scenario->B[row];
        for (size_t k = 0; k < n; k++) {
            matrix[row][k] =
                (row == k ? 1 : 0) - scenario->A[row * n + k] -
                scenario->B[row] * (scenario->stabilizing[k] - scenario->compression[k]);
        }
    }
    return solve(n, matrix, loop->agreed);
}

static void split_loop(const struct scenario *scenario, struct loop *loop)
{
    size_t n = loop->n;
    for (size_t row = 0; row < n; row++) {
        for (size_t k = 0; k < n; k++) {
            double agreed = loop->agreed[row] * scenario->compression[k];
            loop->unagreed[row][k] = (row == k ? 1 : 0) - agreed;
            loop->decaying[row][k] =
                scenario->A[row * n + k] + scenario->B[row] * scenario->stabilizing[k] - agreed;
        }
    }
}

/* vector = matrix vector; returns the sum of the result's magnitudes. */
static double apply(size_t n, const double (*matrix)[STATES], double *vector)
{
    double product[STATES];
    double sum = 0;
    for (size_t row = 0; row < n; row++) {
        product[row] = 0;
        for (size_t k = 0; k < n; k++) {
            product[row] += matrix[row][k] * vector[k];
        }
        sum += fabs(product[row]);
    }
    memcpy(vector, product, n * sizeof *vector);
    return sum;
}

/* After how many powers all S^m (I - v1 K2) are negligible; 0 if that takes too many. */
static uint32_t count_powers(const struct loop *loop)
{
    double columns[STATES][STATES];
    double largest = 0;
    for (size_t k = 0; k < loop->n; k++) {
        for (size_t row = 0; row < loop->n; row++) {
            columns[k][row] = loop->unagreed[row][k];
        }
    }
    for (uint32_t power = 1; power <= POWERS_MAX; power++) {
        double size = 0;
        for (size_t k = 0; k < loop->n; k++) {
            size += apply(loop->n, loop->decaying, columns[k]);
        }
        if (!isfinite(size)) {
            return 0;
        }
        largest = fmax(largest, size);
        if (size <= NEGLIGIBLE * fmax(largest, 1)) {
            return power;
        }
    }
    return 0;
}

/*
 * Ranges of |K2 x| and |v|. With a = gamma d / (t + 1) the step is K2 x' = (1 - a) K2 x + a mean of
 * zhat: while a <= 1 nothing leaves M, but a t0 below the theorems' may begin above.
 */
static void bound_consensus(const struct scenario *scenario, uint32_t d_max, double *compressed,
                            double *consensus)
{
    double bound = scenario->bound;
    double a = 2;
    *compressed = bound;
    *consensus = 0;
    for (double t = scenario->t0 + 1.0; a > 1 && isfinite(*compressed); t++) {
        a = scenario->gamma * d_max / (t + 1);
        *consensus = fmax(*consensus, a * (*compressed + bound));
        *compressed = fmax(*compressed, (a - 1) * *compressed + a * bound);
    }
}

/* Ranges of the states and of the control. */
static void find_ranges(const struct scenario *scenario, const struct loop *loop, uint32_t powers,
                        struct formats *formats)
{
    const struct topology *topology = &scenario->topology;
    size_t n = loop->n;
    uint32_t d_max = 0;
    for (uint32_t graph = 0; graph < topology->graph_count; graph++) {
        for (uint32_t agent = 1; agent <= topology->agent_count; agent++) {
            uint32_t degree = topology_degree(topology, graph, agent);
            d_max = degree > d_max ? degree : d_max;
        }
    }
    double compressed; /* of |K2 x| */
    double consensus;  /* of |v| */
    bound_consensus(scenario, d_max, &compressed, &consensus);

    double driven[STATES] = {0}; /* by v */
    double response[STATES];
    memcpy(response, scenario->B, n * sizeof *response);
    apply(n, loop->unagreed, response);
    for (uint32_t power = 0; power < powers; power++) {
        for (size_t k = 0; k < n; k++) {
            driven[k] += fabs(response[k]) * consensus;
        }
        apply(n, loop->decaying, response);
    }

    double free[STATES] = {0}; /* from the initial states */
    for (size_t agent = 0; agent < topology->agent_count; agent++) {
        memcpy(response, scenario->initial_states + agent * n, n * sizeof *response);
        apply(n, loop->unagreed, response);
        for (uint32_t power = 0; power < powers; power++) {
            for (size_t k = 0; k < n; k++) {
                free[k] = fmax(free[k], fabs(response[k]));
            }
            apply(n, loop->decaying, response);
        }
    }

    formats->state_range = 0;
    formats->control_range = consensus;
    for (size_t k = 0; k < n; k++) {
        double range = fabs(loop->agreed[k]) * compressed + free[k] + driven[k];
        formats->state_range = fmax(formats->state_range, range);
        formats->control_range += fabs(scenario->stabilizing[k]) * range;
    }
}

/* Most fraction bits that leave one bit to spare over the range, -1 if none does. */
static int fit_range(double range)
{
    int bits = FRACTION_BITS_MAX;
    while (bits >= 0 && !(ldexp(2 * range, bits) <= 0x1p31)) {
        bits--;
    }
    return bits;
}

/* Most fraction bits at which the row's integers, in magnitude, add to at most 2^31 - 1, or -1. */
static int fit_row(const double *row, size_t n, double scale)
{
    int bits = ROW_FRACTION_BITS_MAX;
    for (; bits >= 0; bits--) {
        double sum = 0;
        for (size_t k = 0; k < n; k++) {
            sum += fabs(round(ldexp(row[k] * scale, bits)));
        }
        if (sum <= INT32_MAX) {
            break;
        }
    }
    return bits;
}

bool formats_choose(const struct scenario *scenario, struct formats *formats,
                    struct problem *problem)
{
    struct loop loop = {.n = scenario->state_count};
    const char *path = scenario->path;
    uint32_t powers = 0;
    if (find_agreed(scenario, &loop)) {
        split_loop(scenario, &loop);
        powers = count_powers(&loop);
    }
    if (powers == 0 && !scenario->has_fixed) {
        return problem_set(problem,
                           "%s: gains.stabilizing: q31 needs a bounded range, but A + B K1 has, "
                           "beside 1, an eigenvalue that is not inside the unit circle, or hardly",
                           path);
    }
    formats->state_range = formats->control_range = HUGE_VAL;
    if (powers > 0) {
        find_ranges(scenario, &loop, powers, formats);
    }
    formats->state =
        scenario->has_fixed ? scenario->state_fraction_bits : fit_range(formats->state_range);
    formats->control =
        scenario->has_fixed ? scenario->control_fraction_bits : fit_range(formats->control_range);
    formats->stabilizing = fit_row(scenario->stabilizing, loop.n, 1);
    formats->compression = fit_row(scenario->compression, loop.n, 1 / scenario->sigma);
    if (formats->state < 0) {
        return problem_set(problem, "%s: plant: states may reach %.3g, q31 holds %.3g: scale them",
                           path, formats->state_range, 0x1p30);
    }
    if (formats->control < 0) {
        return problem_set(problem,
                           "%s: plant.B: controls may reach %.3g, q31 holds %.3g: scale them", path,
                           formats->control_range, 0x1p30);
    }
    if (formats->stabilizing < 0 || formats->compression < 0) {
        return problem_set(problem,
                           "%s: gains.%s: too large for q31, magnitudes%s must add to at most "
                           "2^31 - 1",
                           path, formats->stabilizing < 0 ? "stabilizing" : "compression",
                           formats->stabilizing < 0 ? "" : " over sigma");
    }
    return true;
}
