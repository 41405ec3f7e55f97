/*
 * Reads a scenario file. Every key stands once, in the table of its section, with the function that
 * reads and checks its value. Keys are read in the order of the tables, whatever their order in the
 * file, so that a check may use what stands above it. Touches the file and the heap.
 */
#include "scenario.h"

#include "onebit_limits.h"

#include <errno.h>
#include <math.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <yaml.h>

#define PLACE_DEPTH_MAX 8          /* topology.graphs[1].edges[2][1] is the deepest: 5 */
#define THRESHOLD_BOUND_MAX 4.0    /* (|c| + M) / sigma: beyond, the noise's CDF is flat */
#define ESTIMATOR_GAIN_MAX 65536.0 /* beta / sigma: the library's range */
#define CONTROL_GAIN_MAX 4e9       /* gamma sigma: the library's range ends at 2^32 */
#define RATIO_MIN 1e-6             /* of beta, M over sigma, gamma sigma: fixed point holds it */
#define COMPRESSED_ROUNDING 1e-12  /* relative, of K2 x against M */
#define CLOCK_LAST UINT32_MAX      /* a run ends at t0 + 1 + steps: the clock never returns */
#define ROW_SUM_ROUNDING 1e-9      /* of a row of the transition matrix */

struct reader {
    struct scenario *scenario;
    struct problem *problem;
    yaml_document_t document;

    /* Where the value being read stands: keys and, where the key is null, places in lists. */
    struct {
        const char *key;
        size_t index;
    } place[PLACE_DEPTH_MAX];
    size_t depth;

    /* The topology's parts, until topology_build has them. */
    uint32_t graph_count;
    struct edge **edges;
    uint32_t *edge_counts;
    double *transition;
};

/* A key of a section. Tables end with a null key. */
struct field {
    const char *key;
    bool (*read)(struct reader *reader, const yaml_node_t *node, const struct field *field);
    const struct field *fields; /* of a section */
    size_t offset;              /* of the value in struct scenario */
    bool optional;
};

/* Refusals */

static void enter(struct reader *reader, const char *key, size_t index)
{
    reader->place[reader->depth].key = key;
    reader->place[reader->depth].index = index;
    reader->depth++;
}

static void leave(struct reader *reader)
{
    reader->depth--;
}

__attribute__((format(printf, 3, 4))) static bool
refuse(struct reader *reader, const yaml_node_t *node, const char *format, ...)
{
    char place[PLACE_DEPTH_MAX * 48] = "";
    size_t length = 0;
    for (size_t k = 0; k < reader->depth; k++) {
        const char *key = reader->place[k].key;
        int written = key != NULL ? snprintf(place + length, sizeof place - length, "%s%.40s",
                                             k > 0 ? "." : "", key)
                                  : snprintf(place + length, sizeof place - length, "[%zu]",
                                             reader->place[k].index + 1);
        length += (size_t)written;
    }
    char what[320];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(what, sizeof what, format, arguments);
    va_end(arguments);
    return problem_set(reader->problem, "%s:%zu: %s%s%s", reader->scenario->path,
                       node->start_mark.line + 1, place, length > 0 ? ": " : "", what);
}

static bool refuse_memory(struct reader *reader)
{
    return problem_set(reader->problem, "%s: too large for this machine's memory",
                       reader->scenario->path);
}

/* What a person sees at a node: a value in quotes, else what kind of node it is. */
struct sight {
    char text[64];
};

static struct sight see(const yaml_node_t *node)
{
    struct sight sight;
    if (node->type == YAML_SCALAR_NODE) {
        bool empty = node->data.scalar.length == 0;
        snprintf(sight.text, sizeof sight.text, empty ? "nothing%s" : "'%.40s'",
                 (const char *)node->data.scalar.value);
    } else {
        snprintf(sight.text, sizeof sight.text, "%s",
                 node->type == YAML_SEQUENCE_NODE ? "a list" : "a mapping");
    }
    return sight;
}

/* Nodes */

static const yaml_node_t *node_of(struct reader *reader, int number)
{
    return yaml_document_get_node(&reader->document, number);
}

static size_t list_length(const yaml_node_t *list)
{
    return (size_t)(list->data.sequence.items.top - list->data.sequence.items.start);
}

static const yaml_node_t *item_of(struct reader *reader, const yaml_node_t *list, size_t index)
{
    return node_of(reader, list->data.sequence.items.start[index]);
}

static bool is_word(const yaml_node_t *node, const char *word)
{
    return node->type == YAML_SCALAR_NODE && node->data.scalar.length == strlen(word) &&
           memcmp(node->data.scalar.value, word, node->data.scalar.length) == 0;
}

/* The value of a key of a mapping, null if it has none. */
static const yaml_node_t *value_of(struct reader *reader, const yaml_node_t *mapping,
                                   const char *key)
{
    const yaml_node_pair_t *pair = mapping->data.mapping.pairs.start;
    for (; pair < mapping->data.mapping.pairs.top; pair++) {
        if (is_word(node_of(reader, pair->key), key)) {
            return node_of(reader, pair->value);
        }
    }
    return NULL;
}

/* Single values */

/*
 * The text of a plain scalar of these characters, null if the node is none. YAML 1.1 reads 010 as
 * octal, which nobody means: it is no number here.
 */
static const char *number_text(const yaml_node_t *node, const char *characters)
{
    if (node->type != YAML_SCALAR_NODE || node->data.scalar.style != YAML_PLAIN_SCALAR_STYLE ||
        node->data.scalar.length == 0) {
        return NULL;
    }
    const char *text = (const char *)node->data.scalar.value;
    const char *digits = text + strspn(text, "+-");
    bool octal = digits[0] == '0' && digits[1] >= '0' && digits[1] <= '9';
    return !octal && strspn(text, characters) == node->data.scalar.length ? text : NULL;
}

static bool read_any(struct reader *reader, const yaml_node_t *node, double *value)
{
    const char *text = number_text(node, "0123456789+-.eE");
    char *end = NULL;
    double number = text != NULL ? strtod(text, &end) : 0;
    if (text == NULL || *end != '\0' || !isfinite(number)) {
        return refuse(reader, node, "must be a finite decimal number, not %s", see(node).text);
    }
    *value = number;
    return true;
}

static bool read_integer(struct reader *reader, const yaml_node_t *node, uint32_t least,
                         uint32_t most, uint32_t *value)
{
    const char *text = number_text(node, "0123456789");
    unsigned long long number = text != NULL ? strtoull(text, NULL, 10) : 0;
    if (text == NULL || number < least || number > most) {
        return refuse(reader, node, "must be a whole number from %u to %u, not %s", least, most,
                      see(node).text);
    }
    *value = (uint32_t)number;
    return true;
}

/* 0 for the first word, 1 for the second. */
static bool read_choice(struct reader *reader, const yaml_node_t *node, const char *first,
                        const char *second, uint8_t *choice)
{
    *choice = is_word(node, second) ? 1 : 0;
    return is_word(node, first) || is_word(node, second) ||
           refuse(reader, node, "must be %s or %s, not %s", first, second, see(node).text);
}

static void *target(struct reader *reader, const struct field *field)
{
    return (char *)reader->scenario + field->offset;
}

static bool read_number(struct reader *reader, const yaml_node_t *node, const struct field *field)
{
    return read_any(reader, node, target(reader, field));
}

static bool read_positive(struct reader *reader, const yaml_node_t *node, const struct field *field)
{
    double *value = target(reader, field);
    return read_any(reader, node, value) &&
           (*value > 0 || refuse(reader, node, "must be above 0, not %s", see(node).text));
}

/* Lists, rows and matrices */

static bool check_list(struct reader *reader, const yaml_node_t *node, size_t least, size_t most,
                       const char *items)
{
    if (node->type != YAML_SEQUENCE_NODE) {
        return refuse(reader, node, "must be a list of %s, not %s", items, see(node).text);
    }
    size_t length = list_length(node);
    if (length < least) {
        return refuse(reader, node, "has %zu %s, must have %s%zu", length, items,
                      least < most ? "at least " : "", least);
    }
    return length <= most || refuse(reader, node, "has %zu %s, must have %s%zu", length, items,
                                    least < most ? "at most " : "", most);
}

static bool read_row(struct reader *reader, const yaml_node_t *node, size_t columns, double *row)
{
    bool good = check_list(reader, node, columns, columns, "numbers");
    for (size_t k = 0; good && k < columns; k++) {
        enter(reader, NULL, k);
        good = read_any(reader, item_of(reader, node, k), &row[k]);
        if (good) {
            leave(reader);
        }
    }
    return good;
}

/* All rows of a list that check_list has passed. */
static bool read_rows(struct reader *reader, const yaml_node_t *node, size_t columns,
                      double **matrix)
{
    size_t rows = list_length(node);
    *matrix = calloc(rows * columns, sizeof **matrix);
    bool good = *matrix != NULL || refuse_memory(reader);
    for (size_t k = 0; good && k < rows; k++) {
        enter(reader, NULL, k);
        good = read_row(reader, item_of(reader, node, k), columns, *matrix + k * columns);
        if (good) {
            leave(reader);
        }
    }
    return good;
}

/* A row with an element for each state. */
static bool read_vector(struct reader *reader, const yaml_node_t *node, const struct field *field)
{
    double **vector = target(reader, field);
    *vector = calloc(reader->scenario->state_count, sizeof **vector);
    return *vector != NULL ? read_row(reader, node, reader->scenario->state_count, *vector)
                           : refuse_memory(reader);
}

/* Sections */

/* The keys of a table as a person reads them. */
static struct keys {
    char text[160];
} list_keys(const struct field *fields)
{
    struct keys keys = {""};
    size_t length = 0;
    for (; fields->key != NULL; fields++) {
        length += (size_t)snprintf(keys.text + length, sizeof keys.text - length, "%s%s%s",
                                   length > 0 ? ", " : "", fields->key,
                                   fields->optional ? " (optional)" : "");
    }
    return keys;
}

static bool check_key(struct reader *reader, const yaml_node_t *mapping,
                      const yaml_node_pair_t *pair, const struct field *fields)
{
    const yaml_node_t *key = node_of(reader, pair->key);
    if (key->type != YAML_SCALAR_NODE) {
        return refuse(reader, key, "keys must be words, not %s", see(key).text);
    }
    const struct field *field = fields;
    while (field->key != NULL && !is_word(key, field->key)) {
        field++;
    }
    enter(reader, (const char *)key->data.scalar.value, 0);
    if (field->key == NULL) {
        return refuse(reader, key, "unknown key, must be one of %s", list_keys(fields).text);
    }
    const yaml_node_pair_t *earlier = mapping->data.mapping.pairs.start;
    for (; earlier < pair; earlier++) {
        const yaml_node_t *twin = node_of(reader, earlier->key);
        if (is_word(twin, field->key)) {
            return refuse(reader, key, "repeated, must stand once; it stands in line %zu too",
                          twin->start_mark.line + 1);
        }
    }
    leave(reader);
    return true;
}

static bool read_section(struct reader *reader, const yaml_node_t *node, const struct field *field)
{
    if (node->type != YAML_MAPPING_NODE) {
        return refuse(reader, node, "must be a mapping with the keys %s, not %s",
                      list_keys(field->fields).text, see(node).text);
    }
    const yaml_node_pair_t *pair = node->data.mapping.pairs.start;
    for (; pair < node->data.mapping.pairs.top; pair++) {
        if (!check_key(reader, node, pair, field->fields)) {
            return false;
        }
    }
    for (const struct field *inner = field->fields; inner->key != NULL; inner++) {
        const yaml_node_t *value = value_of(reader, node, inner->key);
        enter(reader, inner->key, 0);
        if (value == NULL && !inner->optional) {
            return refuse(reader, node, "missing, must be given; this section has the keys %s",
                          list_keys(field->fields).text);
        }
        if (value != NULL && !inner->read(reader, value, inner)) {
            return false;
        }
        leave(reader);
    }
    return true;
}

/* The keys, section by section */

#define FIELD(member) .offset = offsetof(struct scenario, member)

static bool read_name(struct reader *reader, const yaml_node_t *node, const struct field *field)
{
    char **name = target(reader, field);
    if (node->type != YAML_SCALAR_NODE || node->data.scalar.length == 0 ||
        strlen((const char *)node->data.scalar.value) != node->data.scalar.length) {
        return refuse(reader, node, "must be a word or a line of text, not %s", see(node).text);
    }
    *name = strdup((const char *)node->data.scalar.value);
    return *name != NULL || refuse_memory(reader);
}

static const struct field noise_fields[] = {
    {.key = "sigma", .read = read_positive, FIELD(sigma)},
    {.key = NULL},
};

static bool read_dynamics(struct reader *reader, const yaml_node_t *node, const struct field *field)
{
    if (!check_list(reader, node, 1, ONEBIT_STATES_MAX, "rows")) {
        return false;
    }
    reader->scenario->state_count = (uint32_t)list_length(node);
    return read_rows(reader, node, list_length(node), target(reader, field));
}

static bool read_arithmetic(struct reader *reader, const yaml_node_t *node,
                            const struct field *field)
{
    uint8_t choice;
    bool good = read_choice(reader, node, "double", "q31", &choice);
    *(bool *)target(reader, field) = choice == 1;
    return good;
}

static const struct field plant_fields[] = {
    {.key = "A", .read = read_dynamics, FIELD(A)},
    {.key = "B", .read = read_vector, FIELD(B)},
    {.key = "arithmetic", .read = read_arithmetic, FIELD(integer_plant), .optional = true},
    {.key = NULL},
};

static bool read_beta(struct reader *reader, const yaml_node_t *node, const struct field *field)
{
    double sigma = reader->scenario->sigma;
    double *beta = target(reader, field);
    return read_positive(reader, node, field) &&
           ((*beta >= RATIO_MIN * sigma && *beta <= ESTIMATOR_GAIN_MAX * sigma) ||
            refuse(reader, node, "must be from %g sigma = %g to %g sigma = %g, not %s", RATIO_MIN,
                   RATIO_MIN * sigma, ESTIMATOR_GAIN_MAX, ESTIMATOR_GAIN_MAX * sigma,
                   see(node).text));
}

static bool read_gamma(struct reader *reader, const yaml_node_t *node, const struct field *field)
{
    double sigma = reader->scenario->sigma;
    double *gamma = target(reader, field);
    return read_positive(reader, node, field) &&
           ((*gamma * sigma >= RATIO_MIN && *gamma * sigma <= CONTROL_GAIN_MAX) ||
            refuse(reader, node, "must be from %g/sigma = %g to %g/sigma = %g, not %s", RATIO_MIN,
                   RATIO_MIN / sigma, CONTROL_GAIN_MAX, CONTROL_GAIN_MAX / sigma, see(node).text));
}

static bool read_start(struct reader *reader, const yaml_node_t *node, const struct field *field)
{
    return read_integer(reader, node, 1, CLOCK_LAST - 2u, target(reader, field));
}

static const struct field gains_fields[] = {
    {.key = "stabilizing", .read = read_vector, FIELD(stabilizing)},
    {.key = "compression", .read = read_vector, FIELD(compression)},
    {.key = "beta", .read = read_beta, FIELD(beta)},
    {.key = "gamma", .read = read_gamma, FIELD(gamma)},
    {.key = "t0", .read = read_start, FIELD(t0)},
    {.key = NULL},
};

static bool read_bound(struct reader *reader, const yaml_node_t *node, const struct field *field)
{
    const struct scenario *scenario = reader->scenario;
    if (!read_positive(reader, node, field)) {
        return false;
    }
    if (!(scenario->bound >= RATIO_MIN * scenario->sigma)) {
        return refuse(reader, node, "must be at least %g sigma = %g, not %s", RATIO_MIN,
                      RATIO_MIN * scenario->sigma, see(node).text);
    }
    double reach = (fabs(scenario->threshold) + scenario->bound) / scenario->sigma;
    return reach <= THRESHOLD_BOUND_MAX ||
           refuse(
               reader, node,
               "(|threshold| + bound) / sigma must be at most %g, not %g: beyond, the bits carry "
               "nothing",
               THRESHOLD_BOUND_MAX, reach);
}

static const struct field quantizer_fields[] = {
    {.key = "threshold", .read = read_number, FIELD(threshold)},
    {.key = "bound", .read = read_bound, FIELD(bound)},
    {.key = NULL},
};

static bool read_states(struct reader *reader, const yaml_node_t *node, const struct field *field)
{
    struct scenario *scenario = reader->scenario;
    if (!check_list(reader, node, 2, UINT32_MAX, "agents") ||
        !read_rows(reader, node, scenario->state_count, target(reader, field))) {
        return false;
    }
    scenario->topology.agent_count = (uint32_t)list_length(node);
    for (size_t agent = 0; agent < list_length(node); agent++) {
        double compressed = 0;
        for (size_t k = 0; k < scenario->state_count; k++) {
            compressed += scenario->compression[k] *
                          scenario->initial_states[agent * scenario->state_count + k];
        }
        /* Written so that an overflow to not-a-number is refused too. */
        if (!(fabs(compressed) <= scenario->bound * (1 + COMPRESSED_ROUNDING))) {
            enter(reader, NULL, agent);
            return refuse(reader, item_of(reader, node, agent),
                          "agent %zu has |K2 x| = %.10g, must be at most the bound %.10g",
                          agent + 1, fabs(compressed), scenario->bound);
        }
    }
    return true;
}

static bool read_estimates(struct reader *reader, const yaml_node_t *node,
                           const struct field *field)
{
    const struct scenario *scenario = reader->scenario;
    return read_number(reader, node, field) &&
           (fabs(scenario->initial_estimate) <= scenario->bound ||
            refuse(reader, node, "must be within the bound -%g..%g, not %s", scenario->bound,
                   scenario->bound, see(node).text));
}

static const struct field initial_fields[] = {
    {.key = "states", .read = read_states, FIELD(initial_states)},
    {.key = "estimates", .read = read_estimates, FIELD(initial_estimate)},
    {.key = NULL},
};

/* Edges of the graph that read_graphs is at, the last one so far. */
static bool read_edges(struct reader *reader, const yaml_node_t *node, const struct field *field)
{
    (void)field;
    if (!check_list(reader, node, 0, UINT32_MAX / 2, "edges")) {
        return false;
    }
    size_t count = list_length(node);
    struct edge *edges = calloc(count + 1, sizeof *edges);
    reader->edges[reader->graph_count] = edges;
    reader->edge_counts[reader->graph_count++] = (uint32_t)count;
    bool good = edges != NULL || refuse_memory(reader);
    for (size_t k = 0; good && k < count; k++) {
        const yaml_node_t *edge = item_of(reader, node, k);
        enter(reader, NULL, k);
        good = check_list(reader, edge, 2, 2, "agents") &&
               read_integer(reader, item_of(reader, edge, 0), 0, UINT32_MAX, &edges[k].first) &&
               read_integer(reader, item_of(reader, edge, 1), 0, UINT32_MAX, &edges[k].second);
        if (good) {
            leave(reader);
        }
    }
    return good;
}

static const struct field graph_fields[] = {
    {.key = "edges", .read = read_edges},
    {.key = NULL},
};

static bool read_graphs(struct reader *reader, const yaml_node_t *node, const struct field *field)
{
    if (!check_list(reader, node, 1, SCENARIO_GRAPHS_MAX, "graphs")) {
        return false;
    }
    size_t count = list_length(node);
    reader->edges = calloc(count, sizeof(struct edge *));
    reader->edge_counts = calloc(count, sizeof *reader->edge_counts);
    bool good = (reader->edges != NULL && reader->edge_counts != NULL) || refuse_memory(reader);
    for (size_t k = 0; good && k < count; k++) {
        enter(reader, NULL, k);
        good = read_section(reader, item_of(reader, node, k), field);
        if (good) {
            leave(reader);
        }
    }
    return good;
}

static bool read_transition(struct reader *reader, const yaml_node_t *node,
                            const struct field *field)
{
    (void)field;
    size_t count = reader->graph_count;
    if (!check_list(reader, node, count, count, "rows, one a graph") ||
        !read_rows(reader, node, count, &reader->transition)) {
        return false;
    }
    for (size_t row = 0; row < count; row++) {
        const double *entries = reader->transition + row * count;
        const yaml_node_t *row_node = item_of(reader, node, row);
        double sum = 0;
        enter(reader, NULL, row);
        for (size_t k = 0; k < count; k++) {
            if (!(entries[k] >= 0 && entries[k] <= 1)) {
                enter(reader, NULL, k);
                return refuse(reader, item_of(reader, row_node, k),
                              "must be a probability from 0 to 1, not %g", entries[k]);
            }
            sum += entries[k];
        }
        if (!(fabs(sum - 1) <= ROW_SUM_ROUNDING)) {
            return refuse(reader, row_node, "the row's sum must be 1, not %.12g", sum);
        }
        leave(reader);
    }
    return true;
}

static const struct field topology_fields[] = {
    {.key = "graphs", .read = read_graphs, .fields = graph_fields},
    {.key = "transition", .read = read_transition, .optional = true},
    {.key = NULL},
};

/* Says what topology_build refused, at the line of the edge or of the chain's row. */
static bool refuse_topology(struct reader *reader, const yaml_node_t *node,
                            const struct topology_place *place, const struct problem *problem)
{
    if (place->part == TOPOLOGY_MEMORY) {
        return refuse(reader, node, "%s", problem->text);
    }
    if (place->part == TOPOLOGY_TRANSITION) {
        enter(reader, "transition", 0);
        enter(reader, NULL, place->graph);
        const yaml_node_t *transition = value_of(reader, node, "transition");
        return refuse(reader, item_of(reader, transition, place->graph), "%s", problem->text);
    }
    enter(reader, "graphs", 0);
    enter(reader, NULL, place->graph);
    enter(reader, "edges", 0);
    enter(reader, NULL, place->edge);
    const yaml_node_t *graph = item_of(reader, value_of(reader, node, "graphs"), place->graph);
    const yaml_node_t *edge = item_of(reader, value_of(reader, graph, "edges"), place->edge);
    return refuse(reader, edge, "%s", problem->text);
}

static bool read_topology(struct reader *reader, const yaml_node_t *node, const struct field *field)
{
    struct topology *topology = &reader->scenario->topology;
    if (!read_section(reader, node, field)) {
        return false;
    }
    if (reader->graph_count > 1 && reader->transition == NULL) {
        enter(reader, "transition", 0);
        return refuse(reader, node, "missing, must be given where there are several graphs");
    }
    struct topology_place place;
    struct problem problem;
    uint32_t agents = topology->agent_count;
    if (!topology_build(topology, agents, reader->graph_count,
                        (const struct edge *const *)reader->edges, reader->edge_counts,
                        reader->transition, &place, &problem)) {
        return refuse_topology(reader, node, &place, &problem);
    }
    for (uint32_t agent = 1; agent <= agents; agent++) {
        uint32_t neighbours = topology->first_link[agent] - topology->first_link[agent - 1u];
        if (neighbours < 1 || neighbours > ONEBIT_NEIGHBOURS_MAX) {
            enter(reader, "graphs", 0);
            return refuse(reader, value_of(reader, node, "graphs"),
                          "agent %u has %u neighbours over all graphs, must have 1 to %d", agent,
                          neighbours, ONEBIT_NEIGHBOURS_MAX);
        }
    }
    return true;
}

static bool read_mode(struct reader *reader, const yaml_node_t *node, const struct field *field)
{
    /* In the order of ONEBIT_MODE_BROADCAST and ONEBIT_MODE_LINK. */
    return read_choice(reader, node, "broadcast", "link", target(reader, field));
}

static const struct field channel_fields[] = {
    {.key = "mode", .read = read_mode, FIELD(format.mode)},
    {.key = NULL},
};

static bool read_model(struct reader *reader, const yaml_node_t *node, const struct field *field)
{
    uint8_t choice;
    bool good = read_choice(reader, node, "ideal", "can", &choice);
    *(enum bus_model *)target(reader, field) = choice == 1 ? BUS_CAN : BUS_IDEAL;
    return good;
}

static bool read_encoding(struct reader *reader, const yaml_node_t *node, const struct field *field)
{
    /* In the order of ONEBIT_ENCODING_PAYLOAD and ONEBIT_ENCODING_IDENTIFIER. */
    bool good = read_choice(reader, node, "payload", "identifier", target(reader, field));
    onebit_format *format = &reader->scenario->format;
    format->base =
        format->encoding == ONEBIT_ENCODING_PAYLOAD ? ONEBIT_PAYLOAD_BASE : ONEBIT_IDENTIFIER_BASE;
    format->sync = ONEBIT_SYNC_IDENTIFIER;
    return good;
}

/* The one number that may be hexadecimal, as people write identifiers. */
static bool read_base(struct reader *reader, const yaml_node_t *node, const struct field *field)
{
    (void)field;
    onebit_format *format = &reader->scenario->format;
    if (format->mode == ONEBIT_MODE_LINK) {
        return refuse(reader, node, "means nothing in link mode, must be left out");
    }
    const char *text = number_text(node, "0123456789abcdefABCDEFx");
    char *end = NULL;
    unsigned long base = 0;
    if (text != NULL) {
        bool hexadecimal = strncmp(text, "0x", 2) == 0;
        base = strtoul(text, &end, hexadecimal ? 16 : 10);
    }
    if (text == NULL || *end != '\0' || base > UINT16_MAX) {
        return refuse(reader, node, "must be an 11-bit number such as 0x100, not %s",
                      see(node).text);
    }
    format->base = (uint16_t)base;
    return onebit_frame_agent_limit(format) > 0 ||
           refuse(reader, node,
                  "must leave agent 1 an identifier within 0x081..0x7EF (agent 1 is at base + %s), "
                  "not %s",
                  format->encoding == ONEBIT_ENCODING_PAYLOAD ? "1" : "2 and + 3", see(node).text);
}

static const struct field bus_fields[] = {
    {.key = "model", .read = read_model, FIELD(bus_model)},
    {.key = "bitrate", .read = read_positive, FIELD(bitrate)},
    {.key = "encoding", .read = read_encoding, FIELD(format.encoding)},
    {.key = "base", .read = read_base, .optional = true},
    {.key = NULL},
};

static bool read_bus(struct reader *reader, const yaml_node_t *node, const struct field *field)
{
    const struct scenario *scenario = reader->scenario;
    if (!read_section(reader, node, field)) {
        return false;
    }
    uint32_t limit = onebit_frame_agent_limit(&scenario->format);
    if (scenario->bus_model == BUS_CAN && scenario->topology.agent_count > limit) {
        enter(reader, "model", 0);
        return refuse(reader, value_of(reader, node, "model"),
                      "there are identifiers for %u agents, not for %u; must be ideal for so many",
                      limit, scenario->topology.agent_count);
    }
    return true;
}

static bool read_fraction_bits(struct reader *reader, const yaml_node_t *node,
                               const struct field *field)
{
    uint32_t bits = 0;
    if (!read_integer(reader, node, 0, 31, &bits)) {
        return false;
    }
    *(int *)target(reader, field) = (int)bits;
    return true;
}

static bool read_state_fraction_bits(struct reader *reader, const yaml_node_t *node,
                                     const struct field *field)
{
    struct scenario *scenario = reader->scenario;
    if (!read_fraction_bits(reader, node, field)) {
        return false;
    }
    double largest = ldexp(INT32_MAX, -scenario->state_fraction_bits);
    size_t n = scenario->state_count;
    for (size_t k = 0; k < scenario->topology.agent_count * n; k++) {
        if (fabs(scenario->initial_states[k]) > largest) {
            return refuse(reader, node,
                          "state %zu of agent %zu begins at %g, but %d fraction bits hold at most "
                          "%g; must be fewer",
                          k % n + 1, k / n + 1, scenario->initial_states[k],
                          scenario->state_fraction_bits, largest);
        }
    }
    return true;
}

static const struct field fixed_fields[] = {
    {.key = "state_fraction_bits", .read = read_state_fraction_bits, FIELD(state_fraction_bits)},
    {.key = "control_fraction_bits", .read = read_fraction_bits, FIELD(control_fraction_bits)},
    {.key = NULL},
};

static bool read_fixed(struct reader *reader, const yaml_node_t *node, const struct field *field)
{
    reader->scenario->has_fixed = true;
    return read_section(reader, node, field);
}

static bool read_steps(struct reader *reader, const yaml_node_t *node, const struct field *field)
{
    return read_integer(reader, node, 1, CLOCK_LAST - 1u - reader->scenario->t0,
                        target(reader, field));
}

static const struct field scenario_fields[] = {
    {.key = "name", .read = read_name, FIELD(name)},
    {.key = "noise", .read = read_section, .fields = noise_fields},
    {.key = "plant", .read = read_section, .fields = plant_fields},
    {.key = "gains", .read = read_section, .fields = gains_fields},
    {.key = "quantizer", .read = read_section, .fields = quantizer_fields},
    {.key = "initial", .read = read_section, .fields = initial_fields},
    {.key = "topology", .read = read_topology, .fields = topology_fields},
    {.key = "channel", .read = read_section, .fields = channel_fields},
    {.key = "bus", .read = read_bus, .fields = bus_fields},
    {.key = "fixed", .read = read_fixed, .fields = fixed_fields, .optional = true},
    {.key = "period", .read = read_positive, FIELD(period)},
    {.key = "steps", .read = read_steps, FIELD(steps)},
    {.key = NULL},
};

static const struct field whole_file = {.fields = scenario_fields};

/* The file */

/* Why libyaml could not go on; `text` is the file's. */
static bool refuse_yaml(struct reader *reader, const yaml_parser_t *parser, const char *text)
{
    if (parser->error == YAML_MEMORY_ERROR) {
        return refuse_memory(reader);
    }
    size_t line = parser->problem_mark.line + 1;
    if (parser->error == YAML_READER_ERROR) {
        line = 1; /* such errors carry no mark, but the offset of a byte */
        for (size_t k = 0; k < parser->problem_offset; k++) {
            line += text[k] == '\n';
        }
    }
    return problem_set(reader->problem, "%s:%zu: must be YAML, but %s", reader->scenario->path,
                       line, parser->problem);
}

/* The one document of the file into reader->document. */
static bool parse(struct reader *reader, const char *text, size_t size)
{
    yaml_parser_t parser;
    yaml_document_t second;
    if (!yaml_parser_initialize(&parser)) {
        return refuse_memory(reader);
    }
    yaml_parser_set_input_string(&parser, (const unsigned char *)text, size);
    bool good =
        yaml_parser_load(&parser, &reader->document) != 0 || refuse_yaml(reader, &parser, text);
    if (good && yaml_document_get_root_node(&reader->document) == NULL) {
        good = problem_set(reader->problem, "%s:1: is empty, must hold a scenario",
                           reader->scenario->path);
    }
    if (good && yaml_parser_load(&parser, &second) == 0) {
        good = refuse_yaml(reader, &parser, text);
    } else if (good) {
        const yaml_node_t *root = yaml_document_get_root_node(&second);
        good = root == NULL || refuse(reader, root, "begins a second document, must hold one");
        yaml_document_delete(&second);
    }
    yaml_parser_delete(&parser);
    return good;
}

/* The whole file on the heap, null and *problem if it cannot be read. */
static char *read_file(const char *path, size_t *size, struct problem *problem)
{
    FILE *file = fopen(path, "rb");
    size_t room = 0;
    char *text = NULL;
    *size = 0;
    if (file == NULL) {
        problem_set(problem, "%s: cannot be opened: %s", path, strerror(errno));
        return NULL;
    }
    bool more = true;
    while (more) {
        room = room * 2 + 4096;
        char *larger = realloc(text, room);
        errno = larger == NULL ? ENOMEM : errno;
        text = larger != NULL ? larger : text;
        *size += larger != NULL ? fread(text + *size, 1, room - *size, file) : 0;
        more = larger != NULL && *size == room;
        if (larger == NULL || ferror(file)) {
            problem_set(problem, "%s: cannot be read: %s", path, strerror(errno));
            free(text);
            text = NULL;
            more = false;
        }
    }
    fclose(file);
    return text;
}

/* Names and values come from the file: whatever they hold, the problem stays one line. */
static void keep_one_line(struct problem *problem)
{
    for (char *character = problem->text; *character != '\0'; character++) {
        if ((unsigned char)*character < ' ' || *character == 0x7F) {
            *character = '?';
        }
    }
}

bool scenario_load(struct scenario *scenario, const char *path, struct problem *problem)
{
    struct reader reader = {.scenario = scenario, .problem = problem};
    size_t size;
    *scenario = (struct scenario){.path = strdup(path)};
    char *text = scenario->path != NULL ? read_file(path, &size, problem) : NULL;
    bool good = false;
    if (scenario->path == NULL) {
        problem_set(problem, "%s: too large for this machine's memory", path);
    } else if (text != NULL) {
        good = parse(&reader, text, size) &&
               read_section(&reader, yaml_document_get_root_node(&reader.document), &whole_file);
        yaml_document_delete(&reader.document);
    }
    for (uint32_t graph = 0; graph < reader.graph_count; graph++) {
        free(reader.edges[graph]);
    }
    free(reader.edges);
    free(reader.edge_counts);
    free(reader.transition);
    free(text);
    if (!good) {
        keep_one_line(problem);
        scenario_free(scenario);
    }
    return good;
}

void scenario_free(struct scenario *scenario)
{
    free(scenario->path);
    free(scenario->name);
    free(scenario->A);
    free(scenario->B);
    free(scenario->stabilizing);
    free(scenario->compression);
    free(scenario->initial_states);
    topology_free(&scenario->topology);
    *scenario = (struct scenario){0};
}
