/*
 * The smallest image: says hello and holds the counter against a loop of 60, 600 and 6000 equal
 * rounds. Fails where the counter is not a straight line through them. The last is beyond the 16
 * bits of an AVR's timer, and with no optimisation still within the counter's range.
 */
#include "platform.h"
#include "print.h"

#include <stdbool.h>

static volatile uint32_t rounds; /* volatile, so that one loop runs for all */

static uint32_t count_loop(void)
{
    platform_count_from_here();
    for (uint32_t k = rounds; k > 0; --k) {
        __asm__ volatile("nop\n\tnop\n\tnop\n\tnop\n\tnop\n\tnop\n\tnop\n\tnop");
    }
    return platform_count();
}

int main(void)
{
    uint32_t counted[3];
    rounds = 60;
    print_text("hello: rounds of a loop and what they count");
    for (unsigned k = 0; k < 3; ++k) {
        counted[k] = count_loop();
        print_text(k == 0 ? " " : ", ");
        print_decimal(rounds);
        print_text(": ");
        print_decimal(counted[k]);
        rounds = rounds * 10;
    }
    print_text("\n");
    uint32_t round = (counted[1] - counted[0]) / 540;
    bool straight =
        counted[1] - counted[0] == 540 * round && counted[2] - counted[1] == 5400 * round;
    platform_exit(straight && round > 0 ? 0 : 1);
}
