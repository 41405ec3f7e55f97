/* Time, waiting and signals of loop.h. */
#include "loop.h"

#include <signal.h>
#include <stddef.h>

static volatile sig_atomic_t ended; /* a handler has no context pointer */
static sigset_t mask_while_waiting;

static void note(int signal_number)
{
    (void)signal_number;
    ended = 1;
}

uint64_t loop_now(clockid_t clock)
{
    struct timespec time;
    clock_gettime(clock, &time);
    return (uint64_t)time.tv_sec * LOOP_SECOND + (uint64_t)time.tv_nsec;
}

void loop_catch_signals(void)
{
    struct sigaction action = {.sa_handler = note};
    sigset_t held;
    sigemptyset(&action.sa_mask);
    sigaction(SIGINT, &action, NULL);
    sigaction(SIGTERM, &action, NULL);
    /* Held back while working: one that comes between a look at the flag and the wait is not lost.
     */
    sigemptyset(&held);
    sigaddset(&held, SIGINT);
    sigaddset(&held, SIGTERM);
    sigprocmask(SIG_BLOCK, &held, &mask_while_waiting);
    sigdelset(&mask_while_waiting, SIGINT);
    sigdelset(&mask_while_waiting, SIGTERM);
}

bool loop_ended(void)
{
    return ended != 0;
}

void loop_wait(struct pollfd *files, nfds_t count, uint64_t nanoseconds)
{
    const struct timespec limit = {
        .tv_sec = (time_t)(nanoseconds / LOOP_SECOND),
        .tv_nsec = (long)(nanoseconds % LOOP_SECOND),
    };
    ppoll(files, count, &limit, &mask_while_waiting);
}
