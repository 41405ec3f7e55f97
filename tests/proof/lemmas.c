/*
 * What Frama-C's WP proves (tests/proof/prove.py), and why it is needed: Eva knows a range of each
 * variable, and these are relations between several.
 *
 * - onebit_row_valid, by which onebit_check refuses every other row, says just that the row's
 *   magnitudes add to at most 2^31 - 1. Then the 64-bit sum of row[k] x[k] in onebit_dot stays
 *   within 2^62 for any n and any x, where products are added whole. Where they are added by halves
 *   (onebit_products_by_halves) nothing is proved.
 * - A product by halves is exact, and onebit_half gives the half that it names.
 * - The projection leaves the estimate within the bound.
 *
 * The steps of the proofs, such as what holds at each turn of a loop, prove.py writes into a copy
 * of lib/.
 *
 * Assumed: the axioms below, which are C's rules of conversion (C99 6.3.1.3) and, for a negative
 * number made narrower or shifted right, those of every compiler for two's complement; and what
 * shifts and `|` of words without common bits make. WP knows of a conversion only that it keeps
 * what fits, and of a shift of a negative number nothing.
 */
#include <stdint.h>

/*@ axiomatic conversions {
        axiom half: \forall integer x; 0 <= x < 0x100000000 ==> (uint16_t)x == x % 0x10000;
        axiom signed_half: \forall integer x;
            0x8000 <= x < 0x10000 ==> (int16_t)x == x - 0x10000;
        axiom word: \forall integer x; -0x80000000 <= x < 0 ==> (uint32_t)x == x + 0x100000000;
        axiom sum: \forall integer x;
            0x100000000 <= x < 0x200000000 ==> (uint32_t)x == x - 0x100000000;
        axiom shifted: \forall integer x; 0 <= x - 0x10000 * (x >> 16) < 0x10000;
    }
*/

// A 64-bit product's upper word, its lower word, and the number of two words.
/*@ axiomatic words {
        predicate upper_word(integer a, integer b, integer upper) reads \nothing;
        axiom upper: \forall integer a, b, upper;
            0 <= a * b - 0x100000000 * upper < 0x100000000 ==> upper_word(a, b, upper);
        axiom lower: \forall integer a, b, upper; upper_word(a, b, upper) ==>
            (uint32_t)((uint32_t)a * (uint32_t)b) == a * b - 0x100000000 * upper;
        axiom both: \forall integer upper, lower;
            -0x80000000 <= upper < 0x80000000 && 0 <= lower < 0x100000000 ==>
            (int64_t)((uint64_t)((uint64_t)upper << 32) | lower) == 0x100000000 * upper + lower;
    }
*/

/*@ logic integer magnitude(integer value) = value < 0 ? -value : value;

    logic integer magnitudes(int32_t *row, integer n) =
        n <= 0 ? 0 : magnitudes(row, n - 1) + magnitude(row[n - 1]);

    // The n magnitudes add to at most 2^31 - 1. As none is negative, that is to say that those of
    // each beginning of the row do; and said so it needs no induction.
    predicate valid_row(int32_t *row, integer n) =
        \forall integer k; 0 <= k <= n ==> magnitudes(row, k) <= INT32_MAX;
*/

#include "contracts.h"

/*@ requires \valid_read(row + (0 .. count - 1));
    assigns \nothing;
    ensures \result <==> valid_row(row, count);
*/
static inline bool onebit_row_valid(const onebit_real *row, unsigned count);

/*@ requires \valid_read(row + (0 .. count - 1)) && \valid_read(x + (0 .. count - 1));
    requires valid_row(row, count);
*/
static onebit_real onebit_dot(const onebit_real *row, const onebit_real *x, unsigned count,
                              int shift);

//@ requires valid_row(left, count);
static inline int64_t onebit_products(const int32_t *left, const int32_t *right, unsigned count);

// A product with the row's entry is at most 2^31 times its magnitude.
//@ ensures -0x80000000 * magnitude(left) <= \result <= 0x80000000 * magnitude(left);
static inline int64_t onebit_product(int32_t left, int32_t right);

/*@ requires half == ONEBIT_LOWER || half == ONEBIT_UPPER;
    assigns \nothing;
    ensures \result == (half == ONEBIT_LOWER ? word % 0x10000 : word / 0x10000);
*/
static inline uint16_t onebit_half(uint32_t word, unsigned half);

//@ assigns \nothing; ensures 0 <= value * factor - 0x10000 * \result < 0x10000;
static inline int32_t onebit_scaled_signed_by_halves(int32_t value, uint16_t factor);

/*@ requires -0x60000000 <= value <= 0x60000000 && 0 < limit <= 0x20000000;
    assigns \nothing;
    ensures \result <==> magnitude(value) > limit;
*/
static inline bool onebit_beyond(onebit_real value, onebit_real limit);
