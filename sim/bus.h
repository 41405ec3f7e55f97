/*
 * The virtual CAN bus: takes the frames of a step, says which of them are heard in that step and
 * counts what they cost. Two models: `ideal` (a frame arrives at once, in the order sent) and `can`
 * (bit times at a bit rate, the lowest identifier wins arbitration, what has not started at the
 * period's end is withdrawn). Lengths come from wire.h in both.
 */
#ifndef BUS_H
#define BUS_H

#include "log.h"
#include "onebit_frame.h"
#include "scenario.h"

#include <stdbool.h>
#include <stdint.h>

struct bus_traffic {
    uint64_t frames;      /* completed on the wire, SYNC among them */
    uint64_t late_frames; /* withdrawn at the end of their period, SYNC among them; 0 if ideal */
    uint64_t wire_bits;   /* of the completed frames, interframe space included */
    uint64_t messages;    /* completed frames that are not SYNC */
    /*
     * Seconds from when a message is ready, its step's SYNC over, to the last bit of its end of
     * frame (the interframe space is not waited for), over messages; brought up to date when
     * bus_receive returns false. 0 if ideal.
     */
    double latency_sum;
    double latency_max;
};

struct bus;

/*
 * A bus for at most `capacity` frames a step beside SYNC, at `bitrate` bit/s with `period` seconds
 * a step, both above 0. `log` may be null; every completed frame is written to it with the time of
 * its end (ideal: of its step's begin). Null when memory is short. One bus belongs to one thread.
 */
struct bus *bus_create(enum bus_model model, double bitrate, double period, uint32_t capacity,
                       struct log_writer *log);
void bus_free(struct bus *bus);

/*
 * Begins the next step: the master's `sync` is sent; the clock of the first step is 0 s. A SYNC
 * that cannot start within its period is withdrawn, and with it all that the step sends.
 */
void bus_begin_step(struct bus *bus, const onebit_frame *sync);

/*
 * Sends a frame as soon as this step's SYNC is over. `tag` comes back with it. All of a step's
 * frames are sent before the first bus_receive. Frames of the same identifier go in the order sent.
 */
void bus_send(struct bus *bus, const onebit_frame *frame, uint32_t tag);

/*
 * The next frame of this step that is heard, in the order of the wire; false when there is none,
 * and then what was left is withdrawn. The frame stays valid until bus_begin_step.
 */
bool bus_receive(struct bus *bus, const onebit_frame **frame, uint32_t *tag);

const struct bus_traffic *bus_traffic(const struct bus *bus);

#endif
