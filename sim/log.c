/*
 * Bus logs of log.h. Touches the file that it is given the path of.
 *
 * Text: one frame a line, as `candump -L` of can-utils writes it and its log2long, canplayer and
 * others read it. pcap: link type 227,
 * https://www.tcpdump.org/linktypes/LINKTYPE_CAN_SOCKETCAN.html, in microseconds, least significant
 * byte first, 16 bytes of packet for a classical frame whatever its length, as Linux itself
 * captures it.
 */
#include "log.h"

#include "output_file.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define BUFFER_BYTES 65536u

#define STANDARD_MAX 0x7FFu
#define EXTENDED_MAX 0x1FFFFFFFu
#define CLASSICAL_DATA_MAX 8u
#define FLEXIBLE_DATA_MAX 64u

/* Flags above the identifier, in both formats (linux/can.h). */
#define SOCKETCAN_EXTENDED 0x80000000u
#define SOCKETCAN_REMOTE 0x40000000u
#define SOCKETCAN_ERROR 0x20000000u

/* Text. The longest line that a frame makes: 64 data bytes of CAN FD with a separator each. */
#define LINE_BYTES_MAX 512u
#define INTERFACE "vcan0"

/* pcap. */
#define PCAP_MICROSECONDS 0xA1B2C3D4u
#define PCAP_NANOSECONDS 0xA1B23C4Du
#define PCAPNG_BLOCK 0x0A0D0D0Au
#define PCAP_LINK_TYPE 227u
#define PCAP_SNAP_LENGTH 72u
#define PCAP_FILE_HEADER 24u
#define PCAP_RECORD_HEADER 16u
#define PCAP_FRAME_HEADER 8u
#define PCAP_FLEXIBLE 0x04u   /* CANFD_FDF, in the byte behind the length */
#define PCAP_EXTRA_LONG 0x80u /* CAN XL, in the length's byte */
#define PCAP_FLEXIBLE_BYTES (PCAP_FRAME_HEADER + FLEXIBLE_DATA_MAX)
#define PCAP_PACKET_MAX 4096u /* above CAN XL's largest; more is not a CAN frame */

static bool ends_with(const char *text, const char *ending)
{
    size_t length = strlen(text);
    size_t ending_length = strlen(ending);
    return length >= ending_length && strcmp(text + length - ending_length, ending) == 0;
}

/* --- writing --- */

struct log_writer {
    struct output_file file;
    bool pcap;
    int error;            /* errno of the first failure, 0 while there is none */
    uint64_t second;      /* the one whose text stands in second_text */
    char second_text[32]; /* "(0000000012." */
    uint32_t second_length;
    size_t count; /* bytes in the buffer */
    unsigned char buffer[BUFFER_BYTES];
};

static void writer_flush(struct log_writer *writer)
{
    if (writer->error == 0 &&
        fwrite(writer->buffer, 1, writer->count, writer->file.stream) != writer->count) {
        writer->error = errno;
    }
    writer->count = 0;
}

/* Room for `bytes` more, at most BUFFER_BYTES. */
static unsigned char *writer_room(struct log_writer *writer, size_t bytes)
{
    if (writer->count + bytes > BUFFER_BYTES) {
        writer_flush(writer);
    }
    return writer->buffer + writer->count;
}

static void put_little(unsigned char *at, uint32_t value)
{
    at[0] = (unsigned char)value;
    at[1] = (unsigned char)(value >> 8);
    at[2] = (unsigned char)(value >> 16);
    at[3] = (unsigned char)(value >> 24);
}

static void put_big(unsigned char *at, uint32_t value)
{
    at[0] = (unsigned char)(value >> 24);
    at[1] = (unsigned char)(value >> 16);
    at[2] = (unsigned char)(value >> 8);
    at[3] = (unsigned char)value;
}

static void writer_pcap_header(struct log_writer *writer)
{
    unsigned char *at = writer_room(writer, PCAP_FILE_HEADER);
    memset(at, 0, PCAP_FILE_HEADER);
    put_little(at, PCAP_MICROSECONDS);
    at[4] = 2; /* version 2.4 */
    at[6] = 4;
    put_little(at + 16, PCAP_SNAP_LENGTH);
    put_little(at + 20, PCAP_LINK_TYPE);
    writer->count += PCAP_FILE_HEADER;
}

struct log_writer *log_writer_open(const char *path, struct problem *problem)
{
    struct log_writer *writer = calloc(1, sizeof *writer);
    if (writer == NULL) {
        problem_set(problem, "%s: not enough memory", path);
        return NULL;
    }
    if (!output_file_open(&writer->file, path, problem)) {
        free(writer);
        return NULL;
    }
    setvbuf(writer->file.stream, NULL, _IONBF, 0); /* the writer has a buffer of its own */
    writer->pcap = ends_with(path, ".pcap");
    writer->second = UINT64_MAX;
    if (writer->pcap) {
        writer_pcap_header(writer);
    }
    return writer;
}

static const char hexadecimal[] = "0123456789ABCDEF";

static char *put_hexadecimal(char *at, uint32_t value, uint32_t digits)
{
    for (uint32_t shift = 4u * digits; shift != 0;) {
        shift -= 4u;
        *at++ = hexadecimal[(value >> shift) & 0xFu];
    }
    return at;
}

/* The byte k of a frame: onebit_frame keeps eight, of more only the number is known. */
static uint8_t data_byte(const onebit_frame *frame, uint32_t k)
{
    return k < CLASSICAL_DATA_MAX ? frame->data[k] : 0;
}

static uint32_t written_length(const onebit_frame *frame)
{
    uint32_t most =
        (frame->flags & ONEBIT_FRAME_FLEXIBLE) != 0 ? FLEXIBLE_DATA_MAX : CLASSICAL_DATA_MAX;
    return frame->length < most ? frame->length : most;
}

static char *put_time(struct log_writer *writer, char *at, uint64_t second, uint32_t microsecond)
{
    /* Many frames share a second; its division into ten digits is done once. */
    if (second != writer->second) {
        writer->second = second;
        writer->second_length = (uint32_t)snprintf(writer->second_text, sizeof writer->second_text,
                                                   "(%010" PRIu64 ".", second);
    }
    memcpy(at, writer->second_text, writer->second_length);
    at += writer->second_length;
    for (uint32_t k = 6; k-- > 0;) {
        at[k] = (char)('0' + microsecond % 10u);
        microsecond /= 10u;
    }
    return at + 6;
}

static void write_text(struct log_writer *writer, uint64_t second, uint32_t microsecond,
                       const onebit_frame *frame)
{
    char *start = (char *)writer_room(writer, LINE_BYTES_MAX);
    char *at = put_time(writer, start, second, microsecond);
    memcpy(at, ") " INTERFACE " ", sizeof INTERFACE + 2u);
    at += sizeof INTERFACE + 2u;
    if ((frame->flags & ONEBIT_FRAME_ERROR) != 0) {
        at = put_hexadecimal(at, (frame->identifier & EXTENDED_MAX) | SOCKETCAN_ERROR, 8);
    } else if ((frame->flags & ONEBIT_FRAME_EXTENDED) != 0) {
        at = put_hexadecimal(at, frame->identifier & EXTENDED_MAX, 8);
    } else {
        at = put_hexadecimal(at, frame->identifier & STANDARD_MAX, 3);
    }
    *at++ = '#';
    uint32_t length = written_length(frame);
    if ((frame->flags & ONEBIT_FRAME_REMOTE) != 0) {
        *at++ = 'R';
        if (length > 0) {
            *at++ = (char)('0' + length);
        }
    } else {
        if ((frame->flags & ONEBIT_FRAME_FLEXIBLE) != 0) {
            *at++ = '#';
            *at++ = '0'; /* neither bit rate switch nor error state: onebit_frame has no room */
        }
        for (uint32_t k = 0; k < length; k++) {
            at = put_hexadecimal(at, data_byte(frame, k), 2);
        }
    }
    *at++ = '\n';
    writer->count += (size_t)(at - start);
}

static void write_pcap(struct log_writer *writer, uint64_t second, uint32_t microsecond,
                       const onebit_frame *frame)
{
    bool flexible = (frame->flags & ONEBIT_FRAME_FLEXIBLE) != 0;
    bool remote = (frame->flags & ONEBIT_FRAME_REMOTE) != 0;
    bool error = (frame->flags & ONEBIT_FRAME_ERROR) != 0;
    bool extended = (frame->flags & ONEBIT_FRAME_EXTENDED) != 0;
    uint32_t packet = PCAP_FRAME_HEADER + (flexible ? FLEXIBLE_DATA_MAX : CLASSICAL_DATA_MAX);
    uint32_t length = written_length(frame);
    uint32_t identifier = frame->identifier & (extended || error ? EXTENDED_MAX : STANDARD_MAX);
    identifier |= (extended && !error ? SOCKETCAN_EXTENDED : 0u) |
                  (remote ? SOCKETCAN_REMOTE : 0u) | (error ? SOCKETCAN_ERROR : 0u);

    unsigned char *at = writer_room(writer, PCAP_RECORD_HEADER + packet);
    put_little(at, (uint32_t)second); /* the format's 32 bits: wraps after 136 years */
    put_little(at + 4, microsecond);
    put_little(at + 8, packet);
    put_little(at + 12, packet);
    put_big(at + 16, identifier);
    at[20] = (unsigned char)length;
    at[21] = flexible ? PCAP_FLEXIBLE : 0u;
    at[22] = 0;
    at[23] = 0;
    uint32_t known = remote ? 0 : length;
    for (uint32_t k = 0; k < CLASSICAL_DATA_MAX; k++) {
        at[24 + k] = k < known ? frame->data[k] : 0u;
    }
    if (flexible) {
        memset(at + 24 + CLASSICAL_DATA_MAX, 0, FLEXIBLE_DATA_MAX - CLASSICAL_DATA_MAX);
    }
    writer->count += PCAP_RECORD_HEADER + packet;
}

void log_writer_frame(struct log_writer *writer, double seconds, const onebit_frame *frame)
{
    /* To the nearest microsecond. Up to 2^53 of them the sum is exact, the conversion to 2^63. */
    uint64_t time = (uint64_t)(seconds * 1e6 + 0.5);
    uint64_t second = time / 1000000u;
    uint32_t microsecond = (uint32_t)(time - second * 1000000u);
    if (writer->pcap) {
        write_pcap(writer, second, microsecond, frame);
    } else {
        write_text(writer, second, microsecond, frame);
    }
}

bool log_writer_commit(struct log_writer *writer, struct problem *problem)
{
    writer_flush(writer);
    bool written;
    if (writer->error != 0) {
        written = problem_set(problem, "%s: cannot be written: %s", writer->file.path,
                              strerror(writer->error));
        output_file_discard(&writer->file);
    } else {
        written = output_file_commit(&writer->file, problem);
    }
    free(writer);
    return written;
}

void log_writer_discard(struct log_writer *writer)
{
    if (writer != NULL) {
        output_file_discard(&writer->file);
        free(writer);
    }
}

/* --- reading --- */

struct log_reader {
    int file;
    char *path;
    bool pcap;
    bool big_endian; /* pcap: the headers' byte order */
    uint64_t line;   /* text: of the line last read; pcap: of the packet */
    bool end;        /* the file has no more than what the buffer holds */
    size_t start;    /* first byte of the buffer that is not used up */
    size_t count;    /* bytes in the buffer from there */
    unsigned char buffer[BUFFER_BYTES];
};

/*
 * Brings `bytes` (at most BUFFER_BYTES) together at buffer + start, or as many as the file still
 * has. False and *problem when reading fails.
 */
static bool reader_fill(struct log_reader *reader, size_t bytes, struct problem *problem)
{
    if (reader->count < bytes && reader->start > 0) {
        memmove(reader->buffer, reader->buffer + reader->start, reader->count);
        reader->start = 0;
    }
    while (reader->count < bytes && !reader->end) {
        ssize_t result =
            read(reader->file, reader->buffer + reader->count, BUFFER_BYTES - reader->count);
        if (result > 0) {
            reader->count += (size_t)result;
        } else if (result == 0) {
            reader->end = true;
        } else if (errno != EINTR) {
            return problem_set(problem, "%s: cannot read: %s", reader->path, strerror(errno));
        }
    }
    return true;
}

static const unsigned char *reader_take(struct log_reader *reader, size_t bytes)
{
    const unsigned char *at = reader->buffer + reader->start;
    reader->start += bytes;
    reader->count -= bytes;
    return at;
}

static uint32_t get_little(const unsigned char *at)
{
    return (uint32_t)at[3] << 24 | (uint32_t)at[2] << 16 | (uint32_t)at[1] << 8 | at[0];
}

static uint32_t get_big(const unsigned char *at)
{
    return (uint32_t)at[0] << 24 | (uint32_t)at[1] << 16 | (uint32_t)at[2] << 8 | at[3];
}

/* A field of a pcap header, which has the byte order of the machine that wrote it. */
static uint32_t get_header(const struct log_reader *reader, const unsigned char *at)
{
    return reader->big_endian ? get_big(at) : get_little(at);
}

static bool is_pcap_magic(uint32_t number)
{
    return number == PCAP_MICROSECONDS || number == PCAP_NANOSECONDS;
}

/* Tells the formats apart by the first bytes, so that a pcap file may have any name. */
static bool reader_begin(struct log_reader *reader, struct problem *problem)
{
    const char *path = reader->path;
    if (!reader_fill(reader, PCAP_FILE_HEADER, problem)) {
        return false;
    }
    const unsigned char *at = reader->buffer;
    uint32_t magic = reader->count >= 4u ? get_little(at) : 0;
    if (magic == PCAPNG_BLOCK) {
        return problem_set(problem, "%s: is pcapng; convert it with `editcap -F pcap`", path);
    }
    reader->big_endian = reader->count >= 4u && is_pcap_magic(get_big(at));
    reader->pcap = reader->big_endian || is_pcap_magic(magic);
    if (!reader->pcap) {
        if (ends_with(path, ".pcap")) {
            return problem_set(problem, "%s: is not a pcap file, though named so", path);
        }
        return true;
    }
    if (reader->count < PCAP_FILE_HEADER) {
        return problem_set(problem, "%s: ends inside the pcap file header", path);
    }
    /* Above the link type stand flags about a frame check sequence, which CAN has not. */
    uint32_t link_type = get_header(reader, at + 20) & 0xFFFFu;
    if (link_type != PCAP_LINK_TYPE) {
        return problem_set(problem, "%s: link type %" PRIu32 "; a CAN log has 227 (SocketCAN)",
                           path, link_type);
    }
    reader_take(reader, PCAP_FILE_HEADER);
    return true;
}

struct log_reader *log_reader_open(const char *path, struct problem *problem)
{
    struct log_reader *reader = calloc(1, sizeof *reader);
    char *copy = malloc(strlen(path) + 1u);
    if (reader == NULL || copy == NULL) {
        problem_set(problem, "%s: not enough memory", path);
        free(reader);
        free(copy);
        return NULL;
    }
    reader->path = strcpy(copy, path);
    reader->file = open(path, O_RDONLY);
    if (reader->file < 0) {
        problem_set(problem, "%s: cannot open: %s", path, strerror(errno));
        free(copy);
        free(reader);
        return NULL;
    }
    if (!reader_begin(reader, problem)) {
        log_reader_close(reader);
        return NULL;
    }
    return reader;
}

void log_reader_close(struct log_reader *reader)
{
    if (reader != NULL) {
        close(reader->file);
        free(reader->path);
        free(reader);
    }
}

/* What is left of a line of text. */
struct line {
    const char *at;
    const char *end;
};

static bool at_space(const struct line *line)
{
    return line->at < line->end && (*line->at == ' ' || *line->at == '\t');
}

static void skip_space(struct line *line)
{
    while (at_space(line)) {
        line->at++;
    }
}

/* Takes the character if it is the next one. */
static bool take(struct line *line, char character)
{
    if (line->at < line->end && *line->at == character) {
        line->at++;
        return true;
    }
    return false;
}

static bool take_digits(struct line *line)
{
    const char *start = line->at;
    while (line->at < line->end && *line->at >= '0' && *line->at <= '9') {
        line->at++;
    }
    return line->at > start;
}

/* Value of the next character as a hexadecimal digit, 16 if it is none. */
static uint32_t peek_hexadecimal(const struct line *line)
{
    char c = line->at < line->end ? *line->at : '\0';
    if (c >= '0' && c <= '9') {
        return (uint32_t)(c - '0');
    }
    if (c >= 'A' && c <= 'F') {
        return (uint32_t)(c - 'A') + 10u;
    }
    if (c >= 'a' && c <= 'f') {
        return (uint32_t)(c - 'a') + 10u;
    }
    return 16u;
}

/* The readers of a line's parts return null, or what is wrong. */

static const char *read_identifier(struct line *line, onebit_frame *frame)
{
    uint32_t identifier = 0;
    uint32_t digits = 0;
    for (uint32_t digit; digits < 9u && (digit = peek_hexadecimal(line)) < 16u; digits++) {
        identifier = identifier << 4 | digit;
        line->at++;
    }
    if (digits != 3u && digits != 8u) {
        return "the identifier has 3 hexadecimal digits (standard) or 8 (extended)";
    }
    if (!take(line, '#')) {
        return "behind the identifier stands '#'";
    }
    if (digits == 3u) {
        if (identifier > STANDARD_MAX) {
            return "a standard identifier is at most 7FF";
        }
        frame->identifier = identifier;
        return NULL;
    }
    if ((identifier & ~(EXTENDED_MAX | SOCKETCAN_ERROR)) != 0) {
        return "an extended identifier is at most 1FFFFFFF, or 3FFFFFFF in an error frame";
    }
    frame->flags = (identifier & SOCKETCAN_ERROR) != 0 ? ONEBIT_FRAME_ERROR : ONEBIT_FRAME_EXTENDED;
    frame->identifier = identifier & EXTENDED_MAX;
    return NULL;
}

/* Behind `R`: nothing or the length, one digit. */
static const char *read_remote(struct line *line, onebit_frame *frame)
{
    if ((frame->flags & ONEBIT_FRAME_ERROR) != 0) {
        return "an error frame cannot be a remote frame";
    }
    frame->flags |= ONEBIT_FRAME_REMOTE;
    uint32_t length = peek_hexadecimal(line);
    if (length <= CLASSICAL_DATA_MAX) {
        frame->length = (uint8_t)length;
        line->at++;
    }
    return NULL;
}

static const char *read_data(struct line *line, onebit_frame *frame, uint32_t most)
{
    uint32_t length = 0;
    for (uint32_t high; (high = peek_hexadecimal(line)) < 16u; length++) {
        line->at++;
        uint32_t low = peek_hexadecimal(line);
        if (low > 15u) {
            return "data bytes have two hexadecimal digits each";
        }
        line->at++;
        if (length == most) {
            return most == CLASSICAL_DATA_MAX
                       ? "a classical frame has at most 8 data bytes (CAN FD is written '##')"
                       : "a CAN FD frame has at most 64 data bytes";
        }
        if (length < CLASSICAL_DATA_MAX) {
            frame->data[length] = (uint8_t)(high << 4 | low);
        }
        take(line, '.'); /* can-utils allow it between bytes */
    }
    frame->length = (uint8_t)length;
    return NULL;
}

static const char *read_content(struct line *line, onebit_frame *frame)
{
    const char *wrong = NULL;
    if (take(line, 'R') || take(line, 'r')) {
        wrong = read_remote(line, frame);
    } else if (take(line, '#')) {
        if (peek_hexadecimal(line) > 15u) {
            return "behind '##' stands one hexadecimal digit, the flags of CAN FD";
        }
        line->at++;
        frame->flags |= ONEBIT_FRAME_FLEXIBLE;
        return read_data(line, frame, FLEXIBLE_DATA_MAX);
    } else {
        wrong = read_data(line, frame, CLASSICAL_DATA_MAX);
    }
    /* A length code above 8 in a frame of 8 bytes: newer can-utils write it behind '_'. */
    if (wrong == NULL && frame->length == CLASSICAL_DATA_MAX && take(line, '_')) {
        if (peek_hexadecimal(line) < 9u || peek_hexadecimal(line) > 15u) {
            return "behind '_' stands a length code, 9..F";
        }
        line->at++;
    }
    return wrong;
}

/* (SECONDS.FRACTION) INTERFACE FRAME [DIRECTION]; the line is not empty. */
static const char *read_line(struct line *line, onebit_frame *frame)
{
    skip_space(line);
    if (!take(line, '(') || !take_digits(line) || (take(line, '.') && !take_digits(line)) ||
        !take(line, ')') || !at_space(line)) {
        return "the line begins with the time in brackets, as (1700000000.000000)";
    }
    skip_space(line);
    const char *name = line->at;
    while (line->at < line->end && !at_space(line)) {
        line->at++;
    }
    if (line->at == name || !at_space(line)) {
        return "behind the time stand the interface's name and the frame";
    }
    skip_space(line);
    *frame = (onebit_frame){0};
    const char *wrong = read_identifier(line, frame);
    if (wrong == NULL) {
        wrong = read_content(line, frame);
    }
    if (wrong != NULL) {
        return wrong;
    }
    if (at_space(line)) {
        skip_space(line);
        if (take(line, 'R') || take(line, 'T')) {
            skip_space(line);
        }
    }
    if (line->at != line->end) {
        return "behind the identifier's '#' stand data bytes, 'R' or '#', then nothing or ' R', ' "
               "T'";
    }
    return NULL;
}

/* Finds the next line, without its end of line. 1, 0 at the end of the file, -1 and *problem. */
static int next_line(struct log_reader *reader, struct line *line, struct problem *problem)
{
    if (!reader_fill(reader, LINE_BYTES_MAX, problem)) {
        return -1;
    }
    if (reader->count == 0) {
        return 0;
    }
    reader->line++;
    const unsigned char *start = reader->buffer + reader->start;
    size_t searched = reader->count < LINE_BYTES_MAX ? reader->count : LINE_BYTES_MAX;
    const unsigned char *newline = memchr(start, '\n', searched);
    if (newline == NULL && searched == LINE_BYTES_MAX) {
        problem_set(problem, "%s:%" PRIu64 ": line of more than %u characters; is it a bus log?",
                    reader->path, reader->line, LINE_BYTES_MAX);
        return -1;
    }
    size_t length = newline == NULL ? searched : (size_t)(newline - start);
    line->at = (const char *)reader_take(reader, length + (newline == NULL ? 0u : 1u));
    line->end = line->at + length;
    while (line->end > line->at &&
           (line->end[-1] == '\r' || line->end[-1] == ' ' || line->end[-1] == '\t')) {
        line->end--;
    }
    return 1;
}

/* candump with -d notes between the frames how many the socket lost. */
static bool is_note(const struct line *line)
{
    static const char note[] = "DROPCOUNT:";
    size_t length = sizeof note - 1u;
    return (size_t)(line->end - line->at) >= length && memcmp(line->at, note, length) == 0;
}

static int next_text(struct log_reader *reader, onebit_frame *frame, struct problem *problem)
{
    struct line line;
    int result;
    do {
        result = next_line(reader, &line, problem);
    } while (result > 0 && (line.at == line.end || is_note(&line)));
    if (result > 0) {
        const char *wrong = read_line(&line, frame);
        if (wrong != NULL) {
            problem_set(problem, "%s:%" PRIu64 ": %s", reader->path, reader->line, wrong);
            return -1;
        }
    }
    return result;
}

static int pcap_problem(const struct log_reader *reader, struct problem *problem, const char *wrong)
{
    problem_set(problem, "%s: packet %" PRIu64 ": %s", reader->path, reader->line, wrong);
    return -1;
}

/* A packet's bytes as a frame; null, or what is wrong. */
static const char *read_packet(const unsigned char *at, uint32_t captured, uint32_t original,
                               onebit_frame *frame)
{
    if (captured < PCAP_FRAME_HEADER) {
        return "shorter than the 8 bytes before a CAN frame's data";
    }
    if ((at[4] & PCAP_EXTRA_LONG) != 0) {
        return "is a CAN XL frame, which is not read";
    }
    uint32_t identifier = get_big(at);
    uint32_t length = at[4];
    bool error = (identifier & SOCKETCAN_ERROR) != 0;
    bool remote = (identifier & SOCKETCAN_REMOTE) != 0;
    bool extended = (identifier & SOCKETCAN_EXTENDED) != 0;
    /* Older writers leave the flag out and tell CAN FD by its packet's size alone. */
    bool flexible = (at[5] & PCAP_FLEXIBLE) != 0 || original == PCAP_FLEXIBLE_BYTES;
    identifier &= EXTENDED_MAX;
    if (length > (flexible ? FLEXIBLE_DATA_MAX : CLASSICAL_DATA_MAX)) {
        return flexible ? "a CAN FD frame has at most 64 data bytes"
                        : "a classical frame has at most 8 data bytes";
    }
    if (!extended && !error && identifier > STANDARD_MAX) {
        return "a standard identifier is at most 7FF";
    }
    if (remote && (error || flexible)) {
        return "neither an error frame nor a CAN FD frame can be a remote frame";
    }
    uint32_t kept = length < CLASSICAL_DATA_MAX ? length : CLASSICAL_DATA_MAX;
    if (!remote && captured - PCAP_FRAME_HEADER < kept) {
        return "its data bytes were not captured";
    }
    *frame = (onebit_frame){0};
    frame->identifier = identifier;
    frame->flags =
        (uint8_t)((extended && !error ? ONEBIT_FRAME_EXTENDED : 0u) |
                  (remote ? ONEBIT_FRAME_REMOTE : 0u) | (error ? ONEBIT_FRAME_ERROR : 0u) |
                  (flexible ? ONEBIT_FRAME_FLEXIBLE : 0u));
    frame->length = (uint8_t)length;
    if (!remote) {
        memcpy(frame->data, at + PCAP_FRAME_HEADER, kept);
    }
    return NULL;
}

static int next_pcap(struct log_reader *reader, onebit_frame *frame, struct problem *problem)
{
    if (!reader_fill(reader, PCAP_RECORD_HEADER, problem)) {
        return -1;
    }
    if (reader->count == 0) {
        return 0;
    }
    reader->line++;
    if (reader->count < PCAP_RECORD_HEADER) {
        return pcap_problem(reader, problem, "the file ends inside its header");
    }
    const unsigned char *header = reader_take(reader, PCAP_RECORD_HEADER);
    uint32_t captured = get_header(reader, header + 8);
    uint32_t original = get_header(reader, header + 12);
    if (captured > PCAP_PACKET_MAX) {
        return pcap_problem(reader, problem, "is longer than any CAN frame; the file is damaged");
    }
    if (!reader_fill(reader, captured, problem)) {
        return -1;
    }
    if (reader->count < captured) {
        return pcap_problem(reader, problem, "the file ends inside it");
    }
    const char *wrong = read_packet(reader_take(reader, captured), captured, original, frame);
    return wrong == NULL ? 1 : pcap_problem(reader, problem, wrong);
}

int log_reader_next(struct log_reader *reader, onebit_frame *frame, struct problem *problem)
{
    return reader->pcap ? next_pcap(reader, frame, problem) : next_text(reader, frame, problem);
}
