/* sim/log.c: exact bytes, round trips, what others write, what is malformed, what stays on disk. */
#include "log.h"
#include "unity.h"
#include "wire_reference.h"

#include <dirent.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static uint64_t random_state;
static char folder[64];
static char path[128];
static struct problem problem;

static uint32_t random_word(void)
{
    random_state = random_state * 6364136223846793005u + 1442695040888963407u;
    return (uint32_t)(random_state >> 32);
}

/* Every test has its own empty folder and must leave at most bus.log and bus.pcap in it. */
void setUp(void)
{
    random_state = 1;
    problem.text[0] = '\0';
    strcpy(folder, "/tmp/test_log.XXXXXX");
    TEST_ASSERT_NOT_NULL(mkdtemp(folder));
    snprintf(path, sizeof path, "%s/bus.log", folder);
}

static uint32_t files_in_folder(void)
{
    uint32_t count = 0;
    DIR *directory = opendir(folder);
    TEST_ASSERT_NOT_NULL(directory);
    for (struct dirent *entry; (entry = readdir(directory)) != NULL;) {
        count += entry->d_name[0] != '.';
    }
    closedir(directory);
    return count;
}

void tearDown(void)
{
    static const char *const names[] = {"bus.log", "bus.pcap"};
    for (uint32_t k = 0; k < 2; k++) {
        snprintf(path, sizeof path, "%s/%s", folder, names[k]);
        unlink(path);
    }
    TEST_ASSERT_EQUAL_INT_MESSAGE(0, rmdir(folder), "a file was left behind");
}

static void use_pcap(void)
{
    snprintf(path, sizeof path, "%s/bus.pcap", folder);
}

static void write_file(const void *bytes, size_t size)
{
    FILE *file = fopen(path, "wb");
    TEST_ASSERT_NOT_NULL(file);
    TEST_ASSERT_EQUAL_UINT32(size, fwrite(bytes, 1, size, file));
    fclose(file);
}

static size_t read_file(void *bytes, size_t size)
{
    FILE *file = fopen(path, "rb");
    TEST_ASSERT_NOT_NULL(file);
    size_t length = fread(bytes, 1, size, file);
    fclose(file);
    return length;
}

static struct log_writer *open_writer(void)
{
    struct log_writer *writer = log_writer_open(path, &problem);
    TEST_ASSERT_NOT_NULL_MESSAGE(writer, problem.text);
    return writer;
}

static void commit(struct log_writer *writer)
{
    bool written = log_writer_commit(writer, &problem);
    TEST_ASSERT_TRUE_MESSAGE(written, problem.text);
}

static struct log_reader *open_reader(void)
{
    struct log_reader *reader = log_reader_open(path, &problem);
    TEST_ASSERT_NOT_NULL_MESSAGE(reader, problem.text);
    return reader;
}

static void assert_frame(const onebit_frame *expected, const onebit_frame *frame)
{
    TEST_ASSERT_EQUAL_HEX32(expected->identifier, frame->identifier);
    TEST_ASSERT_EQUAL_HEX8(expected->flags, frame->flags);
    TEST_ASSERT_EQUAL_UINT8(expected->length, frame->length);
    TEST_ASSERT_EQUAL_HEX8_ARRAY(expected->data, frame->data, 8);
}

/* The frames of the file are these, and then it ends. */
static void assert_frames(const onebit_frame *frames, uint32_t count)
{
    struct log_reader *reader = open_reader();
    onebit_frame frame;
    for (uint32_t k = 0; k < count; k++) {
        memset(&frame, 0xA5, sizeof frame);
        TEST_ASSERT_EQUAL_INT_MESSAGE(1, log_reader_next(reader, &frame, &problem), problem.text);
        assert_frame(&frames[k], &frame);
    }
    TEST_ASSERT_EQUAL_INT(0, log_reader_next(reader, &frame, &problem));
    TEST_ASSERT_EQUAL_INT(0, log_reader_next(reader, &frame, &problem));
    log_reader_close(reader);
}

/* Frames of every kind that a log can hold. */
static onebit_frame any_frame(void)
{
    onebit_frame frame = wire_reference_frame(random_word);
    uint32_t kind = random_word() % 8u;
    if (kind == 0) {
        frame.flags = ONEBIT_FRAME_ERROR;
        frame.identifier = random_word() >> 3;
    } else if (kind == 1) {
        static const uint8_t lengths[] = {0, 1, 7, 8, 12, 16, 20, 24, 32, 48, 64};
        frame.flags = (uint8_t)((frame.flags & ONEBIT_FRAME_EXTENDED) | ONEBIT_FRAME_FLEXIBLE);
        frame.length = lengths[random_word() % sizeof lengths];
    }
    for (uint32_t k = 0; k < 8; k++) {
        bool has = k < frame.length && !(frame.flags & ONEBIT_FRAME_REMOTE);
        frame.data[k] = has ? (uint8_t)(random_word() >> 24) : 0;
    }
    return frame;
}

/* --- writing --- */

static const onebit_frame samples[] = {
    {0x101, 0, 1, {0x03}},
    {0x080, 0, 0, {0}},
    {0x007, 0, 8, {0x00, 0x11, 0x2A, 0x3B, 0x4C, 0x5D, 0x6E, 0xFF}},
    {0x10004002, ONEBIT_FRAME_EXTENDED, 1, {0xFE}},
    {0x5, ONEBIT_FRAME_EXTENDED, 0, {0}},
    {0x123, ONEBIT_FRAME_REMOTE, 0, {0}},
    {0x123, ONEBIT_FRAME_REMOTE, 1, {0}},
    {0x1ABCDEF0, ONEBIT_FRAME_EXTENDED | ONEBIT_FRAME_REMOTE, 8, {0}},
    {0x88, ONEBIT_FRAME_ERROR, 8, {0, 0, 4, 0, 0, 0, 0, 9}},
    {0x321, ONEBIT_FRAME_FLEXIBLE, 12, {1, 2, 3, 4, 5, 6, 7, 8}},
};
#define SAMPLES (sizeof samples / sizeof samples[0])

static void write_samples(void)
{
    static const double times[SAMPLES] = {0.000123,       0.0000004,  0.0000005, 1,
                                          1.9999994,      1.9999996,  59.5,      1700000000.,
                                          12345678900.25, 12345678901};
    struct log_writer *writer = open_writer();
    for (uint32_t k = 0; k < SAMPLES; k++) {
        log_writer_frame(writer, times[k], &samples[k]);
    }
    commit(writer);
}

static void test_text_is_what_candump_writes(void)
{
    char text[2048];
    write_samples();
    text[read_file(text, sizeof text - 1)] = '\0';
    TEST_ASSERT_EQUAL_STRING("(0000000000.000123) vcan0 101#03\n"
                             "(0000000000.000000) vcan0 080#\n"
                             "(0000000000.000001) vcan0 007#00112A3B4C5D6EFF\n"
                             "(0000000001.000000) vcan0 10004002#FE\n"
                             "(0000000001.999999) vcan0 00000005#\n"
                             "(0000000002.000000) vcan0 123#R\n"
                             "(0000000059.500000) vcan0 123#R1\n"
                             "(1700000000.000000) vcan0 1ABCDEF0#R8\n"
                             "(12345678900.250000) vcan0 20000088#0000040000000009\n"
                             "(12345678901.000000) vcan0 321##0010203040506070800000000\n",
                             text);
    assert_frames(samples, SAMPLES);
}

static void test_pcap_bytes(void)
{
    static const unsigned char expected[] = {
        /* file: magic, version 2.4, zone and accuracy, snap length, link type 227 */
        0xD4, 0xC3, 0xB2, 0xA1, 2, 0, 4, 0, 0, 0, 0, 0, 0, 0, 0, 0, 72, 0, 0, 0, 227, 0, 0, 0,
        /* 1.5 s, 16 bytes; standard 0x101, one byte */
        1, 0, 0, 0, 0x20, 0xA1, 7, 0, 16, 0, 0, 0, 16, 0, 0, 0, 0, 0, 1, 1, 1, 0, 0, 0, 3, 0, 0, 0,
        0, 0, 0, 0,
        /* 2 s; extended remote 0x10004002, two bytes asked for */
        2, 0, 0, 0, 0, 0, 0, 0, 16, 0, 0, 0, 16, 0, 0, 0, 0xD0, 0, 0x40, 2, 2, 0, 0, 0, 0, 0, 0, 0,
        0, 0, 0, 0,
        /* 2 s; error 0x20000088 */
        2, 0, 0, 0, 0, 0, 0, 0, 16, 0, 0, 0, 16, 0, 0, 0, 0x20, 0, 0, 0x88, 1, 0, 0, 0, 7, 0, 0, 0,
        0, 0, 0, 0,
        /* 2 s, 72 bytes; CAN FD 0x321, twelve bytes of which eight are known */
        2, 0, 0, 0, 0, 0, 0, 0, 72, 0, 0, 0, 72, 0, 0, 0, 0, 0, 3, 0x21, 12, 4, 0, 0, 1, 2, 3, 4, 5,
        6, 7, 8, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0,
        0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0};
    static const onebit_frame frames[] = {
        {0x101, 0, 1, {3}},
        {0x10004002, ONEBIT_FRAME_EXTENDED | ONEBIT_FRAME_REMOTE, 2, {0}},
        {0x88, ONEBIT_FRAME_ERROR, 1, {7}},
        {0x321, ONEBIT_FRAME_FLEXIBLE, 12, {1, 2, 3, 4, 5, 6, 7, 8}},
    };
    unsigned char bytes[1024];
    use_pcap();
    struct log_writer *writer = open_writer();
    log_writer_frame(writer, 1.5, &frames[0]);
    log_writer_frame(writer, 2, &frames[1]);
    log_writer_frame(writer, 2, &frames[2]);
    log_writer_frame(writer, 2, &frames[3]);
    commit(writer);
    TEST_ASSERT_EQUAL_UINT32(sizeof expected, read_file(bytes, sizeof bytes));
    TEST_ASSERT_EQUAL_HEX8_ARRAY(expected, bytes, sizeof expected);
    assert_frames(frames, 4);
}

/* Long enough that the buffers of writer and reader fill many times, at every offset. */
static void round_trip(void)
{
    enum { COUNT = 100000 };
    static onebit_frame frames[COUNT];
    struct log_writer *writer = open_writer();
    uint32_t kinds[16] = {0};
    for (uint32_t k = 0; k < COUNT; k++) {
        frames[k] = any_frame();
        kinds[frames[k].flags]++;
        log_writer_frame(writer, k * 1e-4, &frames[k]);
    }
    commit(writer);
    assert_frames(frames, COUNT);
    static const uint32_t all[] = {0, 1, 2, 3, 4, 8, 9};
    for (uint32_t k = 0; k < sizeof all / sizeof all[0]; k++) {
        TEST_ASSERT_GREATER_THAN_UINT32(1000, kinds[all[k]]);
    }
}

static void test_round_trip_text(void)
{
    round_trip();
}

static void test_round_trip_pcap(void)
{
    use_pcap();
    round_trip();
}

static void test_empty_logs(void)
{
    commit(open_writer());
    assert_frames(NULL, 0);
    unlink(path);
    use_pcap();
    commit(open_writer());
    assert_frames(NULL, 0);
}

static void test_name_appears_at_commit_and_replaces(void)
{
    char bytes[64];
    write_file("old", 3);
    struct log_writer *writer = open_writer();
    log_writer_frame(writer, 0, &samples[0]);
    TEST_ASSERT_EQUAL_UINT32(3, read_file(bytes, sizeof bytes));
    TEST_ASSERT_EQUAL_UINT32(2, files_in_folder());
    commit(writer);
    TEST_ASSERT_EQUAL_UINT32(1, files_in_folder());
    assert_frames(samples, 1);
}

static void test_discard_leaves_nothing(void)
{
    char bytes[64];
    struct log_writer *writer = open_writer();
    log_writer_frame(writer, 0, &samples[0]);
    log_writer_discard(writer);
    TEST_ASSERT_EQUAL_UINT32(0, files_in_folder());
    write_file("old", 3);
    log_writer_discard(open_writer());
    TEST_ASSERT_EQUAL_UINT32(1, files_in_folder());
    TEST_ASSERT_EQUAL_UINT32(3, read_file(bytes, sizeof bytes));
    log_writer_discard(NULL);
}

static void assert_problem(const char *expected)
{
    TEST_ASSERT_NULL(strchr(problem.text, '\n'));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(problem.text, expected), problem.text);
}

static void test_what_cannot_be_written(void)
{
    char name[128];
    snprintf(name, sizeof name, "%s/missing/bus.log", folder);
    TEST_ASSERT_NULL(log_writer_open(name, &problem));
    assert_problem("/missing/bus.log: cannot be written: No such file or directory");
    TEST_ASSERT_NULL(log_writer_open(folder, &problem));
    assert_problem(": is a directory");
    TEST_ASSERT_NULL(log_writer_open("", &problem));
    assert_problem("is empty");
    TEST_ASSERT_EQUAL_UINT32(0, files_in_folder());

    /* A directory that takes the name while the log is written. */
    struct log_writer *writer = open_writer();
    TEST_ASSERT_EQUAL_INT(0, mkdir(path, 0700));
    TEST_ASSERT_FALSE(log_writer_commit(writer, &problem));
    assert_problem("bus.log: cannot be written: ");
    TEST_ASSERT_EQUAL_UINT32(1, files_in_folder());
    TEST_ASSERT_EQUAL_INT(0, rmdir(path));
}

/* Devices are reached through links of our own: a writer gone wrong replaces no device of the
 * machine. */
static void make_link(char *link, size_t size, const char *target)
{
    snprintf(link, size, "%s/link", folder);
    TEST_ASSERT_EQUAL_INT(0, symlink(target, link));
}

static void test_full_disk(void)
{
    char link[128];
    make_link(link, sizeof link, "/dev/full");
    struct log_writer *writer = log_writer_open(link, &problem);
    TEST_ASSERT_NOT_NULL(writer);
    for (uint32_t k = 0; k < 10000; k++) {
        log_writer_frame(writer, 0, &samples[0]);
    }
    TEST_ASSERT_FALSE(log_writer_commit(writer, &problem));
    assert_problem("/link: cannot be written: No space left on device");
    TEST_ASSERT_EQUAL_INT(0, unlink(link));
}

/* A rename would put a file in the place of the link or the pipe, or of a device as /dev/null. */
static void test_links_and_pipes_are_written_in_place(void)
{
    char link[128];
    struct stat status;
    make_link(link, sizeof link, path);
    struct log_writer *writer = log_writer_open(link, &problem);
    TEST_ASSERT_NOT_NULL(writer);
    log_writer_frame(writer, 0, &samples[0]);
    commit(writer);
    TEST_ASSERT_EQUAL_INT(0, lstat(link, &status));
    TEST_ASSERT_TRUE(S_ISLNK(status.st_mode));
    TEST_ASSERT_EQUAL_INT(0, unlink(link));
    assert_frames(samples, 1);

    unlink(path);
    char text[64];
    TEST_ASSERT_EQUAL_INT(0, mkfifo(path, 0600));
    int pipe = open(path, O_RDONLY | O_NONBLOCK);
    TEST_ASSERT_TRUE(pipe >= 0);
    writer = open_writer();
    log_writer_frame(writer, 0, &samples[0]);
    commit(writer);
    TEST_ASSERT_EQUAL_INT(33, read(pipe, text, sizeof text));
    close(pipe);
    TEST_ASSERT_EQUAL_INT(0, lstat(path, &status));
    TEST_ASSERT_TRUE(S_ISFIFO(status.st_mode));
}

/* --- reading text --- */

static void test_what_others_write_is_read(void)
{
    static const struct {
        const char *line;
        onebit_frame frame;
    } lines[] = {
        {"(1345212884.318850) vcan0 123#", {0x123, 0, 0, {0}}},
        {"(1345212884.318850)    can10 123#01", {0x123, 0, 1, {1}}},
        {"(0.5) slcan_x.7 7ff#aBcD", {0x7FF, 0, 2, {0xAB, 0xCD}}},
        {"(0) 0 123#01.02.03", {0x123, 0, 3, {1, 2, 3}}},
        {"\t(12.123456789)\tvcan0\t123#R\t", {0x123, ONEBIT_FRAME_REMOTE, 0, {0}}},
        {"(1.0) vcan0 7A1#r", {0x7A1, ONEBIT_FRAME_REMOTE, 0, {0}}},
        {"(1.0) vcan0 123#R0", {0x123, ONEBIT_FRAME_REMOTE, 0, {0}}},
        {"(1.0) vcan0 123#R7", {0x123, ONEBIT_FRAME_REMOTE, 7, {0}}},
        {"(1.0) vcan0 123#R R", {0x123, ONEBIT_FRAME_REMOTE, 0, {0}}},
        {"(1.0) vcan0 123#R8_E T", {0x123, ONEBIT_FRAME_REMOTE, 8, {0}}},
        {"(1.0) vcan0 123#1122334455667788_9", {0x123, 0, 8, {17, 34, 51, 68, 85, 102, 119, 136}}},
        {"(1.0) vcan0 123# R", {0x123, 0, 0, {0}}},
        {"(1.0) vcan0 123#01 T", {0x123, 0, 1, {1}}},
        {"(1.0) vcan0 1FFFFFFF#01", {0x1FFFFFFF, ONEBIT_FRAME_EXTENDED, 1, {1}}},
        {"(1.0) vcan0 00000000#", {0, ONEBIT_FRAME_EXTENDED, 0, {0}}},
        {"(1.0) vcan0 20000080#0000040000000000", {0x80, ONEBIT_FRAME_ERROR, 8, {0, 0, 4}}},
        {"(1.0) vcan0 20000080#", {0x80, ONEBIT_FRAME_ERROR, 0, {0}}},
        {"(1.0) vcan0 3FFFFFFF#", {0x1FFFFFFF, ONEBIT_FRAME_ERROR, 0, {0}}},
        {"(1.0) vcan0 123##0", {0x123, ONEBIT_FRAME_FLEXIBLE, 0, {0}}},
        {"(1.0) vcan0 123##F112233 R", {0x123, ONEBIT_FRAME_FLEXIBLE, 3, {17, 34, 51}}},
        {"(1.0) vcan0 12345678##1"
         "0102030405060708090A0B0C0D0E0F101112131415161718191A1B1C1D1E1F20"
         "2122232425262728292A2B2C2D2E2F303132333435363738393A3B3C3D3E3F40",
         {0x12345678, 9, 64, {1, 2, 3, 4, 5, 6, 7, 8}}},
    };
    enum { LINES = sizeof lines / sizeof lines[0] };
    static const char *const ends[] = {"\n", "\r\n", "\n\n \t\r\n", "\nDROPCOUNT: dropped 3\n"};
    onebit_frame frames[LINES];
    for (uint32_t e = 0; e < sizeof ends / sizeof ends[0]; e++) {
        char text[4096] = "";
        for (uint32_t k = 0; k < LINES; k++) {
            strcat(text, lines[k].line);
            strcat(text, ends[e]);
            frames[k] = lines[k].frame;
        }
        write_file(text, strlen(text));
        assert_frames(frames, LINES);
        /* The last line need not have an end. */
        write_file(text, strlen(text) - strlen(ends[e]));
        assert_frames(frames, LINES);
    }
}

static void test_malformed_lines_are_named(void)
{
    static const struct {
        const char *line;
        const char *wrong;
    } lines[] = {
        {"x", "begins with the time in brackets"},
        {"1.0 vcan0 123#01", "begins with the time in brackets"},
        {"(1.0 vcan0 123#01", "begins with the time in brackets"},
        {"(1.) vcan0 123#01", "begins with the time in brackets"},
        {"(.5) vcan0 123#01", "begins with the time in brackets"},
        {"(-1.5) vcan0 123#01", "begins with the time in brackets"},
        {"()", "begins with the time in brackets"},
        {"(1.0)vcan0 123#01", "begins with the time in brackets"},
        {"(1.0)", "begins with the time in brackets"},
        {"(1.0) vcan0", "the interface's name and the frame"},
        {"(1.0) 123#01", "the interface's name and the frame"},
        {"(1.0) vcan0 12#01", "3 hexadecimal digits"},
        {"(1.0) vcan0 #01", "3 hexadecimal digits"},
        {"(1.0) vcan0 1234#01", "3 hexadecimal digits"},
        {"(1.0) vcan0 123456789#01", "3 hexadecimal digits"},
        {"(1.0) vcan0 12G#01", "3 hexadecimal digits"},
        {"(1.0) vcan0 123", "behind the identifier stands '#'"},
        {"(1.0) vcan0 123 [1] 01", "behind the identifier stands '#'"},
        {"(1.0) vcan0 800#01", "at most 7FF"},
        {"(1.0) vcan0 40000000#01", "at most 1FFFFFFF"},
        {"(1.0) vcan0 80000123#01", "at most 1FFFFFFF"},
        {"(1.0) vcan0 123#0", "two hexadecimal digits"},
        {"(1.0) vcan0 123#0G", "two hexadecimal digits"},
        {"(1.0) vcan0 123#G0", "stand data bytes"},
        {"(1.0) vcan0 123#001122334455667788", "at most 8 data bytes"},
        {"(1.0) vcan0 123##", "the flags of CAN FD"},
        {"(1.0) vcan0 123##G", "the flags of CAN FD"},
        {"(1.0) vcan0 123##0"
         "0000000000000000000000000000000000000000000000000000000000000000"
         "000000000000000000000000000000000000000000000000000000000000000000",
         "at most 64 data bytes"},
        {"(1.0) vcan0 20000080#R", "cannot be a remote frame"},
        {"(1.0) vcan0 123#R9", "stand data bytes"},
        {"(1.0) vcan0 123#R12", "stand data bytes"},
        {"(1.0) vcan0 123#01 X", "stand data bytes"},
        {"(1.0) vcan0 123#01 RT", "stand data bytes"},
        {"(1.0) vcan0 123#01 R T", "stand data bytes"},
        {"(1.0) vcan0 123#01_9", "stand data bytes"},
        {"(1.0) vcan0 123#0011223344556677_8", "9..F"},
    };
    for (uint32_t k = 0; k < sizeof lines / sizeof lines[0]; k++) {
        char text[512];
        char where[256];
        onebit_frame frame;
        snprintf(text, sizeof text, "(0.0) vcan0 123#\n\n%s\n(0.0) vcan0 124#\n", lines[k].line);
        write_file(text, strlen(text));
        struct log_reader *reader = open_reader();
        TEST_ASSERT_EQUAL_INT(1, log_reader_next(reader, &frame, &problem));
        TEST_ASSERT_EQUAL_INT_MESSAGE(-1, log_reader_next(reader, &frame, &problem), lines[k].line);
        snprintf(where, sizeof where, "%s:3: ", path);
        TEST_ASSERT_EQUAL_STRING_LEN(where, problem.text, strlen(where));
        assert_problem(lines[k].wrong);
        log_reader_close(reader);
    }
}

static void test_zero_byte_in_a_line(void)
{
    onebit_frame frame;
    write_file("(1.0) vcan0 123#01\0 T\n", 22);
    struct log_reader *reader = open_reader();
    TEST_ASSERT_EQUAL_INT(-1, log_reader_next(reader, &frame, &problem));
    log_reader_close(reader);
}

static void test_too_long_line(void)
{
    char text[1200];
    onebit_frame frame;
    memset(text, ' ', sizeof text);
    memcpy(text, "(1.0) vcan0 123#01", 18);
    write_file(text, 511);
    struct log_reader *reader = open_reader();
    TEST_ASSERT_EQUAL_INT_MESSAGE(1, log_reader_next(reader, &frame, &problem), problem.text);
    log_reader_close(reader);
    write_file(text, sizeof text);
    reader = open_reader();
    TEST_ASSERT_EQUAL_INT(-1, log_reader_next(reader, &frame, &problem));
    assert_problem(":1: line of more than 512 characters");
    log_reader_close(reader);
}

static void test_what_cannot_be_opened(void)
{
    TEST_ASSERT_NULL(log_reader_open(path, &problem));
    assert_problem("bus.log: cannot open: No such file or directory");
    TEST_ASSERT_NULL(log_reader_open(folder, &problem));
    assert_problem(": cannot read: Is a directory");
}

/* --- reading pcap --- */

static void put(unsigned char *at, uint32_t value, bool big)
{
    for (uint32_t k = 0; k < 4; k++) {
        at[big ? 3 - k : k] = (unsigned char)(value >> (8 * k));
    }
}

/* A file of one packet in the chosen byte order. Returns its size. */
static size_t make_pcap(unsigned char *bytes, bool big, uint32_t magic, uint32_t link_type,
                        uint32_t captured, uint32_t original)
{
    static const unsigned char packet[10] = {0x00, 0x00, 0x01, 0x23, 2, 0, 0, 0, 0xAA, 0x55};
    memset(bytes, 0, 200);
    put(bytes, magic, big);
    bytes[big ? 5 : 4] = 2;
    bytes[big ? 7 : 6] = 4;
    put(bytes + 16, 65535, big);
    put(bytes + 20, link_type, big);
    put(bytes + 32, captured, big);
    put(bytes + 36, original, big);
    memcpy(bytes + 40, packet, sizeof packet);
    return 40 + captured;
}

static void test_pcap_of_both_byte_orders_and_resolutions(void)
{
    static const onebit_frame expected = {0x123, 0, 2, {0xAA, 0x55}};
    unsigned char bytes[200];
    for (uint32_t k = 0; k < 8; k++) {
        uint32_t magic = (k & 2u) ? 0xA1B23C4Du : 0xA1B2C3D4u;
        size_t size = make_pcap(bytes, k & 1u, magic, 227, k & 4u ? 10 : 16, 16);
        write_file(bytes, size); /* a pcap file may have any name */
        assert_frames(&expected, 1);
    }
}

static void test_pcap_can_fd_without_its_flag(void)
{
    static const onebit_frame expected = {0x123, ONEBIT_FRAME_FLEXIBLE, 2, {0xAA, 0x55}};
    unsigned char bytes[200];
    write_file(bytes, make_pcap(bytes, false, 0xA1B2C3D4, 227, 72, 72));
    assert_frames(&expected, 1);
}

static void assert_not_opened(const char *expected)
{
    TEST_ASSERT_NULL(log_reader_open(path, &problem));
    assert_problem(expected);
}

static void test_pcap_of_another_kind_is_refused(void)
{
    unsigned char bytes[200];
    write_file(bytes, make_pcap(bytes, false, 0xA1B2C3D4, 1, 16, 16));
    assert_not_opened("link type 1; a CAN log has 227");
    write_file(bytes, make_pcap(bytes, true, 0xA1B2C3D4, 190, 16, 16));
    assert_not_opened("link type 190; a CAN log has 227");
    write_file(bytes, make_pcap(bytes, true, 0x0A0D0D0A, 227, 16, 16));
    assert_not_opened("is pcapng");
    use_pcap();
    write_file("(0.0) vcan0 123#\n", 17);
    assert_not_opened("is not a pcap file, though named so");
    write_file("", 0);
    assert_not_opened("is not a pcap file, though named so");
}

static void assert_first_packet(const unsigned char *bytes, size_t size, const char *expected)
{
    onebit_frame frame;
    write_file(bytes, size);
    struct log_reader *reader = open_reader();
    TEST_ASSERT_EQUAL_INT(-1, log_reader_next(reader, &frame, &problem));
    assert_problem(": packet 1: ");
    assert_problem(expected);
    log_reader_close(reader);
}

static void test_malformed_packets_are_named(void)
{
    unsigned char bytes[200];
    const uint32_t magic = 0xA1B2C3D4;
    size_t size = make_pcap(bytes, false, magic, 227, 16, 16);
    put(bytes + 32, 0xFFFFFFFF, false);
    assert_first_packet(bytes, size, "longer than any CAN frame");
    put(bytes + 32, 4097, false);
    assert_first_packet(bytes, size, "longer than any CAN frame");
    put(bytes + 32, 4096, false);
    assert_first_packet(bytes, size, "the file ends inside it");
    size = make_pcap(bytes, false, magic, 227, 7, 16);
    assert_first_packet(bytes, size, "shorter than the 8 bytes");
    size = make_pcap(bytes, false, magic, 227, 9, 16);
    assert_first_packet(bytes, size, "data bytes were not captured");
    size = make_pcap(bytes, false, magic, 227, 16, 16);
    bytes[44] = 9;
    assert_first_packet(bytes, size, "at most 8 data bytes");
    bytes[44] = 0x80;
    assert_first_packet(bytes, size, "CAN XL");
    size = make_pcap(bytes, false, magic, 227, 72, 72);
    bytes[44] = 65;
    assert_first_packet(bytes, size, "at most 64 data bytes");
    size = make_pcap(bytes, false, magic, 227, 16, 16);
    bytes[42] = 8;
    assert_first_packet(bytes, size, "at most 7FF");
    bytes[42] = 0;
    bytes[40] = 0x60;
    assert_first_packet(bytes, size, "can be a remote frame");
}

/* Cut anywhere, a pcap file is an error or, between packets, simply shorter. */
static void test_truncated_pcap(void)
{
    unsigned char bytes[2048];
    use_pcap();
    write_samples();
    size_t size = read_file(bytes, sizeof bytes);
    for (size_t cut = 0; cut < size; cut++) {
        write_file(bytes, cut);
        struct log_reader *reader = log_reader_open(path, &problem);
        if (cut < 24) {
            TEST_ASSERT_NULL(reader);
            assert_problem(cut < 4 ? "is not a pcap file" : "ends inside the pcap file header");
            continue;
        }
        TEST_ASSERT_NOT_NULL(reader);
        onebit_frame frame;
        uint32_t count = 0;
        int result;
        while ((result = log_reader_next(reader, &frame, &problem)) == 1) {
            assert_frame(&samples[count], &frame);
            count++;
        }
        /* All samples but the last, which is CAN FD, have 32 bytes. */
        bool whole = (cut - 24) % 32 == 0 && count == (cut - 24) / 32;
        TEST_ASSERT_EQUAL_INT(whole ? 0 : -1, result);
        if (result < 0) {
            assert_problem("the file ends inside");
        }
        log_reader_close(reader);
    }
}

/* Whatever the bytes, the reader ends, says something when it fails, and hands out sane frames. */
static void read_whatever(void)
{
    problem.text[0] = '\0';
    struct log_reader *reader = log_reader_open(path, &problem);
    int result = -1;
    if (reader != NULL) {
        onebit_frame frame;
        while ((result = log_reader_next(reader, &frame, &problem)) == 1) {
            TEST_ASSERT_LESS_OR_EQUAL_UINT32(0x1FFFFFFF, frame.identifier);
            TEST_ASSERT_LESS_OR_EQUAL_UINT8(frame.flags & ONEBIT_FRAME_FLEXIBLE ? 64 : 8,
                                            frame.length);
            TEST_ASSERT_LESS_THAN_UINT8(16, frame.flags);
        }
    }
    if (result < 0) {
        TEST_ASSERT_GREATER_THAN_UINT32(strlen(folder), strlen(problem.text));
    }
    log_reader_close(reader);
}

static void damage(uint32_t rounds)
{
    unsigned char bytes[2048];
    unsigned char copy[2048];
    size_t size = read_file(bytes, sizeof bytes);
    for (uint32_t round = 0; round < rounds; round++) {
        memcpy(copy, bytes, size);
        for (uint32_t k = random_word() % 4u; k < 4; k++) {
            static const char likely[] = "#R_.() \n\r0F8T\xFF";
            uint32_t value = random_word();
            copy[random_word() % size] =
                value & 0x10000u ? (unsigned char)value : (unsigned char)likely[value % 14u];
        }
        write_file(copy, random_word() % 2u ? size : random_word() % size);
        read_whatever();
    }
    for (uint32_t round = 0; round < rounds; round++) {
        size_t random_size = random_word() % sizeof bytes;
        for (size_t k = 0; k < random_size; k++) {
            copy[k] = (unsigned char)(random_word() >> 24);
        }
        memcpy(copy, bytes, random_word() % 48u);
        write_file(copy, random_size);
        read_whatever();
    }
}

static void test_any_bytes_text(void)
{
    write_samples();
    damage(3000);
}

static void test_any_bytes_pcap(void)
{
    use_pcap();
    write_samples();
    damage(3000);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_text_is_what_candump_writes);
    RUN_TEST(test_pcap_bytes);
    RUN_TEST(test_round_trip_text);
    RUN_TEST(test_round_trip_pcap);
    RUN_TEST(test_empty_logs);
    RUN_TEST(test_name_appears_at_commit_and_replaces);
    RUN_TEST(test_discard_leaves_nothing);
    RUN_TEST(test_what_cannot_be_written);
    RUN_TEST(test_full_disk);
    RUN_TEST(test_links_and_pipes_are_written_in_place);
    RUN_TEST(test_what_others_write_is_read);
    RUN_TEST(test_malformed_lines_are_named);
    RUN_TEST(test_zero_byte_in_a_line);
    RUN_TEST(test_too_long_line);
    RUN_TEST(test_what_cannot_be_opened);
    RUN_TEST(test_pcap_of_both_byte_orders_and_resolutions);
    RUN_TEST(test_pcap_can_fd_without_its_flag);
    RUN_TEST(test_pcap_of_another_kind_is_refused);
    RUN_TEST(test_malformed_packets_are_named);
    RUN_TEST(test_truncated_pcap);
    RUN_TEST(test_any_bytes_text);
    RUN_TEST(test_any_bytes_pcap);
    return UNITY_END();
}
