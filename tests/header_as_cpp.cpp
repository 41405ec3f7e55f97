// The library's headers in a C++11 program: every declaration compiles without a warning, and names
// link as C's (extern "C"), one function of each source among them.
#include "onebit.h"
#include "onebit_random.h"

#include <cstdint>

int main()
{
    // The third known answer of tests/test_random.c, without its second word.
    if (onebit_random_word(0x13198a2eu, 0x03707344u, 0x243f6a88u, 0x85a308d3u) != 0xc4923a9cu) {
        return 1;
    }
    const onebit_format format = ONEBIT_FORMAT_BROADCAST_PAYLOAD;
    onebit_frame frame;
    std::uint8_t step = 0;
    onebit_frame_sync(&format, 130, &frame);
    if (!onebit_frame_is_sync(&format, &frame, &step) || step != 2 ||
        onebit_status_name(ONEBIT_OK) == nullptr) {
        return 2;
    }

    static const std::uint32_t neighbours[] = {2};
    static const onebit_real one[] = {ONEBIT_REAL(1.0, 30)};
    static const onebit_coefficient gain = ONEBIT_COEFFICIENT(10.0);
    onebit_config config = onebit_config();
    config.agent = 1;
    config.neighbours = neighbours;
    config.neighbour_count = 1;
    config.state_count = 1;
    config.format = format;
    config.stabilizing = one;
    config.compression = one;
    config.bound = ONEBIT_NOISE(0.5);
    config.estimator_gain = gain;
    config.control_gain = gain;
    config.start = 10;
    onebit_agent agent;
    onebit_estimate estimates[1];
    if (onebit_start(&config, &agent, estimates, nullptr) != ONEBIT_OK ||
        !onebit_valid(&config, &agent)) {
        return 3;
    }
    return agent.clock == 11 && onebit_check(nullptr) == ONEBIT_NULL ? 0 : 4;
}
