/*
 * A file that appears whole or not at all: written under a temporary name beside its own, renamed
 * when it is complete. A device, a pipe or a symbolic link is written in place.
 */
#ifndef OUTPUT_FILE_H
#define OUTPUT_FILE_H

#include "problem.h"

#include <stdbool.h>
#include <stdio.h>

struct output_file {
    FILE *stream; /* write here */
    char *path;
    char *temporary; /* null when written in place */
};

/* Opens for writing; false and *problem if that cannot be. */
bool output_file_open(struct output_file *file, const char *path, struct problem *problem);

/* Closes and renames; false and *problem (and no file) if anything could not be written. */
bool output_file_commit(struct output_file *file, struct problem *problem);

/* Closes and removes; nothing to do for one that is committed, discarded or zero. */
void output_file_discard(struct output_file *file);

#endif
