// The library's headers in a C++11 program: every declaration compiles without a warning, and names
// link as C's (extern "C"), one function of each source among them.
#include "onebit.h"
#include "onebit_random.h"

int main()
{
    // The third known answer of tests/test_random.c, without its second word.
    if (onebit_random_word(0x13198a2eu, 0x03707344u, 0x243f6a88u, 0x85a308d3u) != 0xc4923a9cu) {
        return 1;
    }
    onebit_frame frame;
    onebit_frame_sync(&frame);
    if (!onebit_frame_is_sync(&frame)) {
        return 2;
    }

    const uint32_t neighbours[] = {2};
#if ONEBIT_ARITHMETIC == ONEBIT_Q31
    const onebit_real one[] = {ONEBIT_REAL(1, 27)};
    const onebit_coefficient gain = {10, 0};
    const onebit_real half = ONEBIT_REAL(0.5, 27);
#else
    const onebit_real one[] = {1};
    const onebit_coefficient gain = 10;
    const onebit_real half = static_cast<onebit_real>(0.5);
#endif
    onebit_config config = onebit_config();
    config.agent = 1;
    config.neighbours = neighbours;
    config.neighbour_count = 1;
    config.state_count = 1;
    config.format.base = ONEBIT_PAYLOAD_BASE;
    config.stabilizing = one;
    config.compression = one;
    config.bound = half;
    config.estimator_gain = gain;
    config.control_gain = gain;
    config.start = 10;
    onebit_agent agent;
    onebit_estimate links[1];
    if (onebit_start(&config, &agent, links, nullptr) != ONEBIT_OK) {
        return 3;
    }
    return agent.clock == 11 && onebit_check(nullptr) == ONEBIT_NULL ? 0 : 4;
}
