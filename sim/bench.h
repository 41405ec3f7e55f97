/* What onebit-bench measures in each arithmetic; bench_agent.c is compiled once for each. */
#ifndef BENCH_H
#define BENCH_H

#include <stddef.h>

struct agent_times {
    double update_ns;      /* one estimator update, over an array of links */
    double step_ns;        /* one agent step: encode, 3 frames received, control; n = 4 */
    size_t agent_bytes;    /* sizeof(onebit_agent) here */
    size_t estimate_bytes; /* sizeof(onebit_estimate) */
    size_t config_bytes;   /* sizeof(onebit_config) */
};

/* Each measures for about `seconds`, several rounds, and keeps the fastest. */
typedef struct agent_times bench_agent_function(double seconds);
bench_agent_function onebit_f64_bench_agent;
bench_agent_function onebit_f32_bench_agent;
bench_agent_function onebit_q31_bench_agent;

#endif
