/*
 * The slcan protocol against ways of knowing that share no code with it: the manual's examples, the
 * C library's printf for lines to send, POSIX regular expressions and strtoul for lines that come.
 */
#include "slcan.h"

#include <unity.h>

#include <regex.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static struct slcan_parser parser;
static struct slcan_line line;
static regex_t frame_form;
static regex_t command_form;

/* A frame as a pattern: the data's length depends on the digit before it. */
void setUp(void)
{
    char pattern[1024] = "^(";
    for (int length = 0; length <= 8; ++length) {
        char part[128];
        snprintf(part, sizeof part, "%s(t[0-7][H]{2}|T[01][H]{7})%d[H]{%d}([H]{4})?",
                 length == 0 ? "" : "|", length, 2 * length);
        strcat(pattern, part);
    }
    strcat(pattern, "|(r[0-7][H]{2}|R[01][H]{7})[0-8]([H]{4})?)$");
    char text[4096];
    size_t used = 0;
    for (const char *at = pattern; *at != '\0'; ++at) {
        used +=
            (size_t)snprintf(text + used, sizeof text - used, *at == 'H' ? "0-9A-Fa-f" : "%c", *at);
    }
    TEST_ASSERT_EQUAL(0, regcomp(&frame_form, text, REG_EXTENDED | REG_NOSUB));
    TEST_ASSERT_EQUAL(0, regcomp(&command_form,
                                 "^([OLCPANz]|Z[0-9A-Fa-f]?|[SXWUQ][0-9A-Fa-f]|"
                                 "F([0-9A-Fa-f]{2})?|V([0-9A-Fa-f]{4})?|s[0-9A-Fa-f]{4}|"
                                 "[Mm][0-9A-Fa-f]{8})$",
                                 REG_EXTENDED | REG_NOSUB));
    parser = (struct slcan_parser){0};
}

void tearDown(void)
{
    regfree(&frame_form);
    regfree(&command_form);
}

/* --- the other way of knowing --- */

static unsigned long hex(const char *text, size_t digits)
{
    char part[16] = {0};
    memcpy(part, text, digits);
    return strtoul(part, NULL, 16);
}

static onebit_frame frame_of(const char *text)
{
    size_t digits = text[0] == 't' || text[0] == 'r' ? 3 : 8;
    onebit_frame frame = {.identifier = (uint32_t)hex(text + 1, digits),
                          .length = (uint8_t)hex(text + 1 + digits, 1)};
    frame.flags = (uint8_t)(digits == 8 ? ONEBIT_FRAME_EXTENDED : 0);
    if (text[0] == 'r' || text[0] == 'R') {
        frame.flags |= ONEBIT_FRAME_REMOTE;
    } else {
        for (size_t k = 0; k < frame.length; ++k) {
            frame.data[k] = (uint8_t)hex(text + 2 + digits + 2 * k, 2);
        }
    }
    return frame;
}

static void print_frame(const onebit_frame *frame, char *text)
{
    bool extended = (frame->flags & ONEBIT_FRAME_EXTENDED) != 0;
    bool remote = (frame->flags & ONEBIT_FRAME_REMOTE) != 0;
    text += sprintf(text, extended ? "%c%08lX%u" : "%c%03lX%u",
                    extended ? (remote ? 'R' : 'T') : (remote ? 'r' : 't'),
                    (unsigned long)frame->identifier, (unsigned)frame->length);
    for (int k = 0; k < frame->length && !remote; ++k) {
        text += sprintf(text, "%02X", (unsigned)frame->data[k]);
    }
    strcpy(text, "\r");
}

static void check_frame(const onebit_frame *expected, const onebit_frame *actual)
{
    TEST_ASSERT_EQUAL_HEX32(expected->identifier, actual->identifier);
    TEST_ASSERT_EQUAL_HEX8(expected->flags, actual->flags);
    TEST_ASSERT_EQUAL(expected->length, actual->length);
    TEST_ASSERT_EQUAL_HEX8_ARRAY(expected->data, actual->data, 8);
}

/* All characters but the last must leave the line pending. */
static enum slcan_status feed(const char *text, size_t length)
{
    enum slcan_status status = SLCAN_PENDING;
    for (size_t k = 0; k < length; ++k) {
        TEST_ASSERT_EQUAL(SLCAN_PENDING, status);
        status = slcan_take(&parser, (uint8_t)text[k], &line);
    }
    return status;
}

static unsigned long dropped(void)
{
    unsigned long sum = 0;
    for (int k = 0; k < SLCAN_DROPS; ++k) {
        sum += parser.dropped[k];
    }
    return sum;
}

/* A line without CR: accepted if and only if the patterns say so, with strtoul's values. */
static void check_line(const char *text, size_t length)
{
    char whole[300];
    memcpy(whole, text, length);
    whole[length] = '\0';
    bool is_text = strlen(whole) == length; /* the patterns would not see beyond a NUL */
    bool is_frame = is_text && regexec(&frame_form, whole, 0, NULL, 0) == 0;
    bool is_command = is_text && regexec(&command_form, whole, 0, NULL, 0) == 0;
    struct slcan_line old = line;
    parser = (struct slcan_parser){0}; /* for its counters, which saturate */
    whole[length] = '\r';
    enum slcan_status status = feed(whole, length + 1);
    whole[length] = '\0';
    TEST_ASSERT_EQUAL_MESSAGE(is_frame, status == SLCAN_FRAME, whole);
    TEST_ASSERT_EQUAL_MESSAGE(is_command, status == SLCAN_COMMAND, whole);
    TEST_ASSERT_EQUAL_MESSAGE(length == 0, status == SLCAN_DONE, whole);
    TEST_ASSERT_EQUAL(0, parser.length);
    if (is_frame) {
        onebit_frame expected = frame_of(whole);
        check_frame(&expected, &line.frame);
    } else {
        check_frame(&old.frame, &line.frame);
    }
    if (is_command) {
        TEST_ASSERT_EQUAL(whole[0], line.command);
        TEST_ASSERT_EQUAL(length - 1, line.digits);
        TEST_ASSERT_EQUAL_HEX32(hex(whole + 1, length - 1), line.number);
    }
    bool good = is_frame || is_command || length == 0;
    TEST_ASSERT_EQUAL(good ? 0 : 1, dropped());
}

/* --- frames --- */

static void check_round_trip(const onebit_frame *frame)
{
    char expected[64];
    uint8_t text[SLCAN_LINE_MAX + 1];
    print_frame(frame, expected);
    uint8_t length = slcan_format(frame, text);
    TEST_ASSERT_EQUAL(strlen(expected), length);
    TEST_ASSERT_EQUAL_MEMORY(expected, text, length);
    TEST_ASSERT_EQUAL(SLCAN_FRAME, feed(expected, length));
    check_frame(frame, &line.frame);
}

static void test_round_trip_of_every_kind_length_and_limit(void)
{
    static const uint32_t extended[] = {0,          1,          0x7FF,      0x800,     0x10000000,
                                        0x10003FFF, 0x1FFFFFFE, 0x1FFFFFFF, 0x0ABCDEF1};
    for (uint8_t length = 0; length <= 8; ++length) {
        for (int remote = 0; remote <= 1; ++remote) {
            onebit_frame frame = {.length = length};
            for (uint8_t k = 0; k < length && !remote; ++k) {
                frame.data[k] = (uint8_t)(0xF7u * (k + 1u) + length);
            }
            frame.flags = (uint8_t)(remote ? ONEBIT_FRAME_REMOTE : 0);
            for (frame.identifier = 0; frame.identifier <= 0x7FF; ++frame.identifier) {
                check_round_trip(&frame);
            }
            frame.flags |= ONEBIT_FRAME_EXTENDED;
            for (size_t k = 0; k < sizeof extended / sizeof *extended; ++k) {
                frame.identifier = extended[k];
                check_round_trip(&frame);
            }
        }
    }
    onebit_frame frame = {.identifier = 0x123, .length = 1};
    for (int byte = 0; byte <= 0xFF; ++byte) {
        frame.data[0] = (uint8_t)byte;
        check_round_trip(&frame);
    }
    TEST_ASSERT_EQUAL(0, dropped());
}

static void test_what_the_protocol_cannot_say_has_no_line(void)
{
    static const onebit_frame frames[] = {
        {.identifier = 0x800},
        {.identifier = 0x20000000, .flags = ONEBIT_FRAME_EXTENDED},
        {.identifier = 0x800, .flags = ONEBIT_FRAME_REMOTE},
        {.length = 9},
        {.length = 255, .flags = ONEBIT_FRAME_EXTENDED},
        {.flags = ONEBIT_FRAME_ERROR},
        {.flags = ONEBIT_FRAME_FLEXIBLE},
    };
    for (size_t k = 0; k < sizeof frames / sizeof *frames; ++k) {
        uint8_t text[SLCAN_LINE_MAX + 1];
        TEST_ASSERT_EQUAL(0, slcan_format(&frames[k], text));
    }
}

static void test_the_manuals_examples(void)
{
    static const struct {
        const char *text;
        onebit_frame frame;
    } examples[] = {
        {"t10021133\r", {0x100, 0, 2, {0x11, 0x33}}},
        {"T0000010021133\r", {0x100, ONEBIT_FRAME_EXTENDED, 2, {0x11, 0x33}}},
        {"r1002\r", {0x100, ONEBIT_FRAME_REMOTE, 2, {0}}},
        {"R000001002\r", {0x100, ONEBIT_FRAME_EXTENDED | ONEBIT_FRAME_REMOTE, 2, {0}}},
        /* Small letters, as some hosts write, and a time stamp of 59,999 ms. */
        {"t7ff1abea5f\r", {0x7FF, 0, 1, {0xAB}}},
        {"t0800EA5F\r", {0x080, 0, 0, {0}}},
        /* A terminal's CR LF: the LF begins the next line. */
        {"\nt0800\r", {0x080, 0, 0, {0}}},
    };
    for (size_t k = 0; k < sizeof examples / sizeof *examples; ++k) {
        TEST_ASSERT_EQUAL_MESSAGE(SLCAN_FRAME, feed(examples[k].text, strlen(examples[k].text)),
                                  examples[k].text);
        check_frame(&examples[k].frame, &line.frame);
    }
}

/* --- lines that are refused --- */

static void test_malformed_lines_are_counted_by_reason(void)
{
    static const struct {
        const char *text;
        enum slcan_status reason;
    } lines[] = {
        {"x\r", SLCAN_UNKNOWN},
        {" t0800\r", SLCAN_UNKNOWN},
        {"d1230\r", SLCAN_UNKNOWN}, /* CAN FD of newer adapters */
        {"\x80\xFF\r", SLCAN_UNKNOWN},
        {"t\r", SLCAN_LENGTH},
        {"t080\r", SLCAN_LENGTH},
        {"T0000008\r", SLCAN_LENGTH},
        {"xxxxxxxxxxxxxxxx\r", SLCAN_UNKNOWN}, /* what the next must not take for its own */
        {"T00000080\r", SLCAN_LENGTH},
        {"t08001\r", SLCAN_LENGTH},
        {"t0801\r", SLCAN_LENGTH},
        {"t0801A\r", SLCAN_LENGTH},
        {"t0801AB1\r", SLCAN_LENGTH},
        {"t0801AB12345\r", SLCAN_LENGTH},
        {"r1232AABB1\r", SLCAN_LENGTH},
        {"O1\r", SLCAN_LENGTH},
        {"S\r", SLCAN_LENGTH},
        {"S66\r", SLCAN_LENGTH},
        {"s00\r", SLCAN_LENGTH},
        {"M0000000\r", SLCAN_LENGTH},
        {"Z11\r", SLCAN_LENGTH},
        {"t0g00\r", SLCAN_DIGIT},
        {"t080/\r", SLCAN_DIGIT},
        {"t080:\r", SLCAN_DIGIT},
        {"t080@\r", SLCAN_DIGIT},
        {"t080`\r", SLCAN_DIGIT},
        {"t0801A \r", SLCAN_DIGIT},
        {"t0801 A\r", SLCAN_DIGIT},
        {"t0801AB12G4\r", SLCAN_DIGIT},
        {"t0\n800\r", SLCAN_DIGIT}, /* LF is passed over at a line's beginning only */
        {"S-\r", SLCAN_DIGIT},
        {"t8000\r", SLCAN_RANGE},
        {"r8000\r", SLCAN_RANGE},
        {"T200000000\r", SLCAN_RANGE},
        {"TFFFFFFFF0\r", SLCAN_RANGE},
        {"t1239001122334455667788\r", SLCAN_RANGE},
        {"t123F\r", SLCAN_RANGE},
        {"r1239\r", SLCAN_RANGE},
        {"T00000000800112233445566771234A\r", SLCAN_OVERLONG},
    };
    uint16_t expected[SLCAN_DROPS] = {0};
    for (size_t k = 0; k < sizeof lines / sizeof *lines; ++k) {
        TEST_ASSERT_EQUAL_MESSAGE(lines[k].reason, feed(lines[k].text, strlen(lines[k].text)),
                                  lines[k].text);
        ++expected[lines[k].reason - SLCAN_UNKNOWN];
        /* The next line is whole again. */
        TEST_ASSERT_EQUAL(SLCAN_FRAME, feed("t1011AB\r", 8));
    }
    TEST_ASSERT_EQUAL_UINT16_ARRAY(expected, parser.dropped, SLCAN_DROPS);
}

static void test_overlong_lines_are_dropped_to_their_end(void)
{
    for (size_t length = SLCAN_LINE_MAX + 1; length <= 600; ++length) {
        for (size_t k = 0; k < length; ++k) {
            TEST_ASSERT_EQUAL(SLCAN_PENDING, slcan_take(&parser, '0', &line));
        }
        TEST_ASSERT_EQUAL(SLCAN_OVERLONG, slcan_take(&parser, '\r', &line));
        TEST_ASSERT_EQUAL(SLCAN_FRAME, feed("t1011AB\r", 8));
    }
    TEST_ASSERT_EQUAL(600 - SLCAN_LINE_MAX, parser.dropped[SLCAN_OVERLONG - SLCAN_UNKNOWN]);
    TEST_ASSERT_EQUAL(600 - SLCAN_LINE_MAX, dropped());
}

static void test_bel_refuses_and_cuts_a_line(void)
{
    TEST_ASSERT_EQUAL(SLCAN_REFUSED, feed("\a", 1));
    TEST_ASSERT_EQUAL(0, dropped());
    TEST_ASSERT_EQUAL(SLCAN_REFUSED, feed("t0800\a", 6));
    TEST_ASSERT_EQUAL(1, parser.dropped[SLCAN_LENGTH - SLCAN_UNKNOWN]);
    TEST_ASSERT_EQUAL(SLCAN_REFUSED, feed("0123456789012345678901234567890\a", 32));
    TEST_ASSERT_EQUAL(1, parser.dropped[SLCAN_OVERLONG - SLCAN_UNKNOWN]);
    TEST_ASSERT_EQUAL(SLCAN_FRAME, feed("t0800\r", 6));
}

static void test_counters_saturate(void)
{
    for (long k = 0; k < 0x10005; ++k) {
        TEST_ASSERT_EQUAL(SLCAN_UNKNOWN, feed("?\r", 2));
    }
    TEST_ASSERT_EQUAL_UINT16(0xFFFF, parser.dropped[0]);
}

/* --- all short lines, and many that are nearly right --- */

static void try_all(char *text, size_t at, size_t length, const char *alphabet, size_t size)
{
    if (at == length) {
        check_line(text, length);
        return;
    }
    for (size_t k = 0; k < size; ++k) {
        text[at] = alphabet[k];
        try_all(text, at + 1, length, alphabet, size);
    }
}

static void test_all_short_lines(void)
{
    char bytes[256];
    char text[8];
    size_t count = 0;
    for (int byte = 0; byte < 256; ++byte) {
        /* What ends a line, and LF at its beginning, have tests of their own. */
        if (byte != '\r' && byte != '\a' && byte != '\n') {
            bytes[count++] = (char)byte;
        }
    }
    check_line("", 0);
    try_all(text, 0, 1, bytes, count);
    try_all(text, 0, 2, bytes, count);
    static const char some[] = "tTrRSsOVFZ0178fG";
    for (size_t length = 3; length <= 5; ++length) {
        try_all(text, 0, length, some, sizeof some - 1);
    }
}

/* xorshift32: a fixed sequence of test data. */
static uint32_t noise = 0x2545F491;
static uint32_t random_below(uint32_t limit)
{
    noise ^= noise << 13;
    noise ^= noise >> 17;
    noise ^= noise << 5;
    return noise % limit;
}

static void test_lines_that_are_nearly_right(void)
{
    static const char likely[] = "0123456789ABCDEFabcdefgGtTrRzZ/:@`\n \xFF";
    for (int round = 0; round < 200000; ++round) {
        onebit_frame frame = {.flags = (uint8_t)random_below(4),
                              .length = (uint8_t)random_below(9)};
        char text[300];
        frame.identifier =
            random_below(2)
                ? random_below(0x800)
                : random_below(frame.flags & ONEBIT_FRAME_EXTENDED ? 0x20000000 : 0x800);
        for (int k = 0; k < 8; ++k) {
            frame.data[k] = (uint8_t)random_below(256);
        }
        print_frame(&frame, text);
        size_t length = strlen(text) - 1;
        for (uint32_t damage = random_below(4); damage > 0; --damage) {
            size_t at = random_below((uint32_t)length + 1);
            char character = likely[random_below(sizeof likely - 1)];
            switch (random_below(3)) {
            case 0: /* another character */
                text[at] = character;
                length += at == length;
                break;
            case 1: /* one more */
                memmove(text + at + 1, text + at, length - at);
                text[at] = character;
                ++length;
                break;
            default: /* cut */
                length = at;
                break;
            }
        }
        if (length == 0 || text[0] != '\n') {
            check_line(text, length);
        }
    }
}

/* Whatever bytes come, in any order, with whatever is in between. */
static void test_noise(void)
{
    for (long k = 0; k < 2000000; ++k) {
        uint8_t byte = (uint8_t)random_below(256);
        if (byte >= 0x80 && byte < 0xF0) {
            byte = (uint8_t) "tTrR0123456789AF"[byte % 16];
        }
        enum slcan_status status = slcan_take(&parser, byte, &line);
        TEST_ASSERT_TRUE(parser.length <= SLCAN_LINE_MAX + 1);
        if (status == SLCAN_FRAME) {
            TEST_ASSERT_TRUE(line.frame.length <= 8);
            TEST_ASSERT_TRUE(line.frame.identifier <=
                             (line.frame.flags & ONEBIT_FRAME_EXTENDED ? 0x1FFFFFFFu : 0x7FFu));
        }
    }
    slcan_take(&parser, '\r', &line);
    TEST_ASSERT_EQUAL(SLCAN_FRAME, feed("t0800\r", 6));
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_round_trip_of_every_kind_length_and_limit);
    RUN_TEST(test_what_the_protocol_cannot_say_has_no_line);
    RUN_TEST(test_the_manuals_examples);
    RUN_TEST(test_malformed_lines_are_counted_by_reason);
    RUN_TEST(test_overlong_lines_are_dropped_to_their_end);
    RUN_TEST(test_bel_refuses_and_cuts_a_line);
    RUN_TEST(test_counters_saturate);
    RUN_TEST(test_all_short_lines);
    RUN_TEST(test_lines_that_are_nearly_right);
    RUN_TEST(test_noise);
    return UNITY_END();
}
