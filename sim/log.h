/*
 * Bus logs: `candump -L` text, or pcap (link type 227, SocketCAN) where the file's name ends in
 * `.pcap`. Written by a run, read by replay.
 */
#ifndef LOG_H
#define LOG_H

#include "onebit_frame.h"
#include "problem.h"

#include <stdbool.h>

struct log_writer;
struct log_reader;

/*
 * Opens PATH for writing, under a temporary name beside it until log_writer_commit. Null and
 * *problem on failure.
 */
struct log_writer *log_writer_open(const char *path, struct problem *problem);

/* Appends a frame; `seconds` since the run began, not negative. Failures show at commit. */
void log_writer_frame(struct log_writer *writer, double seconds, const onebit_frame *frame);

/* Ends the file and gives it its name; false and *problem if anything could not be written. */
bool log_writer_commit(struct log_writer *writer, struct problem *problem);

/* Ends and removes the unfinished file; null is allowed. */
void log_writer_discard(struct log_writer *writer);

struct log_reader *log_reader_open(const char *path, struct problem *problem);

/* 1: *frame is the next frame; 0: end of the log; -1: *problem says what is wrong at which line. */
int log_reader_next(struct log_reader *reader, onebit_frame *frame, struct problem *problem);

void log_reader_close(struct log_reader *reader);

#endif
