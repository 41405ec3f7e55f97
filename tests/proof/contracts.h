/*
 * The contracts by which WP (lemmas.c) and Eva (verbs.c) meet: WP proves what they ensure, and Eva
 * builds on it. Frama-C adds them to the functions of lib/.
 */
#include "onebit_estimator.h"

// A product is that product, by halves too.
//@ assigns \nothing; ensures \result == left * right;
static inline int64_t onebit_product(int32_t left, int32_t right);

//@ assigns \nothing; ensures \result == left * right;
static inline int64_t onebit_product_by_halves(int32_t left, int32_t right);

// The sum of a valid row's products stays within 2^62.
/*@ requires \valid_read(left + (0 .. count - 1)) && \valid_read(right + (0 .. count - 1));
    assigns \result \from left[0 .. count - 1], right[0 .. count - 1];
    ensures -0x80000000 * INT32_MAX <= \result <= 0x80000000 * INT32_MAX;
*/
static inline int64_t onebit_products(const int32_t *left, const int32_t *right, unsigned count);

// The projection is one, though it compares unsigned numbers that wrap.
/*@ requires \valid(estimate) && 0 < bound <= 0x20000000;
    requires -0x60000000 <= estimate->value <= 0x60000000;
    assigns *estimate;
    ensures -bound <= estimate->value <= bound;
*/
static inline void onebit_project(onebit_estimate *estimate, onebit_real bound);
