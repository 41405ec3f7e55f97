#!/usr/bin/env python3
"""Prints sim/wire_tables.h: the two tables with which sim/wire.c takes a CAN frame byte by byte.

    tools/wire_tables.py > sim/wire_tables.h

Both follow from the bitwise rules of ISO 11898-1 for the CRC sequence and for bit stuffing, written
out below; tests/test_wire_tables.py checks that the committed file is what this prints.
"""

POLYNOMIAL = 0x4599  # x^15 + x^14 + x^10 + x^8 + x^7 + x^4 + x^3 + 1, its highest term left out
STATES = 8  # of the stuffing machine: 4 * (value of the last bit) + (equal bits so far, 1..4) - 1
PER_LINE = 8


def crc_of_byte(byte):
    """The register, left-aligned in 16 bits, after a byte has been shifted into zeros."""
    register = 0
    for place in reversed(range(8)):
        feedback = (register >> 14 & 1) ^ (byte >> place & 1)
        register = (register << 1 & 0x7FFF) ^ (POLYNOMIAL if feedback else 0)
    return register << 1


def stuff_byte(state, byte):
    """The state after a byte, and the stuff bits that it made (at most two)."""
    value, equal, stuffed = state >> 2, (state & 3) + 1, 0
    for place in reversed(range(8)):
        bit = byte >> place & 1
        equal = equal + 1 if bit == value else 1
        value = bit
        if equal == 5:
            # The stuff bit has the other value and is itself the first of a new run.
            stuffed += 1
            value, equal = 1 - value, 1
    return value * 4 + equal - 1, stuffed


def rows(values, form):
    lines = []
    for start in range(0, len(values), PER_LINE):
        line = ", ".join(form.format(value) for value in values[start : start + PER_LINE])
        lines.append(f"    {line},")
    return "\n".join(lines)


def stuff_entry(byte, state):
    following, stuffed = stuff_byte(state, byte)
    return stuffed << 3 | following


HEADER = """\
/* Made by tools/wire_tables.py, which says how; do not edit. For sim/wire.c alone. */
#ifndef WIRE_TABLES_H
#define WIRE_TABLES_H

#include <stdint.h>

/* clang-format off */

/* [byte]: the CRC-15 register after that byte, from zero; times two, to fill 16 bits. */
static const uint16_t wire_crc_table[256] = {{
{crc}
}};

/* [8 * byte + state]: (stuff bits that the byte makes) << 3 | state after it. */
static const uint8_t wire_stuff_table[8 * 256] = {{
{stuff}
}};

/* clang-format on */

#endif"""


def main():
    crc = [crc_of_byte(byte) for byte in range(256)]
    stuff = [stuff_entry(byte, state) for byte in range(256) for state in range(STATES)]
    print(HEADER.format(crc=rows(crc, "0x{:04x}"), stuff=rows(stuff, "{:2}")))


if __name__ == "__main__":
    main()
