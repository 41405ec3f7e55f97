/*
 * What Frama-C's Eva runs (tests/proof/prove.py, by tests/test_proof.py in CI): every verb of the
 * q31 library on unknown inputs. Eva follows all of them at once; where it names no alarm there is
 * no input in these ranges with a signed overflow, an undefined shift, a division by zero, an
 * access out of bounds or a read of what was never written.
 *
 * Assumed, and nowhere else: what any_config, valid_config and any_agent say, and of the rows what
 * lemmas.c proves of those that onebit_check accepts. Arrays end where the counts say, so that one
 * element too far is an alarm. What any_agent assumes is proved of what the library leaves behind
 * (`assert` in advance, with which start and control end, and in update), so it holds after any
 * calls in any order.
 *
 * Eva knows a range of each variable; where a relation between two matters, it is cut into pieces
 * here, or in the copy of lib/ that prove.py makes.
 */
#include "contracts.h"

#include "onebit_agent.c"
#include "onebit_cdf_table.c"
#include "onebit_check.c"
#include "onebit_frame.c"
#include "onebit_random.c"
#include "onebit_status.c"
#include "onebit_valid.c"

#include <__fc_builtin.h>

/* What onebit_products reads was written; Eva takes its contract in place of its text. */
/*@ requires \initialized(left + (0 .. count - 1)) && \initialized(right + (0 .. count - 1)); */
static inline int64_t onebit_products(const int32_t *left, const int32_t *right, unsigned count);

/* Unknown anew at every read. */
static volatile uint32_t word;
static volatile uint16_t half;
static volatile uint8_t byte;
static volatile int32_t number;
static volatile int8_t small;

static uint32_t neighbours[ONEBIT_NEIGHBOURS_MAX];
static int32_t heard_thresholds[ONEBIT_NEIGHBOURS_MAX];
static int32_t sent_thresholds[ONEBIT_NEIGHBOURS_MAX];
static int32_t initial[ONEBIT_NEIGHBOURS_MAX];
static onebit_estimate estimates[ONEBIT_NEIGHBOURS_MAX];
static int32_t stabilizing[ONEBIT_STATES_MAX];
static int32_t compression[ONEBIT_STATES_MAX];
static int32_t states[ONEBIT_STATES_MAX];

static onebit_config config;
static onebit_agent agent;

/* The last elements of an array of `most`. */
#define LAST(array, most, count) ((array) + ((most) - (count)))
#define LAST_NEIGHBOURS(array, count) LAST(array, ONEBIT_NEIGHBOURS_MAX, count)
#define LAST_STATES(array, count) LAST(array, ONEBIT_STATES_MAX, count)

static int32_t between(int32_t least, int32_t most)
{
    return (int32_t)Frama_C_long_interval(least, most);
}

static uint32_t between_words(uint32_t least, uint32_t most)
{
    return (uint32_t)Frama_C_unsigned_long_interval(least, most);
}

/* Any bits at all, but for counts and pointers. */
static void any_config(unsigned neighbour_count, unsigned state_count)
{
    for (unsigned k = 0; k < ONEBIT_NEIGHBOURS_MAX; ++k) {
        heard_thresholds[k] = number;
        sent_thresholds[k] = number;
    }
    config = (onebit_config){
        .agent = word,
        .neighbours = LAST_NEIGHBOURS(neighbours, neighbour_count),
        .neighbour_count = (uint8_t)neighbour_count,
        .state_count = (uint8_t)state_count,
        .fraction_bits = {small, small, small, small},
        .format = {byte, byte, half, half},
        .stabilizing = LAST_STATES(stabilizing, state_count),
        .compression = LAST_STATES(compression, state_count),
        .threshold = number,
        .bound = number,
        .estimator_gain = {word, half},
        .control_gain = {word, half},
        .start = word,
        .seed = word,
        .run = word,
        .first_link = word,
        .heard_thresholds = byte ? LAST_NEIGHBOURS(heard_thresholds, neighbour_count) : NULL,
        .sent_thresholds = byte ? LAST_NEIGHBOURS(sent_thresholds, neighbour_count) : NULL,
    };
}

/*
 * |threshold| + bound <= 4 for every threshold, in pieces of 4/5 by the bound: up to 4 less the
 * piece's beginning, and each |threshold| up to the piece's end; their sum stays below 4.8, within
 * the table of F.
 */
#define PIECES 5
#define THRESHOLD(piece) (((piece) + 1) * 107374183L) /* 4/5 in Q4.27, rounded up */
#define BOUND(piece) (536870912L - (piece)*107374182L)

/* Within the ranges that onebit_types.h documents and onebit_check accepts. */
static void valid_config(unsigned neighbour_count, unsigned state_count, int piece)
{
    any_config(neighbour_count, state_count);
    config.fraction_bits.stabilizing = (int8_t)between(0, 46);
    config.fraction_bits.compression = (int8_t)between(0, 46);
    config.fraction_bits.state = (int8_t)between(0, 31);
    config.fraction_bits.control = (int8_t)between(0, 31);
    config.format.mode = (uint8_t)between(ONEBIT_MODE_BROADCAST, ONEBIT_MODE_LINK);
    config.format.encoding = (uint8_t)between(ONEBIT_ENCODING_PAYLOAD, ONEBIT_ENCODING_NONE);
    config.threshold = between(-THRESHOLD(piece), THRESHOLD(piece));
    for (unsigned k = 0; k < ONEBIT_NEIGHBOURS_MAX; ++k) {
        heard_thresholds[k] = between(-THRESHOLD(piece), THRESHOLD(piece));
        sent_thresholds[k] = between(-THRESHOLD(piece), THRESHOLD(piece));
    }
    config.bound = between(1, BOUND(piece));
    config.estimator_gain.value = between_words(0x80000000, UINT32_MAX);
    config.estimator_gain.fraction_bits = (uint16_t)between(15, 62);
    config.control_gain.value = between_words(0x80000000, UINT32_MAX);
    config.control_gain.fraction_bits = (uint16_t)between(0, 62);
    config.start = between_words(1, UINT32_MAX - 1);
}

/* An agent of any bits, as memory may come to hold. */
static void any_agent(unsigned neighbour_count)
{
    agent.estimates = LAST_NEIGHBOURS(estimates, neighbour_count);
    agent.clock = word;
    agent.heard = word;
    agent.gain = (onebit_gain){half, (int16_t)number};
    agent.wrapped = byte & 1;
    agent.saturated = half;
    for (unsigned k = 0; k < neighbour_count; ++k) {
        agent.estimates[k] = (onebit_estimate){number, word};
    }
    for (unsigned k = 0; k < ONEBIT_REFUSALS; ++k) {
        agent.refused[k] = half;
    }
}

/*
 * The gain's places. In truth from -14: below it a mantissa were rounded up to 2^16 that the
 * largest estimator gain, 2^16, does not give; Eva's ranges do not tell.
 */
#define PLACES_FIRST (-15)
#define PLACES_LAST 65

/* A started agent after any calls. */
static void valid_agent(unsigned neighbour_count, int piece)
{
    any_agent(neighbour_count);
    agent.gain.places = (int16_t)between(PLACES_FIRST, PLACES_LAST);
    for (unsigned k = 0; k < neighbour_count; ++k) {
        agent.estimates[k].value = between(-BOUND(piece), BOUND(piece));
    }
}

/* A configuration of any bits, and memory that was never written. */
static void check_and_start(unsigned neighbour_count, unsigned state_count)
{
    onebit_agent unwritten;
    onebit_estimate unwritten_estimates[ONEBIT_NEIGHBOURS_MAX];
    any_config(neighbour_count, state_count);
    if (onebit_start(&config, &unwritten, LAST_NEIGHBOURS(unwritten_estimates, neighbour_count),
                     byte ? LAST_NEIGHBOURS(initial, neighbour_count) : NULL) == ONEBIT_OK) {
        //@ assert gain: PLACES_FIRST <= unwritten.gain.places <= PLACES_LAST;
        Frama_C_show_each_start();
    }
}

/* Counts of any size, and no arrays perhaps. */
static void check(void)
{
    any_config(ONEBIT_NEIGHBOURS_MAX, ONEBIT_STATES_MAX);
    config.neighbour_count = byte;
    config.state_count = byte;
    if (byte) {
        config.neighbours = NULL;
    }
    if (byte) {
        config.stabilizing = NULL;
    }
    if (byte) {
        config.compression = NULL;
    }
    if (onebit_check(byte ? &config : NULL) == ONEBIT_OK) {
        Frama_C_show_each_check();
    }
}

static void send(unsigned neighbour_count, unsigned state_count)
{
    bool bit;
    onebit_message message;
    onebit_frame frame;
    const int32_t *x = LAST_STATES(states, state_count);
    valid_config(neighbour_count, state_count, PIECES - 1);
    valid_agent(neighbour_count, 0);
    if (onebit_encode(&config, x, half, word, &bit) == ONEBIT_OK) {
        Frama_C_show_each_encode(bit);
    }
    if (onebit_send_message(&config, &agent, x, half, &message) == ONEBIT_OK) {
        Frama_C_show_each_send_message(message.bit);
    }
    if (onebit_send(&config, &agent, x, half, &frame) == ONEBIT_OK) {
        Frama_C_show_each_send(frame.data[0]);
    }
}

/* The only one that writes an estimate once it is started. */
static void update(int piece)
{
    valid_config(1, 1, piece);
    valid_agent(1, piece);
    onebit_update(agent.estimates, &agent.gain, config.threshold, &config.bound, byte & 1);
    //@ assert estimate: -BOUND(piece) <= agent.estimates->value <= BOUND(piece);
    Frama_C_show_each_update();
}

static void receive(unsigned neighbour_count, int piece)
{
    const onebit_message message = {word, word, byte, byte & 1, byte & 1};
    const onebit_frame frame = {word, byte, byte, {byte, byte, byte, byte, byte, byte, byte, byte}};
    onebit_message decoded;
    valid_config(neighbour_count, 1, piece);
    valid_agent(neighbour_count, piece);
    if (onebit_receive_message(&config, &agent, &message, word) == ONEBIT_OK) {
        Frama_C_show_each_receive_message();
    }
    valid_agent(neighbour_count, piece);
    if (onebit_receive(&config, &agent, &frame, word, byte ? &decoded : NULL) == ONEBIT_OK) {
        Frama_C_show_each_receive();
    }
}

static void control(unsigned neighbour_count, unsigned state_count)
{
    int32_t u;
    valid_config(neighbour_count, state_count, PIECES - 1);
    valid_agent(neighbour_count, 0);
    if (onebit_control(&config, &agent, LAST_STATES(states, state_count), word, &u) == ONEBIT_OK) {
        Frama_C_show_each_control(u);
    }
}

/* Any steps from any agent: the gain that it gets is what valid_agent assumes. */
static void advance(void)
{
    valid_config(1, 1, 0);
    any_agent(1);
    if (onebit_advance(&config, &agent, number) == ONEBIT_OK) {
        //@ assert gain: PLACES_FIRST <= agent.gain.places <= PLACES_LAST;
        Frama_C_show_each_advance();
    }
}

/* Of an agent of any bits, started or not. */
static void valid(unsigned neighbour_count)
{
    valid_config(neighbour_count, 1, 0);
    any_agent(neighbour_count);
    if (byte) {
        agent.estimates = NULL;
    }
    if (onebit_valid(&config, &agent)) {
        Frama_C_show_each_valid();
    }
}

/* What needs no agent. */
static void frames_and_words(void)
{
    const onebit_format format = {byte, byte, half, half};
    onebit_message message = {word, word, byte, byte & 1, byte & 1};
    onebit_frame frame = {word, byte, byte, {byte, byte, byte, byte, byte, byte, byte, byte}};
    uint8_t step;
    if (onebit_frame_is_sync(&format, &frame, &step)) {
        Frama_C_show_each_is_sync(step);
    }
    if (onebit_frame_decode(&format, &frame, &message) == ONEBIT_OK) {
        Frama_C_show_each_decode();
    }
    if (onebit_frame_encode(&format, &message, &frame) == ONEBIT_OK) {
        Frama_C_show_each_frame_encode();
    }
    onebit_frame_sync(&format, word, &frame);
    Frama_C_show_each_sync(frame.data[0]);
    Frama_C_show_each_word(onebit_random_word(word, word, word, word));
    Frama_C_show_each_name(onebit_status_name((onebit_status)byte));
}

int main(void)
{
    for (unsigned k = 0; k < ONEBIT_NEIGHBOURS_MAX; ++k) {
        neighbours[k] = word;
        initial[k] = number;
    }
    for (unsigned k = 0; k < ONEBIT_STATES_MAX; ++k) {
        stabilizing[k] = number;
        compression[k] = number;
        states[k] = number;
    }
    frames_and_words();
    check();
    advance();
    for (int piece = 0; piece < PIECES; ++piece) {
        update(piece);
    }
    for (unsigned n = 1; n <= ONEBIT_STATES_MAX; ++n) {
        check_and_start(ONEBIT_NEIGHBOURS_MAX, n);
        send(ONEBIT_NEIGHBOURS_MAX, n);
        control(ONEBIT_NEIGHBOURS_MAX, n);
    }
    for (unsigned count = 1; count <= ONEBIT_NEIGHBOURS_MAX; ++count) {
        check_and_start(count, ONEBIT_STATES_MAX);
        send(count, ONEBIT_STATES_MAX);
        control(count, ONEBIT_STATES_MAX);
        valid(count);
        for (int piece = 0; piece < PIECES; ++piece) {
            receive(count, piece);
        }
    }
    Frama_C_show_each_end();
    return 0;
}
