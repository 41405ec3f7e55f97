/* The rule of ports/alignment.h on all graphs of six nodes. */
#include "clock_group.h"

#include "unity.h"

void setUp(void)
{
}

void tearDown(void)
{
}

static void test_all_graphs_of_six_nodes_gather(void)
{
    group_assert_all_graphs_gather(6);
}

static void test_all_graphs_of_six_nodes_follow_sync(void)
{
    group_assert_all_graphs_follow_sync(6);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_all_graphs_of_six_nodes_gather);
    RUN_TEST(test_all_graphs_of_six_nodes_follow_sync);
    return UNITY_END();
}
