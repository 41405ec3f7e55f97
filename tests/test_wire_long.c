/* sim/wire.c over all 2^29 extended identifiers (about 10 s). */
#include "unity.h"
#include "wire.h"

void setUp(void)
{
}

void tearDown(void)
{
}

static void test_extended_length_0_all_identifiers(void)
{
    onebit_frame frame = {0};
    frame.flags = ONEBIT_FRAME_EXTENDED;
    uint32_t least = UINT32_MAX;
    uint32_t most = 0;
    uint64_t sum = 0;
    for (frame.identifier = 0; frame.identifier < 1u << 29; frame.identifier++) {
        uint32_t bits = wire_bits(&frame);
        least = bits < least ? bits : least;
        most = bits > most ? bits : most;
        sum += bits;
    }
    TEST_ASSERT_EQUAL_UINT32(68, least);
    TEST_ASSERT_EQUAL_UINT32(78, most);
    TEST_ASSERT_DOUBLE_WITHIN(0.0005, 69.738, (double)sum / (double)(1u << 29));
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_extended_length_0_all_identifiers);
    return UNITY_END();
}
