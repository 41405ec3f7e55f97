/* The plants of plant.h. */
#include "plant.h"

#include <math.h>

/* Nearest integer with `bits` fraction bits, saturated. */
static int32_t fixed(double value, int bits)
{
    double scaled = round(ldexp(value, bits));
    if (scaled >= 2147483647.0) {
        return INT32_MAX;
    }
    return scaled <= -2147483648.0 ? INT32_MIN : (int32_t)scaled;
}

/* Most fraction bits, up to 30, with which the magnitudes of every row add to less than 2^31. */
static int row_fraction_bits(const double *rows, uint32_t row_count, uint32_t column_count)
{
    double largest = 0;
    for (uint32_t i = 0; i < row_count; ++i) {
        double sum = 0;
        for (uint32_t k = 0; k < column_count; ++k) {
            sum += fabs(rows[i * column_count + k]);
        }
        largest = fmax(largest, sum);
    }
    int bits = 30;
    /* Rounding adds at most a half for each entry. */
    while (bits > 0 && ldexp(largest, bits) + column_count > 2147483647.0) {
        --bits;
    }
    return bits;
}

void plant_build(struct plant *plant, const struct scenario *scenario,
                 const struct formats *formats)
{
    uint32_t n = scenario->state_count;
    *plant = (struct plant){
        .state_count = n, .A = scenario->A, .B = scenario->B, .integer = scenario->integer_plant};
    if (!plant->integer) {
        return;
    }
    struct integer_plant *integer = &plant->fixed;
    integer->state_count = n;
    integer->A_fraction_bits = row_fraction_bits(scenario->A, n, n);
    integer->B_fraction_bits = row_fraction_bits(scenario->B, n, 1);
    integer->state_fraction_bits = formats->state;
    integer->control_fraction_bits = formats->control;
    integer->A = plant->fixed_A;
    integer->B = plant->fixed_B;
    for (uint32_t i = 0; i < n; ++i) {
        for (uint32_t k = 0; k < n; ++k) {
            plant->fixed_A[i * n + k] = fixed(scenario->A[i * n + k], integer->A_fraction_bits);
        }
        plant->fixed_B[i] = fixed(scenario->B[i], integer->B_fraction_bits);
    }
}

void plant_begin(const struct plant *plant, double *x)
{
    if (plant->integer) {
        int bits = plant->fixed.state_fraction_bits;
        for (uint32_t k = 0; k < plant->state_count; ++k) {
            x[k] = ldexp((double)fixed(x[k], bits), -bits);
        }
    }
}

void plant_step(const struct plant *plant, double *x, double u)
{
    uint32_t n = plant->state_count;
    if (plant->integer) {
        /* Exact both ways: a 32-bit integer over a power of two is a double. */
        int32_t state[ONEBIT_STATES_MAX];
        for (uint32_t k = 0; k < n; ++k) {
            state[k] = fixed(x[k], plant->fixed.state_fraction_bits);
        }
        integer_plant_step(&plant->fixed, state, fixed(u, plant->fixed.control_fraction_bits));
        for (uint32_t k = 0; k < n; ++k) {
            x[k] = ldexp((double)state[k], -plant->fixed.state_fraction_bits);
        }
        return;
    }
    double next[ONEBIT_STATES_MAX];
    const double *row = plant->A;
    for (uint32_t i = 0; i < n; ++i) {
        double sum = 0;
        for (uint32_t k = 0; k < n; ++k) {
            sum += *row++ * x[k];
        }
        next[i] = sum + plant->B[i] * u;
    }
    for (uint32_t i = 0; i < n; ++i) {
        x[i] = next[i];
    }
}
