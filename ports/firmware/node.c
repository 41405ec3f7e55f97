/*
 * One agent of the seven aircraft (sim/scenarios/aircraft-integer.yaml) as a node on a serial line
 * that speaks slcan, as its host's adapter would: the other six and the SYNC that begins each step
 * come over the line. Its machine is the scenario's in integers. At the stop that ends the group it
 * prints what it did, with the checksum of all its estimates and controls as aircraft.c makes it.
 */
#include "alignment.h"
#include "canopen.h"
#include "channel.h"
#include "checksum.h"
#include "integer_plant.h"
#include "onebit_config.h"
#include "onebit_random.h"
#include "platform.h"
#include "print.h"
#include "uart.h"

#include <stddef.h>

#define CONFIG (&onebit_config_agent_3)
#define STATES ONEBIT_CONFIG_STATES

/* Key of the random words, the host's by default. */
#define SEED 1u
#define RUN 0u

static const struct integer_plant plant = {
    .state_count = STATES,
    .A_fraction_bits = ONEBIT_CONFIG_PLANT_A_FRACTION_BITS,
    .B_fraction_bits = ONEBIT_CONFIG_PLANT_B_FRACTION_BITS,
    .state_fraction_bits = ONEBIT_CONFIG_STATE_FRACTION_BITS,
    .control_fraction_bits = ONEBIT_CONFIG_CONTROL_FRACTION_BITS,
    .A = onebit_config_plant_A,
    .B = onebit_config_plant_B,
};

struct node {
    struct transport transport;
    onebit_agent agent;
    onebit_link links[ONEBIT_CONFIG_NEIGHBOURS];
    int32_t x[STATES];
    struct alignment alignment;
    bool in_step;
    bool to_send; /* `frame` has yet to leave */
    onebit_frame frame;
    uint32_t steps;
    uint32_t late; /* frames that did not leave in their step */
    uint32_t aligned;
    uint32_t checksum;
};

/* --- the hooks of the channel: the UART --- */

static bool put(void *context, uint8_t byte)
{
    (void)context;
    return uart_put(byte);
}

/* Nothing here looks at times. */
static bool take(void *context, uint8_t *byte, uint64_t *nanoseconds)
{
    (void)context;
    *nanoseconds = 0;
    return uart_take(byte);
}

/* --- steps --- */

/* A frame that finds no room is tried again until its step is over. */
static void send(struct node *node)
{
    if (node->to_send &&
        node->transport.send(node->transport.context, &node->frame) == TRANSPORT_DONE) {
        node->to_send = false;
    }
}

static void begin_step(struct node *node)
{
    uint32_t t = node->agent.clock;
    onebit_message message = {.sender = CONFIG->agent, .step = (uint8_t)(t % ONEBIT_STEP_MODULUS)};
    onebit_encode(CONFIG, node->x, onebit_random_word(SEED, RUN, CONFIG->agent, t), &message.bit);
    onebit_frame_encode(&CONFIG->format, &message, &node->frame);
    node->to_send = true;
    node->in_step = true;
}

static void end_step(struct node *node)
{
    int32_t u = 0;
    node->late += node->to_send;
    node->to_send = false;
    onebit_control(CONFIG, &node->agent, node->x, &u);
    for (unsigned place = 0; place < CONFIG->neighbour_count; ++place) {
        node->checksum = checksum(node->checksum, node->links[place].estimate);
    }
    node->checksum = checksum(node->checksum, u);
    integer_plant_step(&plant, node->x, u);
    ++node->steps;
    node->in_step = false;
    int32_t steps =
        alignment_end_step(&node->alignment, CONFIG->agent, node->agent.clock, CONFIG->start + 1u);
    if (steps != 0) {
        onebit_advance(CONFIG, &node->agent, steps);
        ++node->aligned;
    }
}

static void hear(struct node *node, const onebit_frame *frame)
{
    onebit_message message;
    if (onebit_frame_decode(&CONFIG->format, frame, &message) == ONEBIT_OK) {
        for (unsigned place = 0; place < CONFIG->neighbour_count; ++place) {
            if (CONFIG->neighbours[place] == message.sender) {
                alignment_hear(&node->alignment, node->agent.clock, &message);
            }
        }
    }
    onebit_receive(CONFIG, &node->agent, frame); /* counts what it refuses */
}

/* --- at the end --- */

static void tell(const char *what, uint32_t number)
{
    print_text(what);
    print_decimal(number);
}

static void report(const struct node *node, const struct channel *channel)
{
    uint32_t refused = 0;
    uint32_t dropped = 0;
    for (unsigned k = 0; k < ONEBIT_REFUSALS; ++k) {
        /* Other agents than the neighbours are on the bus too. */
        refused += k == 0 ? 0 : node->agent.refused[k];
    }
    for (unsigned k = 0; k < SLCAN_DROPS; ++k) {
        dropped += channel->parser.dropped[k];
    }
    tell("agent ", CONFIG->agent);
    tell(" steps ", node->steps);
    print_text(" checksum ");
    print_hexadecimal(~node->checksum);
    print_text(" states");
    for (unsigned state = 0; state < STATES; ++state) {
        print_text(" ");
        print_hexadecimal((uint32_t)node->x[state]);
    }
    tell(" late ", node->late);
    tell(" refused ", refused);
    tell(" aligned ", node->aligned);
    tell(" lines_dropped ", dropped);
    tell(" bytes_lost ", uart_lost());
    print_text("\n");
}

int main(void)
{
    static struct channel channel;
    static struct node node = {.checksum = CHECKSUM_BEGIN};
    const struct channel_hooks uart = {.context = NULL, .put = put, .take = take};
    uart_start();
    channel_begin_device(&channel, &uart);
    node.transport = channel_transport(&channel);
    for (unsigned state = 0; state < STATES; ++state) {
        node.x[state] = onebit_config_initial_states[(CONFIG->agent - 1) * STATES + state];
    }
    if (onebit_start(CONFIG, &node.agent, node.links, NULL) != ONEBIT_OK) {
        print_text("the library refuses the configuration\n");
        platform_exit(1);
    }
    /* After the stop it serves its line until the host closes it. */
    for (bool stopped = false; !stopped || channel.open;) {
        onebit_frame frame;
        uint64_t time;
        send(&node);
        if (node.transport.receive(node.transport.context, &frame, &time) != TRANSPORT_DONE) {
            continue; /* a board that has nothing else to do sleeps here until an interrupt */
        }
        stopped = stopped || canopen_is_stop(&frame, CONFIG->agent);
        bool sync = onebit_frame_is_sync(&frame);
        if ((stopped || sync) && node.in_step) {
            end_step(&node);
        }
        if (sync && !stopped) {
            begin_step(&node);
        } else if (node.in_step) {
            hear(&node, &frame);
        }
    }
    while (!channel_flush(&channel)) {
    }
    report(&node, &channel);
    platform_exit(0);
}
