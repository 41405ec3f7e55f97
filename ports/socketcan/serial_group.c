/*
 * The group of serial_group.h. Reads the clock, its line and signals; writes CSV, its summary, and
 * on standard error what a person must know, a line each.
 */
#include "serial_group.h"

#include "canopen.h"
#include "chain.h"
#include "command_line.h"
#include "loop.h"
#include "machine.h"
#include "serial.h"
#include "summary.h"

#include <inttypes.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define KNOCK 500000000u           /* nanoseconds between two attempts to open the channel */
#define KNOCKS 6                   /* then it goes on: some adapters never answer */
#define MISSING (10 * LOOP_SECOND) /* a step in lock step waits no longer for its messages */
/* What the end may take, of a socket whose other end answers and of anything else. */
#define SOCKET_END (60 * LOOP_SECOND)
#define OTHER_END LOOP_SECOND

struct member {
    uint32_t agent;
    struct machine *machine;
    FILE *csv;
    onebit_frame frames[MACHINE_FRAMES_MAX]; /* of this step, for the line */
    uint32_t frame_count;
    uint32_t frame_next;
    uint64_t sent;
    uint64_t late;
    uint64_t frames_in;
};

struct group {
    const struct nodes *nodes;
    const struct machine_verbs *verbs;
    struct member *members;
    bool *own; /* of agent number k - 1: it is one of the members */
    struct serial serial;
    struct channel channel;
    struct transport transport;
    struct chain chain;
    bool in_step;
    bool sync_waits;   /* the line has not taken this step's SYNC yet */
    uint64_t next;     /* when the step ends at the latest, monotonic */
    uint32_t expected; /* messages from the line in this step, lock step */
    uint32_t heard;
    uint64_t steps;
    uint64_t late;       /* SYNC that found no room in their step and were withdrawn */
    uint64_t incomplete; /* steps in lock step whose messages did not all come */
    uint64_t deadline_misses;
    uint64_t frames_in;
    uint64_t other_masters; /* SYNC from the line */
};

/* What is left to do at the end. */
enum closing {
    STOP,  /* stop the nodes behind the line */
    ASK,   /* make sure that it was heard */
    CLOSE, /* close the channel */
    END,   /* and make sure of that */
    ENDED
};

static bool lock_step(const struct group *group)
{
    return !(group->nodes->period > 0);
}

/* --- the line --- */

/* Until bytes come, bytes can go that the line did not take, a signal, or the time. */
static void wait_for_line(struct group *group, uint64_t until)
{
    uint64_t now = loop_now(CLOCK_MONOTONIC);
    channel_flush(&group->channel);
    bool written = serial_flush(&group->serial);
    struct pollfd file = {.fd = group->serial.handle,
                          .events = (short)(written ? POLLIN : POLLIN | POLLOUT)};
    if (!group->serial.down) {
        loop_wait(&file, 1, until > now ? until - now : 0);
    }
}

/* Opens the channel; whoever is behind it may still be starting. */
static void open_channel(struct group *group)
{
    /* LAWICEL's numbers of bit rates. */
    static const double bit_rates[] = {1e4, 2e4, 5e4, 1e5, 1.25e5, 2.5e5, 5e5, 8e5, 1e6};
    uint8_t bit_rate = 0;
    while (bit_rate < 8 && bit_rates[bit_rate] < group->nodes->scenario->bitrate) {
        ++bit_rate;
    }
    for (int k = 0; k < KNOCKS && !group->channel.heard && !loop_ended(); ++k) {
        uint64_t until = loop_now(CLOCK_MONOTONIC) + KNOCK;
        channel_open(&group->channel, bit_rate);
        while (loop_now(CLOCK_MONOTONIC) < until && !group->channel.heard && !group->serial.down &&
               !loop_ended()) {
            onebit_frame frame;
            uint64_t time;
            wait_for_line(group, until);
            /* Frames of before the first step are nobody's. */
            while (group->transport.receive(group->transport.context, &frame, &time) ==
                   TRANSPORT_DONE) {
            }
        }
    }
    if (!group->channel.heard && !group->serial.down && !loop_ended()) {
        fprintf(stderr, "onebit-node: %s: nobody answers; going on\n", group->nodes->interface);
    }
}

/* What waits for the line, in order. */
static void send_frames(struct group *group)
{
    if (group->sync_waits) {
        onebit_frame frame;
        onebit_frame_sync(&group->nodes->scenario->format,
                          group->nodes->scenario->t0 + 1u + (uint32_t)group->steps, &frame);
        group->sync_waits =
            group->transport.send(group->transport.context, &frame) != TRANSPORT_DONE;
    }
    for (uint32_t k = 0; k < group->nodes->agent_count && !group->sync_waits; ++k) {
        struct member *member = &group->members[k];
        while (member->frame_next < member->frame_count) {
            if (group->transport.send(group->transport.context,
                                      &member->frames[member->frame_next]) != TRANSPORT_DONE) {
                return;
            }
            ++member->frame_next;
            ++member->sent;
        }
    }
}

/* --- steps --- */

/* Messages of a step that come from the line. */
static uint32_t messages_from_line(struct group *group, uint32_t t)
{
    const struct scenario *scenario = group->nodes->scenario;
    const struct topology *topology = &scenario->topology;
    uint32_t count = 0;
    if (scenario->format.mode != ONEBIT_MODE_LINK) {
        return topology->agent_count - group->nodes->agent_count;
    }
    const uint8_t *linked =
        &topology->linked[(size_t)chain_graph(&group->chain, t) * topology->link_count];
    for (uint32_t agent = 0; agent < topology->agent_count; ++agent) {
        for (uint32_t link = topology->first_link[agent];
             link < topology->first_link[agent + 1] && !group->own[agent]; ++link) {
            count += linked[link];
        }
    }
    return count;
}

/* What a node's filters let through (node.c): all but messages of and to others. */
static bool concerns(const struct group *group, const struct member *member,
                     const onebit_frame *frame)
{
    onebit_message message;
    const uint32_t *neighbours;
    uint32_t count = group->verbs->neighbours(member->machine, &neighbours);
    if (onebit_frame_decode(&group->nodes->scenario->format, frame, &message) != ONEBIT_OK) {
        return true; /* to be refused and counted */
    }
    for (uint32_t k = 0; k < count; ++k) {
        if (neighbours[k] == message.sender) {
            return message.receiver == 0 || message.receiver == member->agent;
        }
    }
    return false;
}

static void deliver(struct group *group, const onebit_frame *frame)
{
    for (uint32_t k = 0; k < group->nodes->agent_count; ++k) {
        struct member *member = &group->members[k];
        if (concerns(group, member, frame)) {
            ++member->frames_in;
            group->verbs->hear(member->machine, frame);
        }
    }
}

static void begin_step(struct group *group)
{
    uint32_t t = group->nodes->scenario->t0 + 1u + (uint32_t)group->steps;
    group->in_step = true;
    group->sync_waits = true;
    group->heard = 0;
    group->expected = lock_step(group) ? messages_from_line(group, t) : 0;
    for (uint32_t k = 0; k < group->nodes->agent_count; ++k) {
        struct member *member = &group->members[k];
        /* As SYNC, which goes to the line only, tells the others. */
        group->verbs->align(member->machine, (uint8_t)(t % ONEBIT_STEP_MODULUS));
        member->frame_count = group->verbs->begin(member->machine, member->frames);
        member->frame_next = 0;
    }
    for (uint32_t k = 0; k < group->nodes->agent_count; ++k) {
        for (uint32_t frame = 0; frame < group->members[k].frame_count; ++frame) {
            deliver(group, &group->members[k].frames[frame]);
        }
    }
}

static void end_step(struct group *group)
{
    group->late += group->sync_waits;
    group->sync_waits = false;
    group->in_step = false;
    ++group->steps;
    for (uint32_t k = 0; k < group->nodes->agent_count; ++k) {
        struct member *member = &group->members[k];
        member->late += member->frame_count - member->frame_next;
        member->frame_count = 0;
        member->frame_next = 0;
        group->verbs->end(member->machine, member->csv);
    }
}

/* Whether a frame is a message of this step from an agent behind the line. */
static bool is_expected(const struct group *group, const onebit_frame *frame)
{
    const struct scenario *scenario = group->nodes->scenario;
    onebit_message message;
    if (onebit_frame_decode(&scenario->format, frame, &message) != ONEBIT_OK) {
        return false;
    }
    uint32_t t = scenario->t0 + 1u + (uint32_t)group->steps;
    return message.sender <= scenario->topology.agent_count && !group->own[message.sender - 1] &&
           (!message.has_step || message.step == t % ONEBIT_STEP_MODULUS);
}

static void receive_frames(struct group *group)
{
    onebit_frame frame;
    uint64_t time;
    uint8_t told;
    for (int k = 0; k < LOOP_BATCH && group->transport.receive(group->transport.context, &frame,
                                                               &time) == TRANSPORT_DONE;
         ++k) {
        ++group->frames_in;
        if (onebit_frame_is_sync(&group->nodes->scenario->format, &frame, &told)) {
            if (group->other_masters++ == 0) {
                fputs("onebit-node: another master sends SYNC too\n", stderr);
            }
        } else if (group->in_step) {
            group->heard += is_expected(group, &frame);
            deliver(group, &frame);
        }
    }
}

/* Whether all that belongs to this step has gone and come. */
static bool complete(const struct group *group)
{
    bool all_sent = !group->sync_waits;
    for (uint32_t k = 0; k < group->nodes->agent_count; ++k) {
        all_sent = all_sent && group->members[k].frame_next == group->members[k].frame_count;
    }
    return all_sent && group->heard >= group->expected;
}

static bool step_over(const struct group *group, uint64_t now)
{
    return now >= group->next || (lock_step(group) && complete(group));
}

static void set_next(struct group *group, uint64_t now)
{
    if (lock_step(group)) {
        group->next = now + MISSING;
        return;
    }
    uint64_t period = (uint64_t)(group->nodes->period * LOOP_SECOND);
    if (now - group->next > period / 2) {
        /* Nodes would refuse a next SYNC that keeps to the old times as too soon. */
        ++group->deadline_misses;
        group->next = now;
    }
    group->next += period;
}

static void run(struct group *group)
{
    bool status_line = isatty(STDERR_FILENO) != 0;
    uint64_t status_time = 0;
    group->next = loop_now(CLOCK_MONOTONIC);
    while (!loop_ended() && !group->serial.down) {
        uint64_t now = loop_now(CLOCK_MONOTONIC);
        if (group->in_step && step_over(group, now)) {
            group->incomplete += lock_step(group) && !complete(group);
            end_step(group);
        }
        if (!group->in_step) {
            if (group->nodes->steps != 0 && group->steps >= group->nodes->steps) {
                break;
            }
            set_next(group, now);
            begin_step(group);
        }
        send_frames(group);
        if (status_line && now >= status_time) {
            status_time = now + LOOP_STATUS;
            fprintf(stderr, "\r\033[KSYNC %" PRIu64, group->steps);
        }
        receive_frames(group);
        if (!step_over(group, now)) {
            wait_for_line(group, group->next);
        }
    }
    /* A signal came in a step: the stop will end it behind the line too. */
    if (group->in_step && !group->sync_waits) {
        end_step(group);
    }
    if (status_line) {
        fputs("\r\033[K", stderr);
    }
}

/* Does one thing after the other until one cannot be done yet; then it is to be called again. */
static void close_channel(struct group *group, enum closing *closing)
{
    struct channel *channel = &group->channel;
    onebit_frame frame;
    canopen_stop_all(&frame);
    if (*closing == STOP &&
        group->transport.send(group->transport.context, &frame) == TRANSPORT_DONE) {
        *closing = ASK;
    }
    if (*closing == ASK && channel_ask_version(channel)) {
        *closing = CLOSE;
    }
    if (*closing == CLOSE && channel->version_told) {
        channel->heard = false;
        *closing = channel_close(channel) ? END : CLOSE;
    }
    if (*closing == END && channel->heard) {
        *closing = ENDED;
    }
}

/*
 * Tells the nodes behind the line that it is over, and an adapter to leave the bus. What an
 * emulator has not read when its socket is closed is lost, so this waits for the answers; a
 * terminal keeps what was written, and who behind it does not answer is not waited for. False if
 * the line went down before the stop was written.
 */
static bool say_stop(struct group *group)
{
    bool patient = group->serial.is_socket && group->channel.heard;
    uint64_t limit = patient ? SOCKET_END : OTHER_END;
    uint64_t until = loop_now(CLOCK_MONOTONIC) + limit;
    enum closing closing = STOP;
    onebit_frame frame;
    uint64_t time;
    bool written = false;
    while (closing != ENDED && !group->serial.down && loop_now(CLOCK_MONOTONIC) < until) {
        close_channel(group, &closing);
        channel_flush(&group->channel);
        written = (serial_flush(&group->serial) && closing > ASK) || written;
        /* Messages are nobody's any more. */
        while (group->transport.receive(group->transport.context, &frame, &time) ==
               TRANSPORT_DONE) {
        }
        usleep(LOOP_RETRY / 1000);
    }
    if (closing < END) { /* no answer, but an adapter may have taken all the same */
        channel_close(&group->channel);
        serial_flush(&group->serial);
    }
    return written;
}

/* --- what is told --- */

static struct summary summary_of(const struct group *group, const struct member *member,
                                 double seconds)
{
    struct summary summary = {
        .nodes = group->nodes,
        .agent = member->agent,
        .ended = loop_ended() ? "signal" : "steps",
        .seconds = seconds,
        .frames_out = member->sent,
        .frames_in = member->frames_in,
        .syncs = group->steps,
        .late = member->late,
    };
    group->verbs->report(member->machine, &summary.report);
    return summary;
}

static uint64_t dropped_lines(const struct group *group)
{
    uint64_t sum = 0;
    for (int k = 0; k < SLCAN_DROPS; ++k) {
        sum += group->channel.parser.dropped[k];
    }
    return sum;
}

static bool summarize(const struct group *group, double seconds, struct problem *problem)
{
    const struct nodes *nodes = group->nodes;
    const struct channel_counts *counts = &group->channel.counts;
    cJSON *object = cJSON_CreateObject();
    cJSON *agents = cJSON_AddArrayToObject(object, "agents");
    for (uint32_t k = 0; k < nodes->agent_count; ++k) {
        struct summary summary = summary_of(group, &group->members[k], seconds);
        if (nodes->json) {
            cJSON_AddItemToArray(agents, summary_object(&summary));
        } else {
            summary_print(&summary);
        }
    }
    if (nodes->json) {
        cJSON *master = cJSON_AddObjectToObject(object, "master");
        cJSON_AddNumberToObject(master, "syncs", (double)group->steps);
        cJSON_AddNumberToObject(master, "late", (double)group->late);
        cJSON_AddNumberToObject(master, "incomplete", (double)group->incomplete);
        cJSON_AddNumberToObject(master, "deadline_misses", (double)group->deadline_misses);
        cJSON_AddNumberToObject(master, "other_masters", (double)group->other_masters);
        cJSON *line = cJSON_AddObjectToObject(object, "line");
        cJSON_AddNumberToObject(line, "frames_in", (double)group->frames_in);
        cJSON_AddNumberToObject(line, "dropped", (double)dropped_lines(group));
        cJSON_AddNumberToObject(line, "refused", counts->refused);
        cJSON_AddNumberToObject(line, "full", counts->full);
        summary_print_object(object);
    } else {
        printf("SYNC sent %" PRIu64 ", late %" PRIu64 ", incomplete steps %" PRIu64
               ", deadline misses %" PRIu64 ", of other masters %" PRIu64 ", %.3f s\n",
               group->steps, group->late, group->incomplete, group->deadline_misses,
               group->other_masters, seconds);
        printf("line: frames in %" PRIu64 ", lines dropped %" PRIu64 ", refused %u\n",
               group->frames_in, dropped_lines(group), (unsigned)counts->refused);
    }
    cJSON_Delete(object);
    return fflush(stdout) == 0 || problem_set(problem, "standard output: a write failed");
}

/* --- a process's life --- */

static bool open_member(struct group *group, struct member *member, uint32_t agent,
                        struct problem *problem)
{
    const struct nodes *nodes = group->nodes;
    const struct machine_choice choice = {agent, nodes->seed, nodes->run};
    member->agent = agent;
    member->machine = group->verbs->create(nodes->scenario, nodes->formats, &choice, problem);
    if (member->machine == NULL) {
        return false;
    }
    group->own[agent - 1] = true;
    if (nodes->csv != NULL) {
        member->csv = summary_open_csv(nodes, agent, problem);
        if (member->csv == NULL) {
            return false;
        }
        group->verbs->write_header(member->machine, member->csv);
    }
    return true;
}

static bool open_group(struct group *group, struct problem *problem)
{
    const struct nodes *nodes = group->nodes;
    for (uint32_t k = 0; k < nodes->agent_count; ++k) {
        if (!open_member(group, &group->members[k], nodes->agents[k], problem)) {
            return false;
        }
    }
    const char *path = nodes->interface + strlen(SERIAL_GROUP_PREFIX);
    if (!serial_open(&group->serial, path, problem)) {
        return false;
    }
    const struct channel_hooks hooks = serial_hooks(&group->serial);
    channel_begin_host(&group->channel, &hooks);
    group->transport = channel_transport(&group->channel);
    chain_begin(&group->chain, &nodes->scenario->topology, nodes->seed, nodes->run,
                nodes->scenario->t0 + 1u);
    return true;
}

static bool close_group(struct group *group, struct problem *problem)
{
    bool good = true;
    serial_close(&group->serial);
    for (uint32_t k = 0; k < group->nodes->agent_count; ++k) {
        FILE *csv = group->members[k].csv;
        if (csv != NULL) {
            good = ferror(csv) == 0 && good;
            good = fclose(csv) == 0 && good;
        }
        group->verbs->destroy(group->members[k].machine);
    }
    return good || problem_set(problem, "--csv: a write failed");
}

/* After it is open. */
static int run_group(struct group *group, struct problem *problem)
{
    loop_catch_signals();
    open_channel(group);
    uint64_t begun = loop_now(CLOCK_MONOTONIC);
    run(group);
    double seconds = (double)(loop_now(CLOCK_MONOTONIC) - begun) / LOOP_SECOND;
    bool good =
        say_stop(group) || problem_set(problem, "%s: the line went down", group->nodes->interface);
    return summarize(group, seconds, problem) && good ? DONE : FAILURE;
}

int serial_group_run(const struct nodes *nodes, struct problem *problem)
{
    static const struct machine_verbs *const verbs[ARITHMETIC_COUNT] = {
        &onebit_f64_machine, &onebit_f32_machine, &onebit_q31_machine};
    struct group group = {
        .nodes = nodes,
        .verbs = verbs[nodes->arithmetic],
        .members = calloc(nodes->agent_count, sizeof *group.members),
        .own = calloc(nodes->scenario->topology.agent_count, sizeof *group.own),
        .serial = {.handle = -1},
    };
    int status = FAILURE;
    if (group.members == NULL || group.own == NULL) {
        problem_set(problem, "not enough memory");
    } else {
        status = open_group(&group, problem) ? run_group(&group, problem) : BAD_USE;
        if (!close_group(&group, problem) && status == DONE) {
            status = FAILURE;
        }
    }
    free(group.members);
    free(group.own);
    return status;
}
