/*
 * The measuring images: what the library's operations cost on this processor, in q31 (figures) and
 * in the floating arithmetics, with the estimator update that people write today beside them
 * (figures-floating; one image would not fit an AVR). tools/firmware_figures.py runs them and
 * makes a table of their lines (figures.h says which).
 *
 * First the counter is held against a loop of known length. Then each operation is counted over
 * realistic inputs, and the dearest input is searched for (figures_agent.c says how).
 */
#include "figures.h"
#include "platform.h"
#include "print.h"

static uint32_t state = 2463534242u;

/* Marsaglia's xorshift, 32 bits. */
uint32_t figure_random(void)
{
    state ^= state << 13;
    state ^= state >> 17;
    state ^= state << 5;
    return state;
}

void figure_take(struct figure *figure, uint32_t cost)
{
    ++figure->calls;
    figure->total += cost;
    figure->worst = cost > figure->worst ? cost : figure->worst;
}

void figure_print(const char *name, const char *operation, const struct figure *figure)
{
    uint32_t tenths = (figure->total * 10 + figure->calls / 2) / figure->calls;
    print_text(name);
    print_text(" ");
    print_text(operation);
    print_text(" mean ");
    print_decimal(tenths / 10);
    print_text(".");
    print_decimal(tenths % 10);
    print_text(" worst ");
    print_decimal(figure->worst);
    print_text("\n");
}

static volatile uint32_t rounds; /* volatile, so that one loop serves all its lengths */

static uint32_t count_empty_rounds(void)
{
    platform_count_from_here();
    for (uint32_t k = rounds; k > 0; --k) {
        __asm__ volatile("");
    }
    return platform_count();
}

/* With 8 instructions more in a round, which take a cycle each on AVR. */
static uint32_t count_rounds_of_8(void)
{
    platform_count_from_here();
    for (uint32_t k = rounds; k > 0; --k) {
        __asm__ volatile("nop\n\tnop\n\tnop\n\tnop\n\tnop\n\tnop\n\tnop\n\tnop");
    }
    return platform_count();
}

/* Whether the counter finds 8 a round, few rounds or many. */
static bool calibrated(void)
{
    static const uint32_t lengths[] = {1, 10, 100, 1000, 10000};
    for (unsigned k = 0; k < sizeof lengths / sizeof *lengths; ++k) {
        rounds = lengths[k];
        if (count_rounds_of_8() - count_empty_rounds() != 8 * rounds) {
            return false;
        }
    }
    return true;
}

int main(void)
{
    if (!calibrated()) {
        print_text("figures: the counter does not count a loop of known length\n");
        platform_exit(1);
    }
#ifdef FIGURES_FLOATING
    bool done = onebit_f32_figures();
    today_float_figures();
#ifdef FIGURES_DOUBLE
    done = done && onebit_f64_figures();
    today_double_figures();
#endif
#else
    bool done = onebit_q31_figures();
#endif
    platform_exit(done ? 0 : 1);
}
