/*
 * Versions of the library and of what its agents say to each other. Arithmetic-independent. The
 * build reads the project's version here.
 */
#ifndef ONEBIT_VERSION_H
#define ONEBIT_VERSION_H

#define ONEBIT_VERSION_MAJOR 0
#define ONEBIT_VERSION_MINOR 2
#define ONEBIT_VERSION_PATCH 0

/* Grows when frames (onebit_frame.h) or random words change so that old and new cannot be mixed. */
#define ONEBIT_WIRE_FORMAT 1

#endif
