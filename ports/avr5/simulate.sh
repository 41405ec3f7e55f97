#!/bin/sh
# usage: simulate.sh IMAGE.elf [OPTION OF SIMAVR..]
# Runs an image of an ATmega328P in simavr: prints the text that it sends by USART0 and ends with the
# status that platform_exit says in the last line, or with 1 if there is none.
#
# simavr writes each line that the image sends in green and with a point for its end, on standard
# error, among lines of its own, which are passed on there.
image=$1
shift
simavr -m atmega328p -f 16000000 "$@" "$image" 2>&1 | awk '
    BEGIN { status = -1 }
    !sub(/^(\033\[0m)?\033\[32m/, "") {
        if (!/^(\033\[0m)?(Loaded .*)?$/) print | "cat >&2"
        next
    }
    { sub(/\.$/, "") }
    /^status [0-9]+$/ { status = $2; next }
    { print }
    END {
        if (status < 0) {
            print "simulate.sh: the image ended without platform_exit" | "cat >&2"
            status = 1
        }
        exit status
    }'
