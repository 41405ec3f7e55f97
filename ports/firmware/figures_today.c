/*
 * The estimator update that people write today, counted as the library's is (figures_agent.c): with
 * the C library's erfc, in double or, compiled with FIGURES_FLOAT, in float. No carry; the gain is
 * worked out beforehand, as in the library. avr-libc has no erfc: there the distribution function
 * is the polynomial of Abramowitz and Stegun, 26.2.17, with an error of 7.5e-8.
 */
#include "figures.h"
#include "platform.h"

#include <math.h>

#define STEPS 300
#define SEARCH 3000

#ifdef FIGURES_FLOAT
typedef float real;
#define REAL(number) number##f
#define NAME "float"
#define today_figures today_float_figures
#else
typedef double real;
#define REAL(number) number
#define NAME "double"
#define today_figures today_double_figures
#endif

struct today {
    real threshold, bound, gain, estimate;
    bool bit;
};

static real distribution(real u)
{
#if defined(__AVR__)
    real magnitude = u < 0 ? -u : u;
    real t = REAL(1.0) / (REAL(1.0) + REAL(0.2316419) * magnitude);
    real sum = REAL(1.330274429) * t - REAL(1.821255978);
    sum = sum * t + REAL(1.781477937);
    sum = sum * t - REAL(0.356563782);
    sum = (sum * t + REAL(0.319381530)) * t;
    /* Where double has 32 bits, exp is in float. */
    real tail = REAL(0.39894228) * (real)exp(REAL(-0.5) * u * u) * sum;
    return u < 0 ? tail : REAL(1.0) - tail;
#elif defined(FIGURES_FLOAT)
    return 0.5f * erfcf(-u * 0.70710678f);
#else
    return 0.5 * erfc(-u * 0.70710678118654752);
#endif
}

typedef void update_function(struct today *today);

static void update(struct today *today)
{
    real z = today->estimate;
    z += today->gain * (distribution(today->threshold - z) - (today->bit ? 1 : 0));
    today->estimate = z > today->bound ? today->bound : (z < -today->bound ? -today->bound : z);
}

static void no_update(struct today *today)
{
    (void)today;
}

static uint32_t count_one(struct today *today, bool nothing)
{
    update_function *volatile called = nothing ? no_update : update;
    platform_count_from_here();
    called(today);
    return platform_count();
}

static uint32_t count(const struct today *today)
{
    struct today changed = *today;
    uint32_t cost = count_one(&changed, false);
    return cost - count_one(&changed, true);
}

/* Within +-2, from a random word. */
static real random_place(void)
{
    return (real)(int32_t)figure_random() / REAL(1073741824.0);
}

/* The same steps as the library's; the worst also over SEARCH random inputs. */
void today_figures(void)
{
    struct figure figure = {0, 0, 0};
    struct today today = {REAL(-0.5), REAL(0.5), 0, 0, false};
    uint32_t t = 100;
    for (unsigned k = 0; k < STEPS; ++k) {
        today.gain = REAL(375.0) / (real)t;
        today.bit = (real)(figure_random() >> 8) < REAL(16777216.0) * distribution(REAL(-0.25));
        figure_take(&figure, count(&today));
        update(&today);
        t += t / 32;
    }
    for (unsigned k = 0; k < SEARCH; ++k) {
        today.threshold = random_place();
        today.bound = 2;
        today.estimate = random_place();
        today.gain = random_place() * random_place();
        today.bit = (figure_random() & 1u) != 0;
        uint32_t cost = count(&today);
        figure.worst = cost > figure.worst ? cost : figure.worst;
    }
    figure_print(NAME, "update", &figure);
}
