/*
 * The nodes of node.h. Reads the clocks, the sockets and signals; writes CSV, the summary on
 * standard output, and on standard error what a person must know, a line each.
 *
 * Work and memory are bounded whatever the bus brings: a fixed number of frames from a socket, then
 * timers and the other sockets; nothing is kept of a frame but counters and estimates.
 */
#include "node.h"

#include "canopen.h"
#include "command_line.h"
#include "loop.h"
#include "machine.h"
#include "onebit_status.h"
#include "socketcan.h"
#include "summary.h"

#include <cjson/cJSON.h>
#include <inttypes.h>
#include <math.h>
#include <stdlib.h>
#include <unistd.h>

#define FOREIGN_STEPS 3 /* in a row with frames of another form only: the peers use that one */

/* Other ways in which the neighbours may send; what each is called. */
static const onebit_format forms[] = {
    ONEBIT_FORMAT_BROADCAST_PAYLOAD,
    ONEBIT_FORMAT_BROADCAST_IDENTIFIER,
    ONEBIT_FORMAT_LINK_PAYLOAD,
    ONEBIT_FORMAT_LINK_IDENTIFIER,
};
static const char *const form_names[] = {"broadcast, payload", "broadcast, identifier",
                                         "link, payload", "link, identifier"};
#define FORMS (sizeof forms / sizeof *forms)

struct node {
    const struct nodes *nodes;
    uint32_t agent;
    const struct machine_verbs *verbs;
    struct machine *machine;
    struct socketcan socketcan;
    struct transport transport;
    FILE *csv;
    bool ended;
    const char *end; /* what ended it: signal, stop or steps */
    bool in_step;

    /* What this step still has to send. */
    onebit_frame frames[MACHINE_FRAMES_MAX];
    uint32_t frame_count;
    uint32_t frame_next;
    uint64_t send_time; /* monotonic; not before it */
    uint64_t revive_time;

    uint64_t last_sync; /* the kernel's time of the last that was taken; 0 before */
    uint64_t slot;      /* of the system's clock: the step's number since 1970 */

    /* Until a neighbour's bit is taken: in which form they send. */
    bool form_known;
    bool own_form_heard; /* in this step */
    uint32_t forms_heard;
    uint32_t foreign_steps;
    uint32_t foreign_form;

    uint64_t syncs;
    uint64_t sync_refused;
    uint64_t frames_in;
    uint64_t late;
    uint64_t duplicates;
    uint64_t deadline_misses;
};

/* --- what the kernel is asked for --- */

struct filters {
    struct socketcan_filter list[SOCKETCAN_FILTERS_MAX];
    uint32_t count;
};

static void add_filter(struct filters *filters, uint32_t identifier, uint32_t mask, bool extended)
{
    filters->list[filters->count++] = (struct socketcan_filter){identifier, mask, extended};
}

/* The identifiers of a sender's messages to a receiver: one, or two where they hold the bit. */
static void add_messages(struct filters *filters, const onebit_format *format, uint32_t sender,
                         uint32_t receiver)
{
    onebit_message message = {.sender = sender, .receiver = receiver};
    onebit_frame zero;
    onebit_frame one;
    if (onebit_frame_encode(format, &message, &zero) != ONEBIT_OK) {
        return; /* this form has no identifier for it */
    }
    message.bit = true;
    onebit_frame_encode(format, &message, &one);
    bool extended = (zero.flags & ONEBIT_FRAME_EXTENDED) != 0;
    add_filter(filters, zero.identifier, UINT32_MAX >> 3, extended);
    if (one.identifier != zero.identifier) {
        add_filter(filters, one.identifier, UINT32_MAX >> 3, extended);
    }
}

static bool same_form(const onebit_format *one, const onebit_format *other)
{
    return one->mode == other->mode && one->encoding == other->encoding;
}

/* The frames that a node listens to. */
static void choose_filters(const struct node *node, struct filters *filters)
{
    const onebit_format *format = &node->nodes->scenario->format;
    const uint32_t *neighbours;
    uint32_t count = node->verbs->neighbours(node->machine, &neighbours);
    filters->count = 0;
    add_filter(filters, CANOPEN_MANAGEMENT_IDENTIFIER, 0x7FF, false);
    if (node->nodes->sync) {
        add_filter(filters, format->sync, 0x7FF, false);
    }
    /* Own frames do not come back: what is heard under the own number is another node's. */
    if (format->mode == ONEBIT_MODE_LINK) {
        add_filter(filters, ONEBIT_LINK_BASE + (node->agent << 14), 0x1FFFC000, true);
    } else {
        add_messages(filters, format, node->agent, 0);
    }
    for (uint32_t k = 0; k < count; ++k) {
        add_messages(filters, format, neighbours[k], node->agent);
        for (uint32_t form = 0; !node->form_known && form < FORMS; ++form) {
            if (!same_form(&forms[form], format)) {
                add_messages(filters, &forms[form], neighbours[k], node->agent);
            }
        }
    }
}

/* --- steps --- */

static void say(const struct node *node, const char *what)
{
    fprintf(stderr, "onebit-node: agent %lu: %s\n", (unsigned long)node->agent, what);
}

static void send_frames(struct node *node)
{
    uint64_t now = loop_now(CLOCK_MONOTONIC);
    while (node->frame_next < node->frame_count && now >= node->send_time) {
        if (node->transport.send(node->transport.context, &node->frames[node->frame_next]) ==
            TRANSPORT_DONE) {
            ++node->frame_next;
        } else {
            node->send_time = now + LOOP_RETRY;
        }
    }
}

/* `delay` nanoseconds pass before it sends. */
static void begin_step(struct node *node, uint64_t delay)
{
    node->frame_count = node->verbs->begin(node->machine, node->frames);
    node->frame_next = 0;
    node->in_step = true;
    node->send_time = delay == 0 ? 0 : loop_now(CLOCK_MONOTONIC) + delay;
    send_frames(node);
}

/* Whether, so far, the neighbours send in another form than the scenario's. */
static void judge_form(struct node *node)
{
    if (node->form_known) {
        return;
    }
    bool foreign = !node->own_form_heard && node->forms_heard != 0;
    node->foreign_steps = foreign ? node->foreign_steps + 1 : 0;
    for (uint32_t form = 0; foreign && form < FORMS; ++form) {
        if (node->forms_heard >> form & 1u) {
            node->foreign_form = form;
        }
    }
    node->own_form_heard = false;
    node->forms_heard = 0;
}

static void end_step(struct node *node)
{
    node->late += node->frame_count - node->frame_next;
    node->frame_count = 0;
    node->frame_next = 0;
    node->verbs->end(node->machine, node->csv);
    node->in_step = false;
    judge_form(node);
    struct machine_report report;
    node->verbs->report(node->machine, &report);
    if (node->nodes->steps != 0 && report.steps >= node->nodes->steps) {
        node->ended = true;
        node->end = "steps";
    }
}

/* `step` is what SYNC told of t, modulo 128. */
static void take_sync(struct node *node, uint64_t time, uint8_t step)
{
    uint64_t period = (uint64_t)(node->nodes->period * LOOP_SECOND);
    /* A clock that was set back is no reason to refuse. */
    if (node->last_sync != 0 && time >= node->last_sync && time - node->last_sync < period / 2) {
        ++node->sync_refused;
        return;
    }
    ++node->syncs;
    node->last_sync = time;
    if (period != 0) {
        uint64_t now = loop_now(CLOCK_REALTIME);
        node->deadline_misses += now > time && now - time > period;
    }
    if (node->in_step) {
        end_step(node);
    }
    if (!node->ended) {
        node->verbs->align(node->machine, step);
        begin_step(node, 0);
    }
}

/* Steps by the system's clock: one begins at each whole multiple of the period. */
static void take_time(struct node *node)
{
    uint64_t period = (uint64_t)(node->nodes->period * LOOP_SECOND);
    uint64_t slot = loop_now(CLOCK_REALTIME) / period;
    if (slot == node->slot) {
        return;
    }
    int64_t missed = (int64_t)(slot - node->slot) - 1;
    if (!node->in_step) {
        /* Clocks and residues follow from the time, so nodes begin aligned whenever they start. */
        struct machine_report report;
        node->verbs->report(node->machine, &report);
        missed = (int64_t)((uint32_t)slot - report.clock) % ONEBIT_STEP_MODULUS;
    } else {
        end_step(node);
        if (missed != 0) {
            node->deadline_misses += missed > 0 ? (uint64_t)missed : 1u;
        }
        if (missed < 0 || missed > INT32_MAX) {
            missed = (int64_t)((uint64_t)missed % ONEBIT_STEP_MODULUS);
        }
    }
    node->slot = slot;
    if (missed != 0) {
        node->verbs->miss(node->machine, (int32_t)missed);
    }
    if (!node->ended) {
        /* Clocks of other machines may be off by a quarter of the period. */
        begin_step(node, period / 4);
    }
}

/* --- frames --- */

static bool is_neighbour(const struct node *node, uint32_t number)
{
    const uint32_t *neighbours;
    uint32_t count = node->verbs->neighbours(node->machine, &neighbours);
    for (uint32_t k = 0; k < count; ++k) {
        if (neighbours[k] == number) {
            return true;
        }
    }
    return false;
}

/* Notes in which forms a neighbour may have meant a frame. */
static void note_forms(struct node *node, const onebit_frame *frame)
{
    const onebit_format *own = &node->nodes->scenario->format;
    for (uint32_t form = 0; form < FORMS; ++form) {
        bool same = same_form(&forms[form], own);
        onebit_message message;
        if (onebit_frame_decode(same ? own : &forms[form], frame, &message) != ONEBIT_OK ||
            !is_neighbour(node, message.sender) ||
            (message.receiver != 0 && message.receiver != node->agent)) {
            continue;
        }
        if (same) {
            node->own_form_heard = true;
        } else {
            node->forms_heard |= 1u << form;
        }
    }
}

static void take_message(struct node *node, const onebit_frame *frame)
{
    onebit_message message;
    ++node->frames_in;
    if (onebit_frame_decode(&node->nodes->scenario->format, frame, &message) == ONEBIT_OK &&
        message.sender == node->agent) {
        if (node->duplicates++ == 0) {
            say(node, "another node sends under the same number");
        }
        return;
    }
    if (!node->in_step) {
        return; /* before the first step */
    }
    bool taken = node->verbs->hear(node->machine, frame);
    if (node->form_known) {
        return;
    }
    note_forms(node, frame);
    if (taken) {
        struct filters filters;
        node->form_known = true;
        node->foreign_steps = 0;
        choose_filters(node, &filters);
        socketcan_filter(&node->socketcan, filters.list, filters.count);
    }
}

static void take_frame(struct node *node, const onebit_frame *frame, uint64_t time)
{
    uint8_t told;
    if (canopen_is_stop(frame, 0)) { /* it has no node-ID: what is said to all */
        if (node->in_step) {
            end_step(node);
        }
        node->ended = true;
        node->end = "stop";
    } else if (node->nodes->sync &&
               onebit_frame_is_sync(&node->nodes->scenario->format, frame, &told)) {
        take_sync(node, time, told);
    } else {
        take_message(node, frame);
    }
}

static void receive_frames(struct node *node)
{
    bool was_down = node->socketcan.down;
    enum transport_status status = TRANSPORT_DONE;
    for (int k = 0; k < LOOP_BATCH && !node->ended && status == TRANSPORT_DONE; ++k) {
        onebit_frame frame;
        uint64_t time;
        status = node->transport.receive(node->transport.context, &frame, &time);
        if (status == TRANSPORT_DONE) {
            take_frame(node, &frame, time);
        }
    }
    if (node->socketcan.down && !was_down) {
        say(node, "the interface went down; waiting for it");
    }
}

static void revive(struct node *node)
{
    uint64_t now = loop_now(CLOCK_MONOTONIC);
    if (node->socketcan.down && now >= node->revive_time) {
        node->revive_time = now + LOOP_REVIVE;
        if (socketcan_revive(&node->socketcan)) {
            say(node, "the interface is back");
        }
    }
}

/* --- what is told --- */

static struct summary summary_of(const struct node *node, double seconds)
{
    const struct socketcan_counts *counts = &node->socketcan.counts;
    struct summary summary = {
        .nodes = node->nodes,
        .agent = node->agent,
        .ended = node->end,
        .seconds = seconds,
        .frames_out = counts->sent,
        .frames_in = node->frames_in,
        .duplicates = node->duplicates,
        .syncs = node->syncs,
        .sync_refused = node->sync_refused,
        .deadline_misses = node->deadline_misses,
        .late = node->late,
        .queue_full = counts->queue_full,
        .lost = counts->lost,
        .error_frames = counts->error_frames,
        .bus_off = counts->bus_off,
        .interface_down = counts->went_down,
    };
    node->verbs->report(node->machine, &summary.report);
    return summary;
}

static bool summarize(const struct nodes *nodes, const struct node *list, double seconds,
                      struct problem *problem)
{
    cJSON *summaries = cJSON_CreateArray();
    for (uint32_t k = 0; k < nodes->agent_count; ++k) {
        struct summary summary = summary_of(&list[k], seconds);
        if (nodes->json) {
            cJSON_AddItemToArray(summaries, summary_object(&summary));
        } else {
            summary_print(&summary);
        }
    }
    if (nodes->json) {
        summary_print_object(nodes->agent_count == 1 ? summaries->child : summaries);
    }
    cJSON_Delete(summaries);
    return fflush(stdout) == 0 || problem_set(problem, "standard output: a write failed");
}

static void show_status(const struct node *list, uint32_t count)
{
    struct machine_report first;
    double worst = (double)NAN;
    list[0].verbs->report(list[0].machine, &first);
    for (uint32_t k = 0; k < count; ++k) {
        struct machine_report report;
        list[k].verbs->report(list[k].machine, &report);
        worst = fmax(worst, report.disagreement); /* of a number and NaN the number */
    }
    fprintf(stderr, "\r\033[Kstep %lu, t %lu, frames in %" PRIu64 ", out %" PRIu64,
            (unsigned long)first.steps, (unsigned long)first.clock, list[0].frames_in,
            list[0].socketcan.counts.sent);
    if (!isnan(worst)) {
        fprintf(stderr, ", disagreement %.3g", worst);
    }
    if (list[0].socketcan.down) {
        fputs(", the interface is down", stderr);
    } else if (!list[0].in_step) {
        fputs(", waiting for the first step", stderr);
    }
}

/* --- a process's life --- */

static bool open_node(struct node *node, const struct nodes *nodes, uint32_t agent,
                      struct problem *problem)
{
    static const struct machine_verbs *const verbs[ARITHMETIC_COUNT] = {
        &onebit_f64_machine, &onebit_f32_machine, &onebit_q31_machine};
    const struct machine_choice choice = {agent, nodes->seed, nodes->run};
    struct filters filters;
    node->nodes = nodes;
    node->agent = agent;
    node->end = "signal"; /* unless something else does */
    node->verbs = verbs[nodes->arithmetic];
    node->machine = node->verbs->create(nodes->scenario, nodes->formats, &choice, problem);
    if (node->machine == NULL) {
        return false;
    }
    choose_filters(node, &filters);
    if (!socketcan_open(&node->socketcan, nodes->interface, filters.list, filters.count, problem)) {
        return false;
    }
    node->transport = socketcan_transport(&node->socketcan);
    if (nodes->csv != NULL) {
        node->csv = summary_open_csv(nodes, agent, problem);
        if (node->csv == NULL) {
            return false;
        }
        node->verbs->write_header(node->machine, node->csv);
    }
    if (!nodes->sync) {
        node->slot = loop_now(CLOCK_REALTIME) / (uint64_t)(nodes->period * LOOP_SECOND);
    }
    return true;
}

static bool close_node(struct node *node, struct problem *problem)
{
    bool good = true;
    socketcan_close(&node->socketcan);
    if (node->csv != NULL) {
        good = ferror(node->csv) == 0;
        good = fclose(node->csv) == 0 && good;
    }
    if (node->verbs != NULL) {
        node->verbs->destroy(node->machine);
    }
    return good || problem_set(problem, "--csv: a write failed");
}

static uint64_t until(uint64_t time, uint64_t now)
{
    return time > now ? time - now : 0;
}

/* How long a node can wait if no frame comes. */
static uint64_t patience(const struct node *node)
{
    uint64_t now = loop_now(CLOCK_MONOTONIC);
    uint64_t wait = LOOP_SECOND;
    if (node->frame_next < node->frame_count) {
        wait = until(node->send_time, now);
    }
    if (node->socketcan.down && until(node->revive_time, now) < wait) {
        wait = until(node->revive_time, now);
    }
    if (!node->nodes->sync) {
        uint64_t period = (uint64_t)(node->nodes->period * LOOP_SECOND);
        uint64_t rest = period - loop_now(CLOCK_REALTIME) % period;
        wait = rest < wait ? rest : wait;
    }
    return wait;
}

static void wait_for_frames(const struct node *list, struct pollfd *files, uint32_t count,
                            bool status_line)
{
    uint64_t wait = status_line ? LOOP_STATUS : LOOP_SECOND;
    for (uint32_t k = 0; k < count; ++k) {
        /* A negative handle is passed over. */
        files[k] =
            (struct pollfd){.fd = list[k].ended ? -1 : list[k].socketcan.handle, .events = POLLIN};
        if (!list[k].ended && patience(&list[k]) < wait) {
            wait = patience(&list[k]);
        }
    }
    loop_wait(files, count, wait);
}

/* One look at everything that a node has to do; false when the peers use another form. */
static bool work(struct node *node, struct problem *problem)
{
    receive_frames(node);
    if (!node->ended && !node->nodes->sync) {
        take_time(node);
    }
    if (!node->ended) {
        send_frames(node);
        revive(node);
    }
    if (node->foreign_steps < FOREIGN_STEPS) {
        return true;
    }
    const onebit_format *format = &node->nodes->scenario->format;
    uint32_t own = 0;
    while (!same_form(&forms[own], format)) {
        ++own;
    }
    return problem_set(problem,
                       "agent %lu: its neighbours on %s send in the form \"%s\", but %s "
                       "says \"%s\"",
                       (unsigned long)node->agent, node->nodes->interface,
                       form_names[node->foreign_form], node->nodes->scenario->path,
                       form_names[own]);
}

static int run(const struct nodes *nodes, struct node *list, struct pollfd *files,
               struct problem *problem)
{
    bool status_line = isatty(STDERR_FILENO) != 0;
    uint64_t begun = loop_now(CLOCK_MONOTONIC);
    uint64_t status_time = begun;
    uint32_t running = nodes->agent_count;
    loop_catch_signals();
    while (running != 0 && !loop_ended()) {
        wait_for_frames(list, files, nodes->agent_count, status_line);
        running = 0;
        for (uint32_t k = 0; k < nodes->agent_count; ++k) {
            if (!list[k].ended && !work(&list[k], problem)) {
                return BAD_USE;
            }
            running += !list[k].ended;
        }
        if (status_line && loop_now(CLOCK_MONOTONIC) >= status_time) {
            status_time = loop_now(CLOCK_MONOTONIC) + LOOP_STATUS;
            show_status(list, nodes->agent_count);
        }
    }
    if (status_line) {
        fputs("\r\033[K", stderr);
    }
    double seconds = (double)(loop_now(CLOCK_MONOTONIC) - begun) / LOOP_SECOND;
    return summarize(nodes, list, seconds, problem) ? DONE : FAILURE;
}

int nodes_run(const struct nodes *nodes, struct problem *problem)
{
    struct node *list = calloc(nodes->agent_count, sizeof *list);
    struct pollfd *files = calloc(nodes->agent_count, sizeof *files);
    int status = DONE;
    if (list == NULL || files == NULL) {
        problem_set(problem, "not enough memory");
        status = FAILURE;
    }
    for (uint32_t k = 0; list != NULL && k < nodes->agent_count; ++k) {
        list[k].socketcan.handle = -1;
    }
    for (uint32_t k = 0; status == DONE && k < nodes->agent_count; ++k) {
        status = open_node(&list[k], nodes, nodes->agents[k], problem) ? DONE : BAD_USE;
    }
    if (status == DONE) {
        status = run(nodes, list, files, problem);
    }
    for (uint32_t k = 0; list != NULL && k < nodes->agent_count; ++k) {
        if (!close_node(&list[k], problem) && status == DONE) {
            status = FAILURE;
        }
    }
    free(list);
    free(files);
    return status;
}
