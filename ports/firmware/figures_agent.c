/*
 * Counts the library's operations in the arithmetic that this file is compiled for; see figures.c.
 *
 * Every count is one call through a pointer, less the same call of a function that does nothing:
 * the operation's own instructions, without call and return.
 */
#include "figures.h"
#include "figures_subject.h"
#include "platform.h"
#include "print.h"

#include "onebit_estimator.h"

#include <stddef.h>

#define STEPS 300
#define SEARCH 1500 /* random inputs, then as many changes of the worst */

/* Constants of the rows, and a random real number within +-16. */
#if ONEBIT_ARITHMETIC == ONEBIT_Q31
#define NAME "q31"
#define RANDOM_REAL(word) ((onebit_real)(word))
#else
#define NAME (ONEBIT_ARITHMETIC == ONEBIT_F32 ? "f32" : "f64")
#define RANDOM_REAL(word) ((onebit_real)(int32_t)(word) / (onebit_real)134217728)
#endif
#define IN_ROW(number) ONEBIT_REAL(number, 30)

/* The seven aircraft's constants (sim/scenarios/aircraft-fixed.yaml) in units of their noise. */
static const onebit_real stabilizing[STATES] = {IN_ROW(-0.9224), IN_ROW(-0.1825), IN_ROW(0),
                                                IN_ROW(-0.1788)};
static const onebit_real compression[STATES] = {IN_ROW(0.9684), IN_ROW(0.2263), IN_ROW(0.0894),
                                                IN_ROW(0.2193)};
static const uint32_t neighbours[NEIGHBOURS] = {2, 5, 7};
static const onebit_config aircraft = {
    .agent = 1,
    .neighbours = neighbours,
    .neighbour_count = NEIGHBOURS,
    .state_count = STATES,
    .format = ONEBIT_FORMAT_BROADCAST_PAYLOAD,
    .stabilizing = stabilizing,
    .compression = compression,
    .threshold = ONEBIT_NOISE(-0.5),
    .bound = ONEBIT_NOISE(0.5),
    .start = 99,
    .estimator_gain = ONEBIT_COEFFICIENT(375.0),
    .control_gain = ONEBIT_COEFFICIENT(4.0),
    .fraction_bits = {.stabilizing = 30, .compression = 30, .state = 26, .control = 26},
    .seed = 1,
};

typedef void update_function(const onebit_config *config, const onebit_agent *agent,
                             onebit_estimate *estimate, bool bit);
typedef onebit_probability cdf_function(onebit_real u);
typedef onebit_status encode_function(const onebit_config *config, const onebit_real *x, unsigned k,
                                      uint32_t word, bool *bit);
typedef onebit_status control_function(const onebit_config *config, onebit_agent *agent,
                                       const onebit_real *x, uint32_t linked, onebit_real *u);
typedef void step_function(struct figures_trial *trial);

static void no_update(const onebit_config *config, const onebit_agent *agent,
                      onebit_estimate *estimate, bool bit)
{
    (void)config;
    (void)agent;
    (void)estimate;
    (void)bit;
}

static onebit_probability no_cdf(onebit_real u)
{
    (void)u;
    return 0;
}

static onebit_status no_encode(const onebit_config *config, const onebit_real *x, unsigned k,
                               uint32_t word, bool *bit)
{
    (void)config;
    (void)x;
    (void)k;
    (void)word;
    (void)bit;
    return ONEBIT_OK;
}

static onebit_status no_control(const onebit_config *config, onebit_agent *agent,
                                const onebit_real *x, uint32_t linked, onebit_real *u)
{
    (void)config;
    (void)agent;
    (void)x;
    (void)linked;
    (void)u;
    return ONEBIT_OK;
}

static void no_step(struct figures_trial *trial)
{
    (void)trial;
}

enum operation { UPDATE, CDF, ENCODE, CONTROL, STEP, OPERATIONS };
static const char *const names[OPERATIONS] = {"update", "cdf", "encode", "control", "step"};

/*
 * One call and its count. The pointers are volatile, so that one call instruction serves both the
 * operation and nothing, and neither is compiled into this function.
 */
static uint32_t count_one(enum operation operation, struct figures_trial *trial, bool nothing)
{
    switch (operation) {
    case UPDATE: {
        update_function *volatile called = nothing ? no_update : figures_update;
        platform_count_from_here();
        called(&trial->config, &trial->agent, &trial->estimates[0], trial->bits[0]);
        return platform_count();
    }
    case CDF: {
        cdf_function *volatile called = nothing ? no_cdf : figures_cdf;
        platform_count_from_here();
        called(trial->u);
        return platform_count();
    }
    case ENCODE: {
        encode_function *volatile called = nothing ? no_encode : onebit_encode;
        bool bit;
        platform_count_from_here();
        called(&trial->config, trial->x, 0, trial->word, &bit);
        return platform_count();
    }
    case CONTROL: {
        control_function *volatile called = nothing ? no_control : onebit_control;
        onebit_real u;
        platform_count_from_here();
        called(&trial->config, &trial->agent, trial->x, ONEBIT_ALL_LINKED, &u);
        return platform_count();
    }
    default: {
        step_function *volatile called = nothing ? no_step : figures_step;
        platform_count_from_here();
        called(trial);
        return platform_count();
    }
    }
}

static uint32_t count(enum operation operation, struct figures_trial *trial)
{
    struct figures_trial untouched = *trial;
    untouched.agent.estimates = untouched.estimates;
    uint32_t cost = count_one(operation, &untouched, false);
    return cost - count_one(operation, &untouched, true);
}

/*
 * STEPS steps of one aircraft whose neighbours stay where they are, their bits drawn by the library
 * itself, with clocks from 100 on, each 1/32 above the last: to 840,000, evenly in the logarithm.
 */
static bool count_realistic(struct figures_trial *trial, struct figure *figures)
{
    static const onebit_real places[NEIGHBOURS] = {ONEBIT_NOISE(-0.25), ONEBIT_NOISE(0.1),
                                                   ONEBIT_NOISE(0.4)};
    trial->config = aircraft;
    if (onebit_start(&trial->config, &trial->agent, trial->estimates, NULL) != ONEBIT_OK) {
        return false;
    }
    for (unsigned k = 0; k < STEPS; ++k) {
        for (unsigned i = 0; i < NEIGHBOURS; ++i) {
            trial->bits[i] = (onebit_probability)(figure_random() >> 1) <
                             onebit_distribution(aircraft.threshold, places[i]);
        }
        for (unsigned i = 0; i < STATES; ++i) {
            trial->x[i] = RANDOM_REAL((int32_t)figure_random() / 64); /* within 1/4 */
        }
        trial->u = aircraft.threshold - trial->estimates[0].value;
        trial->word = figure_random();
        /* A control has heard all neighbours; the other operations begin with nobody heard. */
        for (enum operation operation = UPDATE; operation < OPERATIONS; ++operation) {
            trial->agent.heard = operation == CONTROL ? 7 : 0;
            figure_take(&figures[operation], count(operation, trial));
        }
        for (unsigned i = 0; i < NEIGHBOURS; ++i) {
            onebit_update(&trial->estimates[i], &trial->agent.gain, aircraft.threshold,
                          &aircraft.bound, trial->bits[i]);
        }
        onebit_advance(&trial->config, &trial->agent, (int32_t)(trial->agent.clock / 32));
    }
    return true;
}

/* Of all sizes and, one time in four, an extreme. */
static uint32_t random_word(void)
{
    static const uint32_t extremes[] = {0, 1, 0xFFFFFFFFu, 0x7FFFFFFFu, 0x80000000u, 0x80000001u};
    uint32_t word = figure_random();
    uint32_t kind = figure_random();
    return kind % 4u == 0 ? extremes[kind / 4u % 6u] : word >> (kind >> 3 & 31u);
}

static onebit_real random_real(void)
{
    uint32_t word = random_word();
    return RANDOM_REAL(figure_random() & 1u ? word : 0u - word);
}

/* Within +-limit, the ends among them. */
static onebit_real random_within(onebit_real limit)
{
    onebit_real real = random_real();
    return real > limit ? limit : (real < -limit ? -limit : real);
}

/* Draws one of the trial's fields anew; all that onebit_check and onebit_start take. */
enum { FIELDS = 8 };
static void draw(struct figures_trial *trial, unsigned field)
{
    switch (field) {
    case 0: /* |threshold| + bound <= 4, and the estimates within the bound */
        trial->config.threshold = random_within(ONEBIT_NOISE(3.9));
        trial->config.bound =
            ONEBIT_NOISE(4) -
            (trial->config.threshold < 0 ? -trial->config.threshold : trial->config.threshold);
        /* fall through */
    case 1:
        for (unsigned k = 0; k < NEIGHBOURS; ++k) {
            trial->estimates[k].value = random_within(trial->config.bound);
#if ONEBIT_ARITHMETIC == ONEBIT_Q31
            trial->estimates[k].carry = random_word();
#else
            trial->estimates[k].carry = random_within(ONEBIT_NOISE(0.001)) / 65536;
#endif
        }
        return;
    case 2:
#if ONEBIT_ARITHMETIC == ONEBIT_Q31
        trial->config.estimator_gain.value = random_word() | 0x80000000u;
        trial->config.estimator_gain.fraction_bits = (uint16_t)(16u + figure_random() % 47u);
#else
        trial->config.estimator_gain = (onebit_real)(random_word() >> 16 | 1u) /
                                       (onebit_real)(1u + (figure_random() & 0xFFFu));
#endif
        trial->config.control_gain = trial->config.estimator_gain;
        return;
    case 3:
        trial->agent.clock = random_word() | 1u;
        return;
    case 4:
        for (unsigned k = 0; k < STATES; ++k) {
            trial->x[k] = random_real();
        }
        return;
    case 5:
        trial->u = random_real();
        return;
    case 6:
        trial->word = random_word();
        return;
    default:
        for (unsigned k = 0; k < NEIGHBOURS; ++k) {
            trial->bits[k] = (figure_random() & 1u) != 0;
        }
        trial->agent.heard = figure_random() % 8u;
    }
}

/* The count of a trial after its gain has been made to fit; a step begins with nobody heard. */
static uint32_t count_drawn(enum operation operation, struct figures_trial *trial)
{
    trial->agent.gain =
        onebit_gain_of(trial->config.estimator_gain, onebit_reciprocal_of(trial->agent.clock));
    trial->agent.heard = operation == STEP ? 0 : trial->agent.heard;
    return count(operation, trial);
}

/*
 * The worst case: SEARCH inputs at random, then SEARCH times one field of the worst drawn anew,
 * kept if not better.
 */
static void search(enum operation operation, struct figures_trial *worst, struct figure *figure)
{
    struct figures_trial trial = *worst;
    uint32_t most = 0;
    for (unsigned k = 0; k < 2 * SEARCH; ++k) {
        if (k < SEARCH) {
            for (unsigned field = 0; field < FIELDS; ++field) {
                draw(&trial, field);
            }
        } else {
            trial = *worst;
            draw(&trial, figure_random() % FIELDS);
        }
        uint32_t cost = count_drawn(operation, &trial);
        if (cost >= most) {
            most = cost;
            *worst = trial;
        }
    }
    figure->worst = most > figure->worst ? most : figure->worst;
}

bool ONEBIT_NAME(figures)(void)
{
    struct figures_trial trial = {.u = 0};
    struct figure figures[OPERATIONS] = {{0, 0, 0}};
    if (!count_realistic(&trial, figures)) {
        return false;
    }
    for (enum operation operation = UPDATE; operation < OPERATIONS; ++operation) {
        search(operation, &trial, &figures[operation]);
        figure_print(NAME, names[operation], &figures[operation]);
    }
    print_text(NAME);
    print_text(" memory ");
    print_decimal(sizeof(onebit_agent) + NEIGHBOURS * sizeof(onebit_estimate));
    print_text("\n");
    return true;
}
