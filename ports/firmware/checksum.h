/*
 * The checksum by which runs are compared: the CRC of Ethernet, zlib and gzip over 32-bit two's
 * complement values, lowest byte first whatever the processor's order. Begins with CHECKSUM_BEGIN;
 * the result is the complement of what it has come to.
 */
#ifndef CHECKSUM_H
#define CHECKSUM_H

#include <stdint.h>

#define CHECKSUM_BEGIN 0xFFFFFFFFu

/* Lowest bit first, so that a word is its four bytes, lowest first. */
static inline uint32_t checksum(uint32_t so_far, int32_t value)
{
    so_far ^= (uint32_t)value;
    for (unsigned bit = 0; bit < 32; ++bit) {
        so_far = (so_far >> 1) ^ ((so_far & 1u) != 0 ? 0xEDB88320u : 0u);
    }
    return so_far;
}

#endif
