/* The model of agent_model.h. What it says of the library stands in lib/'s public headers. */
#include "agent_model.h"

#include <float.h>
#include <math.h>

/* 2^32 - 1, beyond which gains stay what they were there. */
#define LAST_TIME ((model_time)UINT32_MAX)

/* ---- numbers ---- */

/* README.md, of the table that is F in f32 and q31. */
#define TABLE_ERROR 4.2e-7L

#define Q31 (ONEBIT_ARITHMETIC == ONEBIT_Q31)

#if ONEBIT_ARITHMETIC == ONEBIT_Q31

__extension__ typedef __int128 wide;

#define GAIN_ERROR 0x1p-15L /* relative, of a coefficient over t */
/* The argument of F is Q4.27; the estimate has 32 bits more. */
#define DISTRIBUTION_ERROR (TABLE_ERROR + 0x1p-27L * 0.39894228L)

static long double in_noise_units(onebit_real number)
{
    return ldexpl((long double)number, -ONEBIT_NOISE_FRACTION_BITS);
}

static long double coefficient_value(onebit_coefficient coefficient)
{
    return ldexpl((long double)coefficient.value, -(int)coefficient.fraction_bits);
}

static long double gain_value(onebit_gain gain)
{
    return ldexpl((long double)gain.mantissa, -(gain.places + 13));
}

static long double carry_value(const onebit_estimate *estimate)
{
    return ldexpl((long double)estimate->carry, -59);
}

/* Of |threshold| + bound, at 4. */
#define THRESHOLD_ROUNDING 0.0L
/* Steps may saturate there, twice the largest bound: a place short of it. */
#define MOST_STEP (8 - 0x1p-27L)

#else

#if ONEBIT_ARITHMETIC == ONEBIT_F64
#define UNIT ((long double)DBL_EPSILON / 2) /* of a rounding, relative */
#define LEAST 0x1p-1074L                    /* of a rounding below the normal numbers */
#define LARGEST ((long double)DBL_MAX)
/* erfc of libm to some units of its last place, and the rounding of its argument. */
#define DISTRIBUTION_ERROR 0x1p-51L
#else
#define UNIT ((long double)FLT_EPSILON / 2)
#define LEAST 0x1p-149L
#define LARGEST ((long double)FLT_MAX)
/* The table's; half a unit of the argument's last place and its way to Q4.27, times the density. */
#define DISTRIBUTION_ERROR (TABLE_ERROR + 0x1p-26L + 0x1p-28L)
#endif

#define GAIN_ERROR (4 * UNIT) /* roundings of t, of its reciprocal and of a product */
#define THRESHOLD_ROUNDING (4 * UNIT)
#define MOST_STEP LARGEST /* none saturates */

static long double in_noise_units(onebit_real number)
{
    return (long double)number;
}

static long double coefficient_value(onebit_coefficient coefficient)
{
    return (long double)coefficient;
}

static long double gain_value(onebit_gain gain)
{
    return (long double)gain;
}

static long double carry_value(const onebit_estimate *estimate)
{
    return (long double)estimate->carry;
}

static bool finite_number(onebit_real number)
{
    return isfinite(number);
}

#endif

static long double distribution(long double u)
{
    return 0.5L * erfcl(-u * 0.707106781186547524400844362104849039L);
}

/* The times between which a gain's divisor is: t, but beyond 2^32 - 1 it stays. */
static interval divisor(model_time t)
{
    interval between = {(long double)t, (long double)t};
    if (t > LAST_TIME) {
        between.low = (long double)LAST_TIME;
        between.high = (long double)LAST_TIME + 1;
    }
    return between;
}

/* ---- configurations ---- */

/*
 * By how much |threshold| + bound exceeds 4, which it must not; a number that is none exceeds it by
 * more than anything. Where it matters the sum is exact.
 */
static long double excess(onebit_real threshold, onebit_real bound)
{
    long double over = fabsl(in_noise_units(threshold)) - 4 + in_noise_units(bound);
    return isnan(over) ? HUGE_VALL : over;
}

/*
 * The codes when there is this threshold too. Which of the two is wrong where only their sum is, is
 * not said.
 */
static codes with_threshold(codes allowed, onebit_real threshold, onebit_real bound, bool used)
{
    long double over = excess(threshold, bound);
    if (over <= 0 && bound > 0) {
        return allowed;
    }
    if (over > THRESHOLD_ROUNDING || !(bound > 0)) {
        allowed &= used ? ~CODE(ONEBIT_OK) : ~(codes)0;
    }
    bool alone = !(fabsl(in_noise_units(threshold)) < 4); /* there is no bound for it */
    if (over > 0 || alone) {
        allowed |= CODE(ONEBIT_CONFIG_THRESHOLD);
    }
    if (!(bound > 0) || !alone) {
        allowed |= CODE(ONEBIT_CONFIG_BOUND);
    }
    return allowed;
}

static bool row_in_range(const onebit_real *row, unsigned count)
{
#if ONEBIT_ARITHMETIC == ONEBIT_Q31
    int64_t sum = 0;
    for (unsigned i = 0; i < count; ++i) {
        sum += row[i] < 0 ? -(int64_t)row[i] : (int64_t)row[i];
    }
    return sum <= INT32_MAX;
#else
    for (unsigned i = 0; i < count; ++i) {
        if (!finite_number(row[i])) {
            return false;
        }
    }
    return true;
#endif
}

static bool coefficient_in_range(onebit_coefficient coefficient)
{
#if ONEBIT_ARITHMETIC == ONEBIT_Q31
    return coefficient.value >> 31 == 1 && coefficient.fraction_bits <= 62;
#else
    return finite_number(coefficient) && coefficient > 0;
#endif
}

static bool fraction_bits_in_range(const onebit_config *config)
{
    return !Q31 ||
           (config->fraction_bits.stabilizing >= 0 && config->fraction_bits.stabilizing <= 46 &&
            config->fraction_bits.compression >= 0 && config->fraction_bits.compression <= 46 &&
            config->fraction_bits.state >= 0 && config->fraction_bits.state <= 31 &&
            config->fraction_bits.control >= 0 && config->fraction_bits.control <= 31);
}

static bool neighbours_in_range(const onebit_config *config, uint32_t limit)
{
    if (config->neighbour_count < 1 || config->neighbour_count > ONEBIT_NEIGHBOURS_MAX) {
        return false;
    }
    uint32_t last = 0;
    for (unsigned k = 0; k < config->neighbour_count; ++k) {
        uint32_t number = config->neighbours[k];
        if (number <= last || number > limit || number == config->agent) {
            return false;
        }
        last = number;
    }
    return true;
}

/* Another bus has messages of a mode, and no identifiers. */
static bool format_in_range(const onebit_format *format)
{
    return format->encoding == ONEBIT_ENCODING_NONE ? format->mode <= ONEBIT_MODE_LINK
                                                    : model_agent_limit(format) != 0;
}

codes model_check(const onebit_config *config)
{
    if (config->neighbours == NULL || config->stabilizing == NULL || config->compression == NULL) {
        return CODE(ONEBIT_NULL);
    }
    /* In the order of the codes, but fraction bits before the rows. */
    bool link = config->format.mode == ONEBIT_MODE_LINK;
    uint32_t limit = config->format.encoding == ONEBIT_ENCODING_NONE
                         ? UINT32_MAX
                         : model_agent_limit(&config->format);
    if (!format_in_range(&config->format)) {
        return CODE(ONEBIT_CONFIG_FORMAT);
    }
    if (config->agent < 1 || config->agent > limit) {
        return CODE(ONEBIT_CONFIG_AGENT);
    }
    if (!neighbours_in_range(config, limit)) {
        return CODE(ONEBIT_CONFIG_NEIGHBOURS);
    }
    if (config->state_count < 1 || config->state_count > ONEBIT_STATES_MAX) {
        return CODE(ONEBIT_CONFIG_STATES);
    }
    if (!fraction_bits_in_range(config)) {
        return CODE(ONEBIT_CONFIG_FRACTION_BITS);
    }
    if (!row_in_range(config->stabilizing, config->state_count)) {
        return CODE(ONEBIT_CONFIG_STABILIZING);
    }
    if (!row_in_range(config->compression, config->state_count)) {
        return CODE(ONEBIT_CONFIG_COMPRESSION);
    }
    codes allowed = CODE(ONEBIT_OK);
    allowed = with_threshold(allowed, config->threshold, config->bound, true);
    for (unsigned k = 0; k < config->neighbour_count; ++k) {
        if (config->heard_thresholds != NULL) {
            allowed = with_threshold(allowed, config->heard_thresholds[k], config->bound, true);
        }
        if (config->sent_thresholds != NULL) {
            /* Broadcast does not use them: they may be looked at or not. */
            allowed = with_threshold(allowed, config->sent_thresholds[k], config->bound, link);
        }
    }
    if ((allowed & CODE(ONEBIT_OK)) == 0) {
        return allowed;
    }
    allowed &= ~CODE(ONEBIT_OK);
    if (!coefficient_in_range(config->estimator_gain) ||
        coefficient_value(config->estimator_gain) > 65536) {
        return allowed | CODE(ONEBIT_CONFIG_ESTIMATOR_GAIN);
    }
    if (!coefficient_in_range(config->control_gain)) {
        return allowed | CODE(ONEBIT_CONFIG_CONTROL_GAIN);
    }
    if (config->start < 1 || config->start > UINT32_MAX - 1) {
        return allowed | CODE(ONEBIT_CONFIG_START);
    }
    if (link && config->first_link < 1) {
        return allowed | CODE(ONEBIT_CONFIG_FIRST_LINK);
    }
    return allowed | CODE(ONEBIT_OK);
}

codes model_initial(const onebit_config *config, const onebit_real *initial)
{
    for (unsigned k = 0; k < config->neighbour_count; ++k) {
        if (!(fabsl(in_noise_units(initial[k])) <= in_noise_units(config->bound))) {
            return CODE(ONEBIT_ESTIMATE);
        }
    }
    return CODE(ONEBIT_OK);
}

/* ---- frames ---- */

#define LAST_IDENTIFIER 0x7EFu /* of 11 bits; the first follows from the base */
#define LINK_AGENTS 8191u

static uint32_t identifier_of(const onebit_format *format, uint32_t sender, uint32_t receiver,
                              bool bit)
{
    uint32_t bit_in_identifier = format->encoding == ONEBIT_ENCODING_IDENTIFIER ? bit : 0;
    if (format->mode == ONEBIT_MODE_LINK) {
        return ONEBIT_LINK_BASE + sender * 0x4000u + receiver * 2 + bit_in_identifier;
    }
    return format->encoding == ONEBIT_ENCODING_IDENTIFIER
               ? format->base + sender * 2 + bit_in_identifier
               : format->base + sender;
}

uint32_t model_agent_limit(const onebit_format *format)
{
    if (format->encoding != ONEBIT_ENCODING_PAYLOAD &&
        format->encoding != ONEBIT_ENCODING_IDENTIFIER) {
        return 0;
    }
    if (format->mode == ONEBIT_MODE_LINK) {
        return format->sync >= 1 && format->sync <= 0x3FF ? LINK_AGENTS : 0;
    }
    if (format->mode != ONEBIT_MODE_BROADCAST || format->base < 0x080 || format->base > 0x7EE ||
        format->sync < 1 || format->sync > format->base) {
        return 0;
    }
    uint32_t limit = 0;
    while (identifier_of(format, limit + 1, 0, true) <= LAST_IDENTIFIER) {
        ++limit;
    }
    return limit;
}

onebit_status model_encode_frame(const onebit_format *format, const onebit_message *message,
                                 onebit_frame *frame)
{
    uint32_t limit = model_agent_limit(format);
    bool link = format->mode == ONEBIT_MODE_LINK;
    if (limit == 0) {
        return ONEBIT_CONFIG_FORMAT;
    }
    if (message->sender < 1 || message->sender > limit ||
        (link && (message->receiver < 1 || message->receiver > limit))) {
        return ONEBIT_IDENTIFIER;
    }
    frame->identifier = identifier_of(format, message->sender, message->receiver, message->bit);
    frame->flags = link ? ONEBIT_FRAME_EXTENDED : 0;
    frame->length = format->encoding == ONEBIT_ENCODING_PAYLOAD ? 1 : 0;
    if (frame->length == 1) {
        frame->data[0] = (uint8_t)(message->step % ONEBIT_STEP_MODULUS * 2 + message->bit);
    }
    return ONEBIT_OK;
}

onebit_status model_decode_frame(const onebit_format *format, const onebit_frame *frame,
                                 onebit_message *message)
{
    uint32_t limit = model_agent_limit(format);
    bool link = format->mode == ONEBIT_MODE_LINK;
    bool payload = format->encoding == ONEBIT_ENCODING_PAYLOAD;
    if (limit == 0) {
        return ONEBIT_CONFIG_FORMAT;
    }
    if (frame->flags & ONEBIT_FRAME_ERROR) {
        return ONEBIT_REFUSED_ERROR_FRAME;
    }
    /* Found by writing: the identifier is the format's if some sender and receiver have it. */
    uint32_t sender, receiver = 0;
    if (link) {
        sender = (frame->identifier - ONEBIT_LINK_BASE) / 0x4000u;
        receiver = frame->identifier % 0x4000u / 2;
    } else {
        sender = (frame->identifier - format->base) / (payload ? 1 : 2);
    }
    bool known = sender >= 1 && sender <= limit && (!link || (receiver >= 1 && receiver <= limit));
    bool zero = known && frame->identifier == identifier_of(format, sender, receiver, false);
    bool one = known && frame->identifier == identifier_of(format, sender, receiver, true);
    if (((frame->flags & ONEBIT_FRAME_EXTENDED) != 0) != link || (!zero && !one)) {
        return ONEBIT_REFUSED_FOREIGN;
    }
    if (frame->flags & ONEBIT_FRAME_REMOTE) {
        return ONEBIT_REFUSED_REMOTE;
    }
    if (frame->flags & ONEBIT_FRAME_FLEXIBLE) {
        return ONEBIT_REFUSED_FLEXIBLE;
    }
    if (frame->length != (payload ? 1 : 0)) {
        return ONEBIT_REFUSED_LENGTH;
    }
    message->sender = sender;
    message->receiver = receiver;
    message->has_step = payload;
    message->step = payload ? frame->data[0] / 2 : 0;
    message->bit = payload ? frame->data[0] % 2 != 0 : one;
    return ONEBIT_OK;
}

void model_sync(const onebit_format *format, uint32_t t, onebit_frame *frame)
{
    frame->identifier = format->sync;
    frame->flags = 0;
    frame->length = 1;
    frame->data[0] = (uint8_t)(t % 128 == 0 ? 128 : t % 128);
}

bool model_is_sync(const onebit_format *format, const onebit_frame *frame, uint8_t *step)
{
    if (frame->identifier != format->sync || frame->length > 1 ||
        (frame->flags & (ONEBIT_FRAME_EXTENDED | ONEBIT_FRAME_REMOTE | ONEBIT_FRAME_ERROR |
                         ONEBIT_FRAME_FLEXIBLE)) != 0) {
        return false;
    }
    bool told = frame->length == 1 && frame->data[0] >= 1 && frame->data[0] <= 128;
    *step = told ? frame->data[0] % 128 : ONEBIT_NO_STEP;
    return true;
}

/* ---- random words ---- */

/*
 * Threefry-2x32-20 as the paper of Salmon and others describes it: a round adds, rotates and
 * exclusive-ors; before the first and after every fourth round words of the key are added, the
 * third of them the parity of the others, and the number of the addition.
 */
static void threefry(const uint32_t key[2], const uint32_t counter[2], uint32_t output[2])
{
    static const unsigned rotations[8] = {13, 15, 26, 6, 17, 29, 16, 24};
    uint32_t words[3] = {key[0], key[1], 0x1BD11BDAu ^ key[0] ^ key[1]};
    uint32_t x = counter[0] + words[0];
    uint32_t y = counter[1] + words[1];
    for (unsigned round = 0; round < 20; ++round) {
        x += y;
        y = (y << rotations[round % 8] | y >> (32 - rotations[round % 8])) ^ x;
        if (round % 4 == 3) {
            uint32_t addition = round / 4 + 1;
            x += words[addition % 3];
            y += words[(addition + 1) % 3] + addition;
        }
    }
    output[0] = x;
    output[1] = y;
}

uint32_t model_threefry(uint32_t key0, uint32_t key1, uint32_t counter0, uint32_t counter1)
{
    uint32_t key[2] = {key0, key1}, counter[2] = {counter0, counter1}, output[2];
    threefry(key, counter, output);
    return output[0];
}

/* Its file kat_vectors, threefry2x32 with 20 rounds. */
bool model_knows_random123(void)
{
    static const struct {
        uint32_t counter[2], key[2], output[2];
    } answers[] = {
        {{0, 0}, {0, 0}, {0x6b200159u, 0x99ba4efeu}},
        {{0xffffffffu, 0xffffffffu}, {0xffffffffu, 0xffffffffu}, {0x1cb996fcu, 0xbb002be7u}},
        {{0x243f6a88u, 0x85a308d3u}, {0x13198a2eu, 0x03707344u}, {0xc4923a9cu, 0x483df7a0u}},
    };
    for (unsigned k = 0; k < sizeof answers / sizeof *answers; ++k) {
        uint32_t output[2];
        threefry(answers[k].key, answers[k].counter, output);
        if (output[0] != answers[k].output[0] || output[1] != answers[k].output[1]) {
            return false;
        }
    }
    return true;
}

uint32_t model_link(const onebit_config *config, unsigned k)
{
    return config->format.mode == ONEBIT_MODE_LINK ? config->first_link + k : config->agent;
}

/* ---- dot products ---- */

#if ONEBIT_ARITHMETIC == ONEBIT_Q31

/* A number rounded to the nearest and saturated; halfway between two it may be either. */
typedef struct rounded {
    int32_t low, high;
} rounded;

static int32_t saturated(wide value)
{
    return value > INT32_MAX ? INT32_MAX : (value < INT32_MIN ? INT32_MIN : (int32_t)value);
}

static rounded dot_product(const onebit_real *row, const onebit_real *x, unsigned count, int places)
{
    wide sum = 0;
    for (unsigned i = 0; i < count; ++i) {
        sum += (wide)row[i] * x[i];
    }
    rounded result;
    if (places <= 0) {
        result.low = result.high = saturated(sum * ((wide)1 << -places));
    } else {
        wide unit = (wide)1 << places;
        wide rest = sum % unit;
        if (rest < 0) {
            rest += unit;
        }
        wide below = (sum - rest) / unit;
        result.low = saturated(below + (2 * rest > unit));
        result.high = saturated(below + (2 * rest >= unit));
    }
    return result;
}

static rounded stabilizing(const onebit_config *config, const onebit_real *x)
{
    return dot_product(config->stabilizing, x, config->state_count,
                       config->fraction_bits.stabilizing + config->fraction_bits.state -
                           config->fraction_bits.control);
}

static rounded compression(const onebit_config *config, const onebit_real *x)
{
    return dot_product(config->compression, x, config->state_count,
                       config->fraction_bits.compression + config->fraction_bits.state -
                           ONEBIT_NOISE_FRACTION_BITS);
}

static interval compressed(const onebit_config *config, const onebit_real *x)
{
    rounded z = compression(config, x);
    interval result = {in_noise_units(z.low), in_noise_units(z.high)};
    return result;
}

finiteness model_compressed_finiteness(const onebit_config *config, const onebit_real *x)
{
    (void)config;
    (void)x;
    return FINITE;
}

#else

/* A dot product to the roundings of its products and sums, in any order. */
typedef struct dot {
    long double value, magnitude, error;
    finiteness finite;
} dot;

static dot dot_product(const onebit_real *row, const onebit_real *x, unsigned count)
{
    dot result = {0, 0, 0, FINITE};
    for (unsigned i = 0; i < count; ++i) {
        if (!finite_number(x[i])) {
            result.finite = NOT_FINITE;
            return result;
        }
        long double product = (long double)row[i] * (long double)x[i];
        result.value += product;
        result.magnitude += fabsl(product);
    }
    if (result.magnitude > 0) {
        result.error = (count + 1) * (UNIT * result.magnitude + LEAST);
    }
    if (fabsl(result.value) > LARGEST + result.error) {
        result.finite = NOT_FINITE;
    } else if (result.magnitude + result.error >= LARGEST) {
        result.finite = PERHAPS_FINITE;
    }
    return result;
}

static interval compressed(const onebit_config *config, const onebit_real *x)
{
    dot z = dot_product(config->compression, x, config->state_count);
    interval result = {z.value - z.error, z.value + z.error};
    return result;
}

finiteness model_compressed_finiteness(const onebit_config *config, const onebit_real *x)
{
    return dot_product(config->compression, x, config->state_count).finite;
}

#endif

/* ---- messages ---- */

/* Of all words, in Q0.31. */
#define HALF 0x1p30L

interval model_probability(const onebit_config *config, const onebit_real *x, unsigned k)
{
    bool own = config->format.mode == ONEBIT_MODE_LINK && config->sent_thresholds != NULL;
    long double threshold = in_noise_units(own ? config->sent_thresholds[k] : config->threshold);
    interval z = compressed(config, x);
    if (z.low == threshold && z.high == threshold) {
        return (interval){HALF, HALF}; /* F(u) + F(-u) = 1 exactly */
    }
    /* F is compared in Q0.31, so it may be cut or rounded to that. */
    interval result = {
        (distribution(threshold - z.high) - DISTRIBUTION_ERROR) * 2 * HALF - 1,
        (distribution(threshold - z.low) + DISTRIBUTION_ERROR) * 2 * HALF + 1,
    };
#if ONEBIT_ARITHMETIC != ONEBIT_F64
    /* The table's F is never 0 or 1: either bit has a word. */
    result.low = fmaxl(result.low, 1);
    result.high = fminl(result.high, 2 * HALF - 1);
#endif
    return result;
}

codes model_receive(const onebit_config *config, model_time t, uint32_t heard,
                    const onebit_message *message, uint32_t linked, unsigned *neighbour)
{
    unsigned k = 0;
    while (k < config->neighbour_count && config->neighbours[k] != message->sender) {
        ++k;
    }
    *neighbour = k;
    if (k == config->neighbour_count ||
        (config->format.mode == ONEBIT_MODE_LINK && message->receiver != config->agent)) {
        return CODE(ONEBIT_REFUSED_UNKNOWN);
    }
    codes refusals = 0;
    if ((linked >> k & 1) == 0) {
        refusals |= CODE(ONEBIT_REFUSED_UNLINKED);
    }
    unsigned ahead = message->has_step ? (unsigned)((message->step + 128u - t % 128) % 128) : 0;
    if (ahead >= 64) {
        refusals |= CODE(ONEBIT_REFUSED_STALE);
    } else if (ahead >= 1) {
        refusals |= CODE(ONEBIT_REFUSED_EARLY);
    } else if (heard >> k & 1) {
        refusals |= CODE(ONEBIT_REFUSED_REPEATED);
    }
    return refusals != 0 ? refusals : CODE(ONEBIT_OK);
}

/* ---- estimates ---- */

bool model_gain(const onebit_config *config, model_time t, onebit_gain gain)
{
    long double coefficient = coefficient_value(config->estimator_gain);
    interval t_or_last = divisor(t);
    long double value = gain_value(gain);
#if ONEBIT_ARITHMETIC == ONEBIT_Q31
    long double least = 0;
    if (gain.mantissa >> 15 != 1) {
        return false;
    }
#else
    long double least = LEAST;
#endif
    return value >= coefficient / t_or_last.high * (1 - GAIN_ERROR) - least &&
           value <= coefficient / t_or_last.low * (1 + GAIN_ERROR) + least;
}

bool model_estimate(const onebit_config *config, const onebit_estimate *estimate)
{
    return fabsl(in_noise_units(estimate->value)) <= in_noise_units(config->bound);
}

const char *model_update(const onebit_config *config, model_time t, unsigned k, bool bit,
                         const onebit_estimate *before, const onebit_estimate *after)
{
    long double bound = in_noise_units(config->bound);
    long double threshold = in_noise_units(
        config->heard_thresholds != NULL ? config->heard_thresholds[k] : config->threshold);
    interval t_or_last = divisor(t);
    long double gain = coefficient_value(config->estimator_gain) / t_or_last.low;
    long double innovation = distribution(threshold - in_noise_units(before->value)) - bit;
    long double step = gain * innovation;
    long double error =
        fabsl(step) * (GAIN_ERROR + 0x1p-31L) + gain * (1 + GAIN_ERROR) * DISTRIBUTION_ERROR;
#if ONEBIT_ARITHMETIC == ONEBIT_Q31
    error += 0x1p-59L;            /* one rounding unit of the carry */
    long double place = 0x1p-27L; /* the carry is what follows the value's last place */
#else
    /* Innovation, product, sum with the carry and the carry's own: roundings of what is added. */
    error += 8 * UNIT * (fabsl(step) + fabsl((long double)before->carry)) + 2 * LEAST;
    long double place = 2 * UNIT * bound + LEAST;
#endif
    long double low = fminl(step - error, MOST_STEP);
    long double high = fmaxl(step + error, -MOST_STEP);
    /* By how much the estimate would have to move to the bounds. */
    long double up = bound - in_noise_units(before->value) - carry_value(before);
    long double down = -bound - in_noise_units(before->value) - carry_value(before);
    if (!model_estimate(config, after)) {
        return "an estimate left [-bound, bound]";
    }
    /* The projection's result is exact, and there is no carry to it. */
    if (after->carry == 0 && ((after->value == config->bound && high >= up) ||
                              (after->value == -config->bound && low <= down))) {
        return NULL;
    }
    if (low > up + place || high < down - place) {
        return "an estimate was not projected";
    }
    /* Values first: their difference is exact where carries matter. */
    long double moved = in_noise_units(after->value) - in_noise_units(before->value) +
                        (carry_value(after) - carry_value(before));
    return moved >= low && moved <= high ? NULL : "an estimate moved otherwise";
}

/* ---- control ---- */

#if ONEBIT_ARITHMETIC == ONEBIT_Q31

codes model_control(const onebit_config *config, model_time t, const onebit_estimate *estimates,
                    uint32_t summed, const onebit_real *x)
{
    (void)config;
    (void)t;
    (void)estimates;
    (void)summed;
    (void)x;
    return CODE(ONEBIT_OK);
}

static bool at_an_end(int32_t number)
{
    return number == INT32_MAX || number == INT32_MIN;
}

const char *model_control_result(const onebit_config *config, model_time t,
                                 const onebit_estimate *estimates, uint32_t summed,
                                 const onebit_real *x, onebit_real u, bool counted)
{
    rounded own = stabilizing(config, x);
    rounded z = compression(config, x);
    interval t_or_last = divisor(t + 1);
    long double gain = coefficient_value(config->control_gain) / t_or_last.low;
    const char *wrong = "u is another";
    for (unsigned which = 0; which < 4; ++which) {
        int32_t own_value = which & 1 ? own.high : own.low;
        int32_t z_value = which & 2 ? z.high : z.low;
        int64_t sum = 0;
        for (unsigned k = 0; k < config->neighbour_count; ++k) {
            if (summed >> k & 1) {
                sum += (int64_t)estimates[k].value - z_value;
            }
        }
        long double term = ldexpl(gain * (long double)sum,
                                  config->fraction_bits.control - ONEBIT_NOISE_FRACTION_BITS);
        /* One rounding of the term, to a unit of the control. */
        long double error = fabsl(term) * GAIN_ERROR + (sum != 0);
        long double low = own_value + term - error;
        long double high = own_value + term + error;
        /* A term that stands at an end of the range is u, whatever K1 x. */
        bool may_be_end = (u == INT32_MAX && term + error >= INT32_MAX) ||
                          (u == INT32_MIN && term - error <= INT32_MIN);
        bool within = term - error < INT32_MAX && term + error > INT32_MIN;
        bool sum_fits = (u >= low || u == INT32_MAX) && (u <= high || u == INT32_MIN);
        if (may_be_end || (within && sum_fits)) {
            bool end = at_an_end(own_value) || at_an_end(z_value) || at_an_end(u);
            if (end == counted) {
                return NULL;
            }
            wrong = "an end of a range was not counted, or no end was";
        }
    }
    return wrong;
}

#else

/* u, and by how much the arithmetic's roundings may move it. */
typedef struct control {
    long double value, error;
    finiteness finite;
} control;

static control control_of(const onebit_config *config, model_time t,
                          const onebit_estimate *estimates, uint32_t summed, const onebit_real *x)
{
    dot own = dot_product(config->stabilizing, x, config->state_count);
    dot z = dot_product(config->compression, x, config->state_count);
    control result = {0, 0, FINITE};
    interval t_or_last = divisor(t + 1);
    long double gain = coefficient_value(config->control_gain) / t_or_last.low;
    unsigned count = 0;
    long double sum = 0, magnitude = 0;
    for (unsigned k = 0; k < config->neighbour_count; ++k) {
        if (summed >> k & 1) {
            ++count;
            sum += in_noise_units(estimates[k].value) - z.value;
            magnitude += fabsl(in_noise_units(estimates[k].value)) + z.magnitude;
        }
    }
    long double sum_error = (count + 3) * UNIT * magnitude + count * (z.error + LEAST);
    long double gain_error = gain * (GAIN_ERROR + t_or_last.high / t_or_last.low - 1) + 2 * LEAST;
    long double term_error =
        (gain + gain_error) * sum_error + (gain_error + gain * UNIT) * fabsl(sum) + LEAST;
    result.value = own.value + gain * sum;
    result.error = own.error + term_error;
    result.error += 2 * UNIT * (fabsl(own.value) + gain * fabsl(sum) + result.error);
    if (fabsl(result.value) > LARGEST + result.error) {
        result.finite = NOT_FINITE;
    } else if (own.finite != FINITE || (count > 0 && z.finite != FINITE) ||
               magnitude + sum_error >= LARGEST ||
               own.magnitude + gain * magnitude + result.error >= LARGEST) {
        result.finite = PERHAPS_FINITE; /* a part of u may overflow on the way */
    }
    return result;
}

codes model_control(const onebit_config *config, model_time t, const onebit_estimate *estimates,
                    uint32_t summed, const onebit_real *x)
{
    for (unsigned i = 0; i < config->state_count; ++i) {
        if (!finite_number(x[i])) {
            return CODE(ONEBIT_STATE);
        }
    }
    switch (control_of(config, t, estimates, summed, x).finite) {
    case FINITE:
        return CODE(ONEBIT_OK);
    case NOT_FINITE:
        return CODE(ONEBIT_STATE);
    default:
        return CODE(ONEBIT_OK) | CODE(ONEBIT_STATE);
    }
}

const char *model_control_result(const onebit_config *config, model_time t,
                                 const onebit_estimate *estimates, uint32_t summed,
                                 const onebit_real *x, onebit_real u, bool counted)
{
    control wanted = control_of(config, t, estimates, summed, x);
    if (counted) {
        return "saturation was counted, which is q31's";
    }
    if (!finite_number(u)) {
        return "u is not finite";
    }
    return fabsl((long double)u - wanted.value) <= wanted.error ? NULL : "u is another";
}

#endif
