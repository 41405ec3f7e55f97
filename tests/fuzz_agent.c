/*
 * Random calls of the public interface of one agent, each compared with tests/agent_model.h: the
 * code, what the call wrote, and that it wrote nothing else. Compiled once for each arithmetic.
 *
 * usage: fuzz-agent-<arithmetic> [--seed N] [--seconds S | --cases N | --case N]
 *
 * A case is a configuration, good or spoilt, and some hundred calls of an agent with it; it depends
 * on the seed and its number alone, so --seed and --case run again what failed. Without a seed the
 * clock gives one. Exit status: 0 no difference; 1 a difference, which is told in one line with the
 * seed and the case; 2 bad use. A crash, a fault that a sanitizer finds and a call that does not
 * return tell seed and case too, and end by their signal.
 */
#include "agent_model.h"

#include <errno.h>
#include <inttypes.h>
#include <math.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#ifdef __SANITIZE_ADDRESS__
/* The sanitizer sees a byte beyond an array, read or written; between guards it would not. */
static const size_t guard = 0;
/* What the sanitizers find ends with SIGABRT, for which the case is told. */
const char *__asan_default_options(void);
const char *__ubsan_default_options(void);
const char *__asan_default_options(void)
{
    return "abort_on_error=1";
}
const char *__ubsan_default_options(void)
{
    return "abort_on_error=1";
}
static const int signals[] = {SIGALRM, SIGABRT};
#else
static const size_t guard = 64;
static const int signals[] = {SIGALRM, SIGABRT, SIGSEGV, SIGBUS, SIGFPE, SIGILL};
#endif

#if ONEBIT_ARITHMETIC == ONEBIT_F64
#define PROGRAM "fuzz-agent-f64"
#elif ONEBIT_ARITHMETIC == ONEBIT_F32
#define PROGRAM "fuzz-agent-f32"
#else
#define PROGRAM "fuzz-agent-q31"
#endif

#define CALLS_PER_CASE 200u
#define SECONDS_PER_CASE 60u /* a case takes milliseconds: one that takes longer hangs */
#define CASES_THAT_MEET_ALL_CODES 500u

/* ---- failure ---- */

static uint64_t seed, case_number;
static const char *call = "no call";

/* Where to find the case again; the only thing that is said of a crash besides the crash. */
static void tell_case(void)
{
    char text[128];
    int length = snprintf(text, sizeof text,
                          PROGRAM ": during %s; again with --seed %" PRIu64 " --case %" PRIu64 "\n",
                          call, seed, case_number);
    (void)!write(STDOUT_FILENO, text, (size_t)length);
}

static void end_by_signal(int number)
{
    tell_case();
    (void)signal(number, SIG_DFL);
    (void)raise(number);
}

static void fail(const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    printf(PROGRAM ": %s: ", call);
    vprintf(format, arguments);
    va_end(arguments);
    printf("; again with --seed %" PRIu64 " --case %" PRIu64 "\n", seed, case_number);
    exit(1);
}

/* ---- chance ---- */

static uint64_t source;

/* SplitMix64 (Steele, Lea, Flood 2014). */
static uint64_t random_bits(void)
{
    uint64_t word = source += UINT64_C(0x9E3779B97F4A7C15);
    word = (word ^ (word >> 30)) * UINT64_C(0xBF58476D1CE4E5B9);
    word = (word ^ (word >> 27)) * UINT64_C(0x94D049BB133111EB);
    return word ^ (word >> 31);
}

static uint32_t random_word(void)
{
    return (uint32_t)(random_bits() >> 32);
}

/* 0 .. count - 1. */
static uint32_t below(uint32_t count)
{
    return (uint32_t)((uint64_t)random_word() * count >> 32);
}

static uint32_t between(uint32_t first, uint32_t last)
{
    return first + (uint32_t)((random_word() * ((uint64_t)last - first + 1)) >> 32);
}

static bool one_in(uint32_t count)
{
    return below(count) == 0;
}

/* In [0, 1). */
static double random_unit(void)
{
    return (double)(random_bits() >> 11) * 0x1p-53;
}

/* A word of any size: small ones as likely as large ones. */
static uint32_t random_size(void)
{
    uint32_t word = random_word();
    return word >> below(32);
}

/* ---- memory: each thing that a call may touch is a block of its own, with guards about it ---- */

enum {
    CONFIG,
    NEIGHBOURS,
    STABILIZING,
    COMPRESSION,
    HEARD_THRESHOLDS,
    SENT_THRESHOLDS,
    INITIAL,
    STATES,
    AGENT,
    ESTIMATES,
    FRAME,
    MESSAGE,
    BIT,
    CONTROL,
    BLOCKS
};
#define BLOCK(which) (1u << (which))

static struct block {
    const char *name;
    unsigned char *start;  /* of the guard before it */
    unsigned char *shadow; /* as it was before the call */
    size_t size;
} blocks[BLOCKS] = {
    [CONFIG] = {.name = "the configuration"},
    [NEIGHBOURS] = {.name = "neighbours"},
    [STABILIZING] = {.name = "stabilizing"},
    [COMPRESSION] = {.name = "compression"},
    [HEARD_THRESHOLDS] = {.name = "heard_thresholds"},
    [SENT_THRESHOLDS] = {.name = "sent_thresholds"},
    [INITIAL] = {.name = "the initial estimates"},
    [STATES] = {.name = "x"},
    [AGENT] = {.name = "the agent"},
    [ESTIMATES] = {.name = "the estimates"},
    [FRAME] = {.name = "the frame"},
    [MESSAGE] = {.name = "the message"},
    [BIT] = {.name = "the bit"},
    [CONTROL] = {.name = "u"},
};

static unsigned char pattern(size_t place)
{
    return (unsigned char)(0xA5u + 29u * place);
}

static void *allocated(size_t size)
{
    void *memory = malloc(size);
    if (memory == NULL) {
        fprintf(stderr, PROGRAM ": no memory\n");
        exit(2);
    }
    return memory;
}

/* A block of this size, filled with the pattern. */
static void *block(unsigned which, size_t size)
{
    struct block *made = &blocks[which];
    free(made->start);
    free(made->shadow);
    made->size = size;
    made->start = allocated(size + 2 * guard);
    made->shadow = allocated(size);
    for (size_t place = 0; place < size + 2 * guard; ++place) {
        made->start[place] = pattern(place);
    }
    return made->start + guard;
}

static void remember(void)
{
    for (unsigned which = 0; which < BLOCKS; ++which) {
        memcpy(blocks[which].shadow, blocks[which].start + guard, blocks[which].size);
    }
}

/* Nothing but these blocks has changed since remember(). */
static void require_only(unsigned changed)
{
    for (unsigned which = 0; which < BLOCKS; ++which) {
        const struct block *checked = &blocks[which];
        if ((changed & BLOCK(which)) == 0 &&
            memcmp(checked->shadow, checked->start + guard, checked->size) != 0) {
            fail("changed %s", checked->name);
        }
        for (size_t place = 0; place < guard; ++place) {
            size_t after = guard + checked->size + place;
            if (checked->start[place] != pattern(place) ||
                checked->start[after] != pattern(after)) {
                fail("wrote outside of %s", checked->name);
            }
        }
    }
}

/* ---- numbers ---- */

/* The nearest that there is. */
static onebit_real real(double number, int fraction_bits)
{
#if ONEBIT_ARITHMETIC == ONEBIT_Q31
    double scaled = ldexp(number, fraction_bits);
    return scaled >= 2147483647.0    ? INT32_MAX
           : scaled <= -2147483648.0 ? INT32_MIN
                                     : (onebit_real)lrint(scaled);
#else
    (void)fraction_bits;
    return (onebit_real)number;
#endif
}

static double as_double(onebit_real number, int fraction_bits)
{
#if ONEBIT_ARITHMETIC == ONEBIT_Q31
    return ldexp((double)number, -fraction_bits);
#else
    (void)fraction_bits;
    return (double)number;
#endif
}

static onebit_real noise(double number)
{
    return real(number, ONEBIT_NOISE_FRACTION_BITS);
}

/* The number above or below. */
static onebit_real next_to(onebit_real number, bool above)
{
#if ONEBIT_ARITHMETIC == ONEBIT_Q31
    return above ? (number == INT32_MAX ? number : number + 1)
                 : (number == INT32_MIN ? number : number - 1);
#elif ONEBIT_ARITHMETIC == ONEBIT_F64
    return nextafter(number, above ? HUGE_VAL : -HUGE_VAL);
#else
    return nextafterf(number, above ? HUGE_VALF : -HUGE_VALF);
#endif
}

/* Any bits; in floating point often such that are special. */
static onebit_real any_real(void)
{
#if ONEBIT_ARITHMETIC == ONEBIT_Q31
    static const int32_t special[] = {0, 1, -1, INT32_MAX, INT32_MIN, INT32_MIN + 1};
    if (one_in(3)) {
        return special[below(sizeof special / sizeof *special)];
    }
    int32_t number = (int32_t)random_word();
    return number / (int32_t)(1 + random_size() / 4);
#else
    static const double special[] = {0.0,
                                     -0.0,
                                     1.0,
                                     (double)INFINITY,
                                     -(double)INFINITY,
                                     (double)NAN,
                                     0x1p-1074,
                                     0x1p-149,
                                     0x1.fffffep127,
                                     -0x1.fffffep127,
                                     0x1p127,
                                     0x1p-126,
                                     0x1.fffffffffffffp1023,
                                     0x1p1000};
    if (one_in(3)) {
        return (onebit_real)special[below(sizeof special / sizeof *special)];
    }
    union {
        uint64_t bits;
        double number;
    } any = {random_bits()};
    return (onebit_real)any.number;
#endif
}

static onebit_real finite_real(void)
{
    for (;;) {
        onebit_real number = any_real();
        if (isfinite((double)number)) {
            return number;
        }
    }
}

#if ONEBIT_ARITHMETIC == ONEBIT_Q31
static onebit_coefficient coefficient(unsigned least_fraction_bits)
{
    onebit_coefficient result;
    result.value = 0x80000000u | random_word();
    if (one_in(4)) {
        result.value = one_in(2) ? UINT32_MAX : 0x80000000u;
    }
    result.fraction_bits = (uint16_t)between(least_fraction_bits, one_in(2) ? 62 : 31);
    return result;
}
#else
static onebit_coefficient coefficient(int most_exponent)
{
    double fraction = 0.5 + random_unit() / 2;
    return (onebit_coefficient)ldexp(fraction, (int)between(0, 31 + (unsigned)most_exponent) - 31);
}
#endif

/* ---- the case ---- */

static onebit_config *config;
static onebit_agent *agent;
static onebit_estimate *estimates;
static uint32_t *neighbours;
static onebit_real *stabilizing, *compression, *heard_thresholds, *sent_thresholds, *initial, *x;
static onebit_frame *frame;
static onebit_message *message;
static bool *bit;
static onebit_real *u;

/* The model's agent: what the library's must hold, but for estimates and gain. */
static struct {
    bool started;
    model_time t;
    uint32_t heard;
    uint16_t refused[ONEBIT_REFUSALS];
    uint16_t saturated;
} model;

static uint64_t seen[ONEBIT_STATUS_COUNT];
static uint64_t call_count;

/* A format that two agents can have. */
static onebit_format random_format(void)
{
    onebit_format format = {(uint8_t)below(2), 0, 0, 0};
    format.encoding = (uint8_t)below(one_in(4) ? 3 : 2);
    bool identifier = format.encoding == ONEBIT_ENCODING_IDENTIFIER;
    switch (below(3)) {
    case 0:
        format.base = identifier ? ONEBIT_IDENTIFIER_BASE : ONEBIT_PAYLOAD_BASE;
        break;
    case 1:
        format.base = (uint16_t)between(0x080, 0x7EA);
        break;
    default:
        format.base = one_in(2) ? 0x080 : 0x7EA;
        break;
    }
    uint16_t last = format.mode == ONEBIT_MODE_LINK ? 0x3FF : format.base;
    format.sync = one_in(2) ? ONEBIT_SYNC_IDENTIFIER
                            : (uint16_t)(one_in(2)   ? between(1, last)
                                         : one_in(2) ? 1
                                                     : last);
    if (format.mode == ONEBIT_MODE_LINK && one_in(2)) {
        format.base = (uint16_t)random_word();
    }
    if (format.encoding == ONEBIT_ENCODING_NONE && one_in(2)) {
        format.base = 0;
        format.sync = 0;
    }
    return format;
}

static uint32_t number_limit(void)
{
    return config->format.encoding == ONEBIT_ENCODING_NONE ? UINT32_MAX
                                                           : model_agent_limit(&config->format);
}

/* count + 1 numbers up to the limit: the neighbours' in order, and one that becomes the agent's. */
static void choose_numbers(unsigned count)
{
    uint32_t limit = number_limit();
    uint32_t numbers[ONEBIT_NEIGHBOURS_MAX + 1];
    uint32_t room = limit - count; /* to be spread between the numbers */
    uint32_t widest = one_in(2) ? room : one_in(2) ? 0 : room < 8 ? room : 8;
    uint32_t last = one_in(8) ? room - widest : 0;
    for (unsigned k = 0; k <= count; ++k) {
        uint32_t spread = between(0, widest / (count + 1));
        last += 1 + spread;
        numbers[k] = last;
    }
    if (one_in(4)) {
        numbers[count] = limit;
    }
    unsigned own = below(count + 1);
    config->agent = numbers[own];
    for (unsigned k = 0; k < count; ++k) {
        neighbours[k] = numbers[k < own ? k : k + 1];
    }
}

/* Entries of about 1 with so many fraction bits, and sometimes any. */
static void choose_row(onebit_real *row, unsigned count, int fraction_bits)
{
    bool any = one_in(8);
    for (unsigned i = 0; i < count; ++i) {
        row[i] = any ? finite_real() : real(8 * random_unit() - 4, fraction_bits);
        if (one_in(8)) {
            row[i] = 0;
        }
    }
#if ONEBIT_ARITHMETIC == ONEBIT_Q31
    int64_t sum = 0;
    for (unsigned i = 0; i < count; ++i) {
        sum += row[i] < 0 ? -(int64_t)row[i] : row[i];
    }
    int64_t divisor = sum / INT32_MAX + (sum % INT32_MAX != 0);
    int64_t left = INT32_MAX;
    for (unsigned i = 0; i < count; ++i) {
        row[i] = divisor > 1 ? (int32_t)(row[i] / divisor) : row[i];
        left -= row[i] < 0 ? -(int64_t)row[i] : row[i];
    }
    if (one_in(8)) {
        row[0] += row[0] < 0 ? (int32_t)-left : (int32_t)left; /* all that there may be */
    }
#endif
}

/* |threshold| + bound <= 4, and sometimes exactly 4. */
static onebit_real random_threshold(void)
{
    double room = 4 - as_double(config->bound, ONEBIT_NOISE_FRACTION_BITS);
    double number = one_in(8) ? room : one_in(8) ? 0 : room * random_unit();
    onebit_real threshold = noise(one_in(2) ? number : -number);
    /* Rounding may have brought it beyond. */
    return fabs(as_double(threshold, ONEBIT_NOISE_FRACTION_BITS)) > room ? 0 : threshold;
}

static onebit_real random_estimate(void)
{
    switch (below(8)) {
    case 0:
        return config->bound;
    case 1:
        return -config->bound;
    case 2:
        return 0;
    default:
        return noise(as_double(config->bound, ONEBIT_NOISE_FRACTION_BITS) *
                     (2 * random_unit() - 1) * 0.999999);
    }
}

static uint32_t random_start(void)
{
    switch (below(6)) {
    case 0:
        return 1;
    case 1:
        return UINT32_MAX - 1;
    case 2:
        return UINT32_MAX - 1 - random_size() % 512;
    case 3:
        return between(1, UINT32_MAX - 1);
    default:
        return 1 + random_size() % (UINT32_MAX - 1);
    }
}

/* A configuration within all documented ranges. */
static void choose_config(void)
{
    unsigned count = one_in(4) ? ONEBIT_NEIGHBOURS_MAX : one_in(4) ? 1 : between(1, 8);
    unsigned states = one_in(8) ? ONEBIT_STATES_MAX : one_in(4) ? 1 : between(1, 6);
    config = block(CONFIG, sizeof *config);
    memset(config, 0, sizeof *config);
    config->format = random_format();
    if (number_limit() <= count) {
        count = number_limit() - 1;
    }
    agent = block(AGENT, sizeof *agent);
    memset(agent, 0, sizeof *agent);
    estimates = block(ESTIMATES, count * sizeof *estimates);
    neighbours = block(NEIGHBOURS, count * sizeof *neighbours);
    stabilizing = block(STABILIZING, states * sizeof *stabilizing);
    compression = block(COMPRESSION, states * sizeof *compression);
    heard_thresholds = block(HEARD_THRESHOLDS, count * sizeof *heard_thresholds);
    sent_thresholds = block(SENT_THRESHOLDS, count * sizeof *sent_thresholds);
    initial = block(INITIAL, count * sizeof *initial);
    x = block(STATES, states * sizeof *x);
    frame = block(FRAME, sizeof *frame);
    message = block(MESSAGE, sizeof *message);
    bit = block(BIT, sizeof *bit);
    u = block(CONTROL, sizeof *u);
    memset(&model, 0, sizeof model);

    config->neighbours = neighbours;
    config->neighbour_count = (uint8_t)count;
    config->state_count = (uint8_t)states;
    choose_numbers(count);
    bool any_bits = one_in(3);
    config->fraction_bits.stabilizing = (int8_t)(any_bits ? below(47) : between(24, 30));
    config->fraction_bits.compression = (int8_t)(any_bits ? below(47) : between(24, 30));
    config->fraction_bits.state = (int8_t)(any_bits ? below(32) : between(20, 28));
    config->fraction_bits.control = (int8_t)(any_bits ? below(32) : between(20, 28));
    config->stabilizing = stabilizing;
    config->compression = compression;
    choose_row(stabilizing, states, config->fraction_bits.stabilizing);
    choose_row(compression, states, config->fraction_bits.compression);
    config->bound = one_in(16)  ? noise(4)
                    : one_in(8) ? next_to(0, true)
                                : noise(4 * random_unit() + 1e-6);
    if (as_double(config->bound, ONEBIT_NOISE_FRACTION_BITS) > 4) {
        config->bound = noise(4);
    }
    config->threshold = random_threshold();
    for (unsigned k = 0; k < count; ++k) {
        heard_thresholds[k] = random_threshold();
        sent_thresholds[k] = random_threshold();
    }
    config->heard_thresholds = one_in(2) ? heard_thresholds : NULL;
    config->sent_thresholds = one_in(2) ? sent_thresholds : NULL;
#if ONEBIT_ARITHMETIC == ONEBIT_Q31
    config->estimator_gain = coefficient(16);
    config->control_gain = coefficient(0);
    if (one_in(8)) {
        config->estimator_gain.value = 0x80000000u; /* 65536, the most */
        config->estimator_gain.fraction_bits = 15;
    }
#else
    config->estimator_gain = one_in(8) ? (onebit_coefficient)65536 : coefficient(16);
    config->control_gain = coefficient(32);
    if (one_in(8)) {
        config->control_gain = (onebit_coefficient)fabs((double)finite_real());
        config->control_gain += config->control_gain == 0;
    }
#endif
    config->start = random_start();
    config->seed = one_in(2) ? random_word() : below(3);
    config->run = one_in(2) ? random_word() : 0;
    config->first_link = config->format.mode == ONEBIT_MODE_LINK
                             ? (one_in(2) ? 1 + random_word() % UINT32_MAX : 1 + below(100))
                             : random_size() / 2;
}

static onebit_real not_finite_or(onebit_real otherwise)
{
#if ONEBIT_ARITHMETIC == ONEBIT_Q31
    return otherwise;
#else
    return one_in(3) ? otherwise
                     : (onebit_real)(one_in(2)   ? NAN
                                     : one_in(2) ? INFINITY
                                                 : -INFINITY);
#endif
}

/* A threshold with which |threshold| + bound is above 4, by little or much, or no number. */
static onebit_real bad_threshold(void)
{
    onebit_real limit = noise(4 - as_double(config->bound, ONEBIT_NOISE_FRACTION_BITS));
    onebit_real number =
        one_in(2) ? next_to(next_to(limit, true), true) : noise(4 + 12 * random_unit());
#if ONEBIT_ARITHMETIC == ONEBIT_Q31
    return one_in(8) ? INT32_MIN : one_in(2) ? number : -number;
#else
    return not_finite_or(one_in(2) ? number : -number);
#endif
}

static void spoil_row(onebit_real *row)
{
    unsigned i = below(config->state_count);
#if ONEBIT_ARITHMETIC == ONEBIT_Q31
    int64_t sum = 0;
    for (unsigned k = 0; k < config->state_count; ++k) {
        sum += k == i ? 0 : row[k] < 0 ? -(int64_t)row[k] : row[k];
    }
    int32_t least = (int32_t)(INT32_MAX - sum); /* more of it is too much */
    row[i] = least == INT32_MAX || one_in(4) ? INT32_MIN : one_in(2) ? least + 1 : -least - 1;
#else
    row[i] = (onebit_real)(one_in(2) ? NAN : one_in(2) ? INFINITY : -INFINITY);
#endif
}

static void spoil_coefficient(onebit_coefficient *spoilt, bool estimator)
{
#if ONEBIT_ARITHMETIC == ONEBIT_Q31
    switch (below(estimator ? 4 : 3)) {
    case 0:
        spoilt->value &= INT32_MAX;
        break;
    case 1:
        spoilt->value = 0;
        break;
    case 2:
        spoilt->fraction_bits = (uint16_t)(one_in(2) ? 63 : between(63, UINT16_MAX));
        break;
    default:
        spoilt->fraction_bits = (uint16_t)(one_in(2) ? 15 : below(16));
        spoilt->value |= 0x80000001u;
        break;
    }
#else
    switch (below(estimator ? 4 : 3)) {
    case 0:
        *spoilt = one_in(2) ? 0 : (onebit_coefficient)-0.0;
        break;
    case 1:
        *spoilt = -*spoilt;
        break;
    case 2:
        *spoilt = (onebit_coefficient)(one_in(2) ? NAN : one_in(2) ? INFINITY : -INFINITY);
        break;
    default:
        *spoilt =
            one_in(2) ? next_to(65536, true) : (onebit_coefficient)(65537 + 1e9 * random_unit());
        break;
    }
#endif
}

static void spoil_neighbours(void)
{
    uint32_t limit = number_limit();
    unsigned k = below(config->neighbour_count);
    switch (below(6)) {
    case 0:
        config->neighbour_count = 0;
        break;
    case 1:
        config->neighbour_count = (uint8_t)(one_in(2) ? 33 : between(33, 255));
        break;
    case 2:
        config->agent = neighbours[k];
        break;
    case 3:
        neighbours[0] = 0;
        break;
    case 4:
        neighbours[config->neighbour_count - 1u] =
            limit == UINT32_MAX ? 0 : limit + 1 + random_size() % 8;
        break;
    default:
        neighbours[k] = neighbours[below(config->neighbour_count)]; /* twice, if it is another */
        break;
    }
}

static void spoil_format(void)
{
    onebit_format *format = &config->format;
    switch (below(4)) {
    case 0:
        format->mode = (uint8_t)between(2, 255);
        break;
    case 1:
        format->encoding = (uint8_t)between(3, 255);
        break;
    case 2:
        format->base = one_in(2)   ? (uint16_t)random_word()
                       : one_in(2) ? 0x07F
                                   : (uint16_t)between(0x7EB, 0x7F0);
        break;
    default:
        format->sync = (uint16_t)(one_in(2)   ? 0
                                  : one_in(2) ? format->base + 1u
                                              : random_word() & 0xFFFFu);
        break;
    }
}

static void spoil_fraction_bits(void)
{
    switch (below(4)) {
    case 0:
        config->fraction_bits.stabilizing = (int8_t)(one_in(2) ? 47 : -1 - (int)below(128));
        break;
    case 1:
        config->fraction_bits.compression = (int8_t)(one_in(2) ? between(47, 127) : (unsigned)-1);
        break;
    case 2:
        config->fraction_bits.state = (int8_t)(one_in(2) ? 32 : -1);
        break;
    default:
        config->fraction_bits.control = (int8_t)(one_in(2) ? between(32, 127) : (unsigned)-1);
        break;
    }
}

/* One field, or a pointer, becomes wrong; now and then it happens to stay right. */
static void spoil_config(void)
{
    onebit_real *thresholds;
    unsigned k;
    switch (below(14)) {
    case 0:
        spoil_format();
        break;
    case 1:
        config->agent = one_in(2) ? 0 : one_in(2) ? number_limit() + 1 : random_word();
        break;
    case 2:
        spoil_neighbours();
        break;
    case 3:
        config->state_count = (uint8_t)(one_in(2) ? 0 : between(17, 255));
        break;
    case 4:
        spoil_row(stabilizing);
        break;
    case 5:
        spoil_row(compression);
        break;
    case 6:
        config->threshold = bad_threshold();
        break;
    case 7:
        config->heard_thresholds = heard_thresholds;
        config->sent_thresholds = sent_thresholds;
        thresholds = one_in(2) ? heard_thresholds : sent_thresholds;
        k = below(config->neighbour_count);
        thresholds[k] = bad_threshold();
        break;
    case 8:
        config->bound =
            one_in(3) ? 0 : not_finite_or(one_in(2) ? next_to(0, false) : -config->bound);
        break;
    case 9:
        spoil_coefficient(&config->estimator_gain, true);
        break;
    case 10:
        spoil_coefficient(&config->control_gain, false);
        break;
    case 11:
        config->start = one_in(2) ? 0 : UINT32_MAX;
        break;
    case 12:
        spoil_fraction_bits();
        break;
    default:
        switch (below(4)) {
        case 0:
            config->first_link = 0;
            break;
        case 1:
            config->neighbours = NULL;
            break;
        case 2:
            config->stabilizing = NULL;
            break;
        default:
            config->compression = NULL;
            break;
        }
        break;
    }
}

/* ---- what every call is asked ---- */

/* The call may have answered this; counts it. */
static onebit_status require_answer(onebit_status answer, codes allowed)
{
    ++call_count;
    if ((unsigned)answer >= ONEBIT_STATUS_COUNT) {
        fail("answered %d, which is no code", (int)answer);
    }
    if ((allowed >> answer & 1) == 0) {
        char text[512];
        int length = 0;
        for (unsigned code = 0; code < ONEBIT_STATUS_COUNT; ++code) {
            if (allowed >> code & 1) {
                length += snprintf(text + length, sizeof text - (size_t)length, " %s",
                                   onebit_status_name((onebit_status)code));
            }
        }
        fail("answered %s, not%s", onebit_status_name(answer), text);
    }
    ++seen[answer];
    return answer;
}

/* Which of so many pointers are null in this call: nearly always none. */
static unsigned some_nulls(unsigned pointers)
{
    return one_in(40) ? 1 + below((1u << pointers) - 1) : 0;
}
#define UNLESS(null, pointer) ((null) != 0 ? NULL : (pointer))

/* What all functions of an agent refuse first. */
static codes refusals_before(unsigned nulls)
{
    return (nulls != 0 ? CODE(ONEBIT_NULL) : 0) | (model.started ? 0 : CODE(ONEBIT_NOT_STARTED));
}

/* Data beyond the length is none. */
static bool same_frame(const onebit_frame *left, const onebit_frame *right)
{
    return left->identifier == right->identifier && left->flags == right->flags &&
           left->length == right->length && memcmp(left->data, right->data, left->length) == 0;
}

static bool same_message(const onebit_message *left, const onebit_message *right)
{
    return left->sender == right->sender && left->receiver == right->receiver &&
           left->step == right->step && left->has_step == right->has_step &&
           left->bit == right->bit;
}

static codes or_ok(codes refusals)
{
    return refusals != 0 ? refusals : CODE(ONEBIT_OK);
}

/* The agent holds what the model does, and the library thinks so too. */
static void require_agent(void)
{
    if (!model.started) {
        static const onebit_agent not_started;
        if (agent->estimates != not_started.estimates || onebit_valid(config, agent)) {
            fail("an agent that was not started counts as valid");
        }
        return;
    }
    if (agent->estimates != estimates) {
        fail("the agent lost its estimates");
    }
    if (agent->clock != (uint32_t)model.t || agent->wrapped != (model.t > UINT32_MAX)) {
        fail("the clock is %" PRIu32 "%s, not %" PRIu64, agent->clock,
             agent->wrapped ? " and wrapped" : "", model.t);
    }
    if (agent->heard != model.heard) {
        fail("heard is %" PRIx32 ", not %" PRIx32, agent->heard, model.heard);
    }
    for (unsigned k = 0; k < ONEBIT_REFUSALS; ++k) {
        if (agent->refused[k] != model.refused[k]) {
            fail("the counter of %s is %u, not %u",
                 onebit_status_name((onebit_status)(k + ONEBIT_REFUSED_FIRST)), agent->refused[k],
                 model.refused[k]);
        }
    }
    if (agent->saturated != model.saturated) {
        fail("saturated is %u, not %u", agent->saturated, model.saturated);
    }
    if (!model_gain(config, model.t, agent->gain)) {
        fail("the gain is not estimator_gain / %" PRIu64, model.t);
    }
    for (unsigned k = 0; k < config->neighbour_count; ++k) {
        if (!model_estimate(config, &estimates[k])) {
            fail("estimate %u is outside of [-bound, bound]", k);
        }
    }
    if (!onebit_valid(config, agent)) {
        fail("the agent counts as not valid");
    }
}

/* ---- calls ---- */

static void call_check(void)
{
    call = "onebit_check";
    remember();
    require_answer(onebit_check(config), model_check(config));
    require_answer(onebit_check(NULL), CODE(ONEBIT_NULL));
    if (onebit_valid(NULL, agent) || onebit_valid(config, NULL)) {
        fail("a null pointer counts as valid");
    }
    require_only(0);
}

/* Start with a configuration or initial estimates that may be wrong; true if the agent started. */
static bool call_start(void)
{
    call = "onebit_start";
    unsigned nulls = some_nulls(3);
    bool without = one_in(3);
    for (unsigned k = 0; k < blocks[INITIAL].size / sizeof *initial; ++k) {
        initial[k] = random_estimate();
    }
    if (one_in(4)) {
        bool above = one_in(2);
        onebit_real beyond = next_to(above ? config->bound : -config->bound, above);
        unsigned k = below((uint32_t)(blocks[INITIAL].size / sizeof *initial));
        initial[k] = not_finite_or(one_in(2) ? beyond : any_real());
    }
    codes allowed = model_check(config);
    if (allowed & CODE(ONEBIT_OK)) {
        /* Thresholds that need not be looked at, but may be, come before the initial estimates. */
        allowed = without ? allowed : (allowed & ~CODE(ONEBIT_OK)) | model_initial(config, initial);
    }
    if (nulls != 0) {
        allowed = CODE(ONEBIT_NULL) | (allowed & ~CODE(ONEBIT_OK));
    }
    remember();
    onebit_status answer =
        require_answer(onebit_start(UNLESS(nulls & 1, config), UNLESS(nulls & 2, agent),
                                    UNLESS(nulls & 4, estimates), without ? NULL : initial),
                       allowed);
    if (answer != ONEBIT_OK) {
        require_only(0);
        return false;
    }
    require_only(BLOCK(AGENT) | BLOCK(ESTIMATES));
    memset(&model, 0, sizeof model);
    model.started = true;
    model.t = (model_time)config->start + 1;
    for (unsigned k = 0; k < config->neighbour_count; ++k) {
        if (estimates[k].value != (without ? 0 : initial[k]) || estimates[k].carry != 0) {
            fail("estimate %u does not begin at what was given", k);
        }
    }
    require_agent();
    return true;
}

/* A state: often one with K2 x about the threshold, sometimes any bits. */
static void choose_state(void)
{
    unsigned kind = below(8);
    for (unsigned i = 0; i < config->state_count; ++i) {
        if (kind == 0 || (kind == 1 && one_in(4))) {
            x[i] = any_real();
        } else if (kind == 3) {
            x[i] = 0;
        } else if (kind == 2) {
            x[i] = real(2 * random_unit() - 1, config->fraction_bits.state);
        } else {
            double entry = as_double(compression[i], config->fraction_bits.compression);
            double wanted = (8 * random_unit() - 4) / config->state_count;
            double number = entry == 0 ? random_unit() : wanted / entry;
#if ONEBIT_ARITHMETIC == ONEBIT_F32
            number = fabs(number) > 3e38 ? 0 : number;
#endif
            x[i] = real(number, config->fraction_bits.state);
        }
    }
}

/* Message numbers, now and then one that there is none of. */
static unsigned random_place(void)
{
    unsigned count = onebit_message_count(config);
    return one_in(16) ? (one_in(2) ? count : count + random_size()) : below(count);
}

/* Codes for message k of state x besides the pointers. */
static codes refusals_of_message(unsigned k, codes *perhaps)
{
    codes refusals = k < onebit_message_count(config) ? 0 : CODE(ONEBIT_MESSAGE);
    *perhaps = 0;
    switch (model_compressed_finiteness(config, x)) {
    case NOT_FINITE:
        refusals |= CODE(ONEBIT_STATE);
        break;
    case PERHAPS_FINITE:
        *perhaps = CODE(ONEBIT_STATE);
        break;
    case FINITE:
        break;
    }
    return refusals;
}

/* The bit is that of a word: 1 exactly when (word >> 1) is below 2^31 F. */
static void require_bit(bool drawn, unsigned k, uint32_t word)
{
    interval probability = model_probability(config, x, k);
    long double number = (long double)(word >> 1);
    if (drawn ? number >= probability.high : number < probability.low) {
        fail("the bit is %d, the word %" PRIx32 " and 2^31 F %.3Lf..%.3Lf", drawn, word,
             probability.low, probability.high);
    }
}

/* A message that says this of itself is that of place k, but for its bit. */
static void require_message(const onebit_message *told, unsigned k, bool has_step)
{
    bool link = config->format.mode == ONEBIT_MODE_LINK;
    if (told->sender != config->agent || told->receiver != (link ? neighbours[k] : 0) ||
        told->step != (has_step ? model.t % 128 : 0) || told->has_step != has_step) {
        fail("message %u is from %" PRIu32 " to %" PRIu32 ", step %u, has_step %d", k, told->sender,
             told->receiver, told->step, told->has_step);
    }
}

static uint32_t word_of_message(unsigned k)
{
    return model_threefry(config->seed, config->run, model_link(config, k), (uint32_t)model.t);
}

static void call_send_message(void)
{
    call = "onebit_send_message";
    unsigned nulls = some_nulls(4);
    unsigned k = random_place();
    codes perhaps;
    choose_state();
    codes refusals = refusals_before(nulls) | refusals_of_message(k, &perhaps);
    remember();
    onebit_status answer =
        require_answer(onebit_send_message(UNLESS(nulls & 1, config), UNLESS(nulls & 2, agent),
                                           UNLESS(nulls & 4, x), k, UNLESS(nulls & 8, message)),
                       or_ok(refusals) | perhaps);
    require_only(answer == ONEBIT_OK ? BLOCK(MESSAGE) : 0);
    if (answer == ONEBIT_OK) {
        /* Without frames a message may carry its step whatever the encoding. */
        require_message(message, k,
                        config->format.encoding != ONEBIT_ENCODING_IDENTIFIER || message->has_step);
        require_bit(message->bit, k, word_of_message(k));
    }
}

static void call_send(void)
{
    call = "onebit_send";
    unsigned nulls = some_nulls(4);
    unsigned k = random_place();
    codes perhaps;
    choose_state();
    codes refusals = refusals_before(nulls) | refusals_of_message(k, &perhaps);
    if (model_agent_limit(&config->format) == 0) {
        refusals |= CODE(ONEBIT_CONFIG_FORMAT);
    }
    remember();
    onebit_status answer =
        require_answer(onebit_send(UNLESS(nulls & 1, config), UNLESS(nulls & 2, agent),
                                   UNLESS(nulls & 4, x), k, UNLESS(nulls & 8, frame)),
                       or_ok(refusals) | perhaps);
    require_only(answer == ONEBIT_OK ? BLOCK(FRAME) : 0);
    if (answer != ONEBIT_OK) {
        return;
    }
    onebit_message read;
    onebit_frame wanted = *frame;
    if (model_decode_frame(&config->format, frame, &read) != ONEBIT_OK) {
        fail("the frame %" PRIx32 " is none of the format's", frame->identifier);
    }
    require_message(&read, k, config->format.encoding == ONEBIT_ENCODING_PAYLOAD);
    require_bit(read.bit, k, word_of_message(k));
    (void)model_encode_frame(&config->format, &read, &wanted);
    if (!same_frame(frame, &wanted)) {
        fail("the frame %" PRIx32 " has other flags, length or data", frame->identifier);
    }
}

static void call_encode(void)
{
    call = "onebit_encode";
    unsigned nulls = some_nulls(3);
    unsigned k = random_place();
    uint32_t word = random_word();
    codes perhaps;
    choose_state();
    codes refusals = (nulls != 0 ? CODE(ONEBIT_NULL) : 0) | refusals_of_message(k, &perhaps);
    if (k < onebit_message_count(config) && (refusals & CODE(ONEBIT_STATE)) == 0 && perhaps == 0 &&
        !one_in(4)) {
        /* A word just below or above where the bit changes. */
        interval probability = model_probability(config, x, k);
        long double edge = one_in(2) ? floorl(probability.low) - 1 : ceill(probability.high);
        edge = edge < 0 ? 0 : edge > 0x1p31L - 1 ? 0x1p31L - 1 : edge;
        word = (uint32_t)edge << 1 | below(2);
    }
    remember();
    onebit_status answer =
        require_answer(onebit_encode(UNLESS(nulls & 1, config), UNLESS(nulls & 2, x), k, word,
                                     UNLESS(nulls & 4, bit)),
                       or_ok(refusals) | perhaps);
    require_only(answer == ONEBIT_OK ? BLOCK(BIT) : 0);
    if (answer == ONEBIT_OK) {
        require_bit(*bit, k, word);
    }
}

/* A message that may well be one for this agent in this step. */
static onebit_message likely_message(void)
{
    bool link = config->format.mode == ONEBIT_MODE_LINK;
    uint32_t ahead = one_in(8) ? below(128) : one_in(8) ? between(62, 66) : one_in(8) ? 127 : 0;
    bool one = one_in(2);
    onebit_message likely = {
        .sender = neighbours[below(config->neighbour_count)],
        .receiver = link ? config->agent : 0,
        .step = (uint8_t)((model.t + ahead) % 128),
        .has_step = config->format.encoding != ONEBIT_ENCODING_IDENTIFIER,
        .bit = one,
    };
    if (one_in(12)) {
        likely.sender = one_in(2) ? config->agent : 1 + random_size();
    }
    if (link && one_in(12)) {
        likely.receiver = one_in(2) ? likely.sender : 1 + random_size();
    }
    return likely;
}

static uint32_t random_linked(void)
{
    uint32_t some = random_word();
    if (one_in(2)) {
        some |= random_word();
    }
    return one_in(2) ? ONEBIT_ALL_LINKED : one_in(8) ? 0 : some;
}

/* What a message did: its counter, or an estimate and its bit of heard. */
static void require_taken(onebit_status answer, const onebit_message *told, unsigned neighbour)
{
    if (answer == ONEBIT_OK) {
        const onebit_estimate *before =
            (const onebit_estimate *)(const void *)blocks[ESTIMATES].shadow;
        for (unsigned k = 0; k < config->neighbour_count; ++k) {
            if (k != neighbour && memcmp(&before[k], &estimates[k], sizeof *before) != 0) {
                fail("the bit of neighbour %u changed the estimate of neighbour %u", neighbour, k);
            }
        }
        const char *wrong = model_update(config, model.t, neighbour, told->bit, &before[neighbour],
                                         &estimates[neighbour]);
        if (wrong != NULL) {
            fail("%s", wrong);
        }
        model.heard |= 1u << neighbour;
    } else if (answer >= ONEBIT_REFUSED_FIRST) {
        uint16_t *counter = &model.refused[answer - ONEBIT_REFUSED_FIRST];
        *counter = (uint16_t)(*counter + (*counter < UINT16_MAX));
    }
    if (answer >= ONEBIT_REFUSED_FIRST) {
        /* Nothing but the counter: the agent of before the call with it is the agent. */
        onebit_agent *before = (onebit_agent *)(void *)blocks[AGENT].shadow;
        before->refused[answer - ONEBIT_REFUSED_FIRST] =
            model.refused[answer - ONEBIT_REFUSED_FIRST];
        require_only(BLOCK(MESSAGE));
    }
}

static void call_receive_message(void)
{
    call = "onebit_receive_message";
    unsigned nulls = some_nulls(3);
    uint32_t linked = random_linked();
    *message = likely_message();
    if (one_in(16)) {
        message->has_step = !message->has_step;
    }
    unsigned neighbour = 0;
    codes refusals = refusals_before(nulls);
    codes allowed = refusals != 0
                        ? refusals
                        : model_receive(config, model.t, model.heard, message, linked, &neighbour);
    remember();
    onebit_status answer =
        require_answer(onebit_receive_message(UNLESS(nulls & 1, config), UNLESS(nulls & 2, agent),
                                              UNLESS(nulls & 4, message), linked),
                       allowed);
    require_only(answer == ONEBIT_OK              ? BLOCK(AGENT) | BLOCK(ESTIMATES)
                 : answer >= ONEBIT_REFUSED_FIRST ? BLOCK(AGENT)
                                                  : 0);
    require_taken(answer, message, neighbour);
}

/* A frame from the bus: of a neighbour, of another agent, spoilt, or any bits. */
static void choose_frame(void)
{
    onebit_message likely = likely_message();
    memset(frame, (int)below(256), sizeof *frame);
    if (model_encode_frame(&config->format, &likely, frame) != ONEBIT_OK || one_in(20)) {
        frame->identifier = one_in(2) ? random_word() : random_word() & 0x7FF;
        frame->flags = (uint8_t)below(one_in(2) ? 16 : 2);
        frame->length = (uint8_t)(one_in(2) ? below(3) : below(256));
    }
    if (one_in(4)) {
        switch (below(5)) {
        case 0:
            frame->identifier ^= 1u << below(32);
            break;
        case 1:
            frame->flags ^= (uint8_t)(1u << below(4));
            break;
        case 2:
            frame->flags = (uint8_t)below(16);
            break;
        case 3:
            frame->length = (uint8_t)(one_in(2) ? below(10) : below(256));
            break;
        default:
            frame->data[0] = (uint8_t)below(256);
            break;
        }
    }
}

static void call_receive(void)
{
    call = "onebit_receive";
    unsigned nulls = some_nulls(3);
    uint32_t linked = random_linked();
    bool without = one_in(3);
    choose_frame();
    memset(message, (int)below(256), sizeof *message);
    unsigned neighbour = 0;
    onebit_message told = {0, 0, 0, false, false};
    codes refusals = refusals_before(nulls);
    onebit_status decoded = model_decode_frame(&config->format, frame, &told);
    if (decoded == ONEBIT_CONFIG_FORMAT) {
        refusals |= CODE(decoded);
    }
    codes allowed = refusals;
    if (refusals == 0) {
        allowed = decoded != ONEBIT_OK
                      ? CODE(decoded)
                      : model_receive(config, model.t, model.heard, &told, linked, &neighbour);
    }
    remember();
    onebit_status answer =
        require_answer(onebit_receive(UNLESS(nulls & 1, config), UNLESS(nulls & 2, agent),
                                      UNLESS(nulls & 4, frame), linked, without ? NULL : message),
                       allowed);
    bool is_message = answer == ONEBIT_OK || answer >= ONEBIT_REFUSED_UNKNOWN;
    require_only((answer == ONEBIT_OK ? BLOCK(AGENT) | BLOCK(ESTIMATES) : 0) |
                 (answer >= ONEBIT_REFUSED_FIRST ? BLOCK(AGENT) : 0) |
                 (is_message && !without ? BLOCK(MESSAGE) : 0));
    if (is_message && !without && !same_message(message, &told)) {
        fail("the message is not what frame %" PRIx32 " says", frame->identifier);
    }
    require_taken(answer, &told, neighbour);
}

/* Once beyond 2^32 - 1 the agent tells t modulo 2^32, and stays beyond wherever it is moved. */
static const model_time wrap = (model_time)1 << 32;

static void move_to(model_time t)
{
    model.t = model.t < wrap && t < wrap ? t : wrap + t % wrap;
}

static void call_control(void)
{
    call = "onebit_control";
    unsigned nulls = some_nulls(4);
    uint32_t linked = random_linked();
    choose_state();
    codes allowed = refusals_before(nulls);
    if (allowed == 0) {
        allowed = model_control(config, model.t, estimates, model.heard & linked, x);
    }
    remember();
    onebit_status answer =
        require_answer(onebit_control(UNLESS(nulls & 1, config), UNLESS(nulls & 2, agent),
                                      UNLESS(nulls & 4, x), linked, UNLESS(nulls & 8, u)),
                       allowed);
    require_only(answer == ONEBIT_OK ? BLOCK(AGENT) | BLOCK(CONTROL) : 0);
    if (answer != ONEBIT_OK) {
        return;
    }
    bool counted = agent->saturated != model.saturated;
    if (model.saturated == UINT16_MAX && !counted) {
        /* It stands: whether this control was one to count cannot be seen. */
        counted = model_control_result(config, model.t, estimates, model.heard & linked, x, *u,
                                       true) == NULL;
    } else if (counted) {
        ++model.saturated;
    }
    const char *wrong =
        model_control_result(config, model.t, estimates, model.heard & linked, x, *u, counted);
    if (wrong != NULL) {
        fail("%s: %.17g at t = %" PRIu64, wrong, (double)*u, model.t);
    }
    model.heard = 0;
    move_to(model.t + 1);
}

static int32_t random_steps(void)
{
    int64_t to_wrap = (int64_t)UINT32_MAX - (int64_t)model.t;
    int64_t to_first = (int64_t)config->start + 1 - (int64_t)model.t;
    int64_t steps;
    switch (below(8)) {
    case 0:
        steps = 0;
        break;
    case 1:
        steps = to_first + (int64_t)below(3) - 1; /* one too far, to the first step, short of it */
        break;
    case 2:
        steps = to_wrap + (int64_t)below(256) - 128;
        break;
    case 3:
        steps = one_in(2) ? INT32_MAX : INT32_MIN;
        break;
    case 4:
        steps = (int32_t)random_word();
        break;
    default:
        steps = (int64_t)below(200) - 100;
        break;
    }
    return steps > INT32_MAX ? INT32_MAX : steps < INT32_MIN ? INT32_MIN : (int32_t)steps;
}

static void call_advance(void)
{
    call = "onebit_advance";
    unsigned nulls = some_nulls(2);
    int32_t steps = random_steps();
    int64_t moved = (int64_t)model.t + steps;
    codes refusals = refusals_before(nulls);
    codes perhaps = 0;
    if (model.started && moved < (int64_t)config->start + 1) {
        /* What is below, is not said of a clock that tells t modulo 2^32 only. */
        *(model.t < wrap ? &refusals : &perhaps) |= CODE(ONEBIT_CLOCK);
    }
    remember();
    onebit_status answer =
        require_answer(onebit_advance(UNLESS(nulls & 1, config), UNLESS(nulls & 2, agent), steps),
                       or_ok(refusals) | perhaps);
    require_only(answer == ONEBIT_OK ? BLOCK(AGENT) : 0);
    if (answer == ONEBIT_OK) {
        model.heard = 0;
        move_to((model_time)moved);
    }
}

/* An agent number up to a limit, the limit itself, or beyond it. */
static uint32_t near_limit(uint32_t limit)
{
    return one_in(4) ? limit + below(3) - 1 : one_in(4) ? random_size() : 1 + below(limit);
}

/* The codec by itself, with any format. */
static void call_codec(void)
{
    onebit_format format = one_in(2) ? config->format : random_format();
    if (one_in(4)) {
        format.base = (uint16_t)(one_in(2) ? random_word() : between(0x07E, 0x7F1));
        format.sync = (uint16_t)(one_in(2) ? random_word() : format.base + below(2));
        format.mode = (uint8_t)below(one_in(2) ? 4 : 2);
        format.encoding = (uint8_t)below(one_in(2) ? 5 : 2);
    }
    call = "onebit_frame_agent_limit";
    uint32_t limit = model_agent_limit(&format);
    if (onebit_frame_agent_limit(&format) != limit) {
        fail("%" PRIu32 ", not %" PRIu32, onebit_frame_agent_limit(&format), limit);
    }

    call = "onebit_frame_encode";
    onebit_message sent = {.step = (uint8_t)below(128)};
    sent.sender = near_limit(limit);
    sent.receiver = near_limit(limit);
    sent.has_step = one_in(2);
    sent.bit = one_in(2);
    unsigned nulls = some_nulls(3);
    memset(frame, (int)below(256), sizeof *frame);
    onebit_frame wanted = *frame;
    onebit_status status = model_encode_frame(&format, &sent, &wanted);
    codes allowed = CODE(status);
    if (nulls != 0) {
        allowed = CODE(ONEBIT_NULL) | (allowed & ~CODE(ONEBIT_OK));
    }
    remember();
    status = require_answer(onebit_frame_encode(UNLESS(nulls & 1, &format),
                                                UNLESS(nulls & 2, &sent), UNLESS(nulls & 4, frame)),
                            allowed);
    require_only(status == ONEBIT_OK ? BLOCK(FRAME) : 0);
    if (status == ONEBIT_OK && !same_frame(frame, &wanted)) {
        fail("another frame, %" PRIx32 " for %" PRIx32, frame->identifier, wanted.identifier);
    }

    call = "onebit_frame_decode";
    if (status != ONEBIT_OK || one_in(2)) {
        choose_frame();
    }
    onebit_message told = *message;
    nulls = some_nulls(3);
    status = model_decode_frame(&format, frame, &told);
    allowed = CODE(status);
    if (nulls != 0) {
        allowed = CODE(ONEBIT_NULL) | (allowed & ~CODE(ONEBIT_OK));
    }
    remember();
    status =
        require_answer(onebit_frame_decode(UNLESS(nulls & 1, &format), UNLESS(nulls & 2, frame),
                                           UNLESS(nulls & 4, message)),
                       allowed);
    require_only(status == ONEBIT_OK ? BLOCK(MESSAGE) : 0);
    if (status == ONEBIT_OK && !same_message(message, &told)) {
        fail("another message of frame %" PRIx32, frame->identifier);
    }

    call = "onebit_frame_sync";
    uint32_t t = random_word();
    onebit_frame_sync(&format, t, frame);
    wanted = *frame;
    model_sync(&format, t, &wanted);
    if (!same_frame(frame, &wanted)) {
        fail("another frame");
    }

    call = "onebit_frame_is_sync";
    if (one_in(2)) {
        choose_frame();
        frame->identifier = one_in(2) ? format.sync : frame->identifier;
    }
    uint8_t step = 77, wanted_step = 77;
    if (onebit_frame_is_sync(NULL, frame, &step) || onebit_frame_is_sync(&format, NULL, &step) ||
        onebit_frame_is_sync(&format, frame, NULL)) {
        fail("a null pointer is SYNC");
    }
    bool is_sync = model_is_sync(&format, frame, &wanted_step);
    if (onebit_frame_is_sync(&format, frame, &step) != is_sync || step != wanted_step) {
        fail("step %u, not %u", step, wanted_step);
    }
}

/* Counters that are nearly full, as after 65,534 refusals. */
static void fill_counters(void)
{
    unsigned k = below(ONEBIT_REFUSALS);
    agent->refused[k] = model.refused[k] = (uint16_t)(UINT16_MAX - below(3));
#if ONEBIT_ARITHMETIC == ONEBIT_Q31
    agent->saturated = model.saturated = (uint16_t)(UINT16_MAX - below(3));
#endif
}

/* Bits of heard beyond the neighbours are none's: control sums without them. */
static void control_beside_strangers(void)
{
    onebit_agent strange = *agent;
    choose_state();
    if (onebit_control(config, &strange, x, ONEBIT_ALL_LINKED, u) == ONEBIT_OK &&
        model_control_result(config, model.t, estimates, model.heard, x, *u, true) != NULL &&
        model_control_result(config, model.t, estimates, model.heard, x, *u, false) != NULL) {
        fail("control sums neighbours that there are not");
    }
}

/* Memory that something else wrote upon: a stated invariant no longer holds, and valid says so. */
static void corrupt(void)
{
    call = "onebit_valid after a corruption";
    onebit_agent agent_before = *agent;
    unsigned k = below(config->neighbour_count);
    onebit_estimate estimate_before = estimates[k];
    const char *what = NULL;
    switch (below(6)) {
    case 0:
        agent->estimates = NULL;
        what = "no estimates";
        break;
    case 1:
        if (config->neighbour_count < 32) {
            agent->heard |= 1u << between(config->neighbour_count, 31);
            what = "a neighbour heard that there is not";
            control_beside_strangers();
        }
        break;
    case 2:
        if (!agent->wrapped) {
            agent->clock = config->start - random_size() % config->start;
            what = "a clock before the first step";
        }
        break;
    case 3: {
        bool above = one_in(2);
        onebit_real beyond = next_to(above ? config->bound : -config->bound, above);
        estimates[k].value = not_finite_or(
            one_in(2) ? beyond : noise((above ? 1 : -1) * (4.1 + 11 * random_unit())));
        what = "an estimate outside of [-bound, bound]";
        break;
    }
    case 4: /* A clock whose gain is another, by more than two errors of a gain. */
        agent->clock ^= 1u << below(32);
        what = "a clock that the gain is not of";
        if (agent->wrapped || fabs((double)agent->clock - (double)agent_before.clock) <=
                                  0x1p-13 * (double)agent_before.clock) {
            what = NULL;
        }
        break;
    default: {
#if ONEBIT_ARITHMETIC == ONEBIT_Q31
        if (one_in(2)) {
            agent->gain.places = (int16_t)(agent->gain.places ^ (1 << below(16)));
        } else {
            agent->gain.mantissa ^= (uint16_t)(1u << between(3, 15));
        }
#else
        agent->gain =
            one_in(2) ? any_real() : agent->gain * (onebit_real)(one_in(2) ? 1.001 : -1.0);
#endif
        what = model_gain(config, model.t, agent->gain) ? NULL : "another gain";
        break;
    }
    }
    if (what != NULL && onebit_valid(config, agent)) {
        fail("%s counts as valid", what);
    }
    *agent = agent_before;
    estimates[k] = estimate_before;
    require_agent();
}

static void one_call(void)
{
    switch (below(16)) {
    case 0:
        call_send();
        break;
    case 1:
        call_send_message();
        break;
    case 2:
        call_encode();
        break;
    case 3:
    case 4:
    case 5:
    case 6:
        call_receive();
        break;
    case 7:
    case 8:
    case 9:
        call_receive_message();
        break;
    case 10:
    case 11:
        call_control();
        break;
    case 12:
        call_advance();
        break;
    case 13:
        call_codec();
        break;
    case 14:
        if (model.started && one_in(8)) {
            fill_counters();
        } else {
            call_check();
        }
        break;
    default:
        if (model.started) {
            corrupt();
        }
        break;
    }
    require_agent();
}

/* Configurations with one field wrong, or two; then the right one again. */
static void call_with_spoilt_configs(void)
{
    for (unsigned k = between(1, 4); k > 0; --k) {
        unsigned char kept[BLOCKS][sizeof(uint64_t) * 64];
        for (unsigned which = CONFIG; which <= SENT_THRESHOLDS; ++which) {
            memcpy(kept[which], blocks[which].start + guard, blocks[which].size);
        }
        spoil_config();
        if (one_in(4)) {
            /* Two, where the second does not look at what the first has spoilt. */
            if (config->neighbour_count >= 1 && config->neighbour_count <= ONEBIT_NEIGHBOURS_MAX &&
                config->state_count >= 1 && config->state_count <= ONEBIT_STATES_MAX) {
                spoil_config();
            }
        }
        call_check();
        if ((model_check(config) & CODE(ONEBIT_OK)) == 0 && call_start()) {
            fail("started with a configuration that is refused");
        }
        for (unsigned which = CONFIG; which <= SENT_THRESHOLDS; ++which) {
            memcpy(blocks[which].start + guard, kept[which], blocks[which].size);
        }
    }
}

static void run_case(void)
{
    (void)alarm(SECONDS_PER_CASE);
    source = seed;
    source = random_bits() + case_number;
    source = random_bits();
    call = "the choice of a configuration";
    choose_config();
    call_check();
    call_with_spoilt_configs();
    for (unsigned k = 0; k < 4; ++k) {
        one_call();
    }
    for (unsigned k = 0; k < CALLS_PER_CASE; ++k) {
        if (!model.started || one_in(64)) {
            (void)call_start();
        } else {
            one_call();
        }
    }
}

/* A run that has met few codes has tried little. */
static void require_all_codes(void)
{
    for (unsigned code = 0; code < ONEBIT_STATUS_COUNT; ++code) {
        bool floating_only = code == ONEBIT_STATE;
        bool fixed_only = code == ONEBIT_CONFIG_FRACTION_BITS;
        bool q31 = ONEBIT_ARITHMETIC == ONEBIT_Q31;
        if (seen[code] == 0 && !(floating_only && q31) && !(fixed_only && !q31)) {
            fail("%s was never met", onebit_status_name((onebit_status)code));
        }
    }
}

/* ---- program ---- */

static uint64_t number_or_exit(const char *text)
{
    char *end;
    errno = 0;
    uint64_t number = strtoull(text, &end, 10);
    if (errno != 0 || *text < '0' || *text > '9' || *end != '\0') {
        fprintf(stderr, PROGRAM ": %s is no number\n", text);
        exit(2);
    }
    return number;
}

static double seconds_now(void)
{
    struct timespec now;
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

int main(int argument_count, char **arguments)
{
    uint64_t cases = 1000;
    double seconds = 0;
    bool alone = false;
    seed = (uint64_t)time(NULL);
    for (int k = 1; k < argument_count; k += 2) {
        const char *option = arguments[k];
        if (k + 1 == argument_count) {
            option = "";
        }
        if (strcmp(option, "--seed") == 0) {
            seed = number_or_exit(arguments[k + 1]);
        } else if (strcmp(option, "--seconds") == 0) {
            seconds = (double)number_or_exit(arguments[k + 1]);
            cases = UINT64_MAX;
        } else if (strcmp(option, "--cases") == 0) {
            cases = number_or_exit(arguments[k + 1]);
        } else if (strcmp(option, "--case") == 0) {
            case_number = number_or_exit(arguments[k + 1]);
            alone = true;
        } else {
            fprintf(stderr, "usage: " PROGRAM " [--seed N] "
                            "[--seconds S | --cases N | --case N]\n");
            return 2;
        }
    }
    (void)setvbuf(stdout, NULL, _IOLBF, 0);
    for (unsigned k = 0; k < sizeof signals / sizeof *signals; ++k) {
        (void)signal(signals[k], end_by_signal);
    }
    printf(PROGRAM ": seed %" PRIu64 "\n", seed);
    if (!model_knows_random123()) {
        fail("the model's Threefry has not Random123's known answers");
    }
    double begin = seconds_now();
    if (alone) {
        run_case();
        printf(PROGRAM ": case %" PRIu64 " shows no difference\n", case_number);
        return 0;
    }
    while (case_number < cases && (seconds <= 0 || seconds_now() - begin < seconds)) {
        run_case();
        ++case_number;
    }
    if (case_number >= CASES_THAT_MEET_ALL_CODES) {
        call = "the whole run";
        require_all_codes();
    }
    printf(PROGRAM ": %" PRIu64 " cases, %" PRIu64 " calls, no difference\n", case_number,
           call_count);
    return 0;
}
