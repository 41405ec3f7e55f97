/* Writes the files of record.h. */
#include "record.h"

#include "output_file.h"

#include <cjson/cJSON.h>
#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

bool record_prepare(const char *folder, struct problem *problem)
{
    char *path = malloc(strlen(folder) + 1);
    if (path == NULL) {
        return problem_set(problem, "%s: not enough memory", folder);
    }
    strcpy(path, folder);
    /* Each parent in turn; one that is there already is no failure. */
    for (char *slash = path + 1; path[0] != '\0' && *slash != '\0'; ++slash) {
        if (*slash == '/') {
            *slash = '\0';
            mkdir(path, 0777);
            *slash = '/';
        }
    }
    int made = mkdir(path, 0777);
    int error = errno;
    free(path);
    struct stat status;
    if (stat(folder, &status) != 0) {
        return problem_set(problem, "%s: cannot be made: %s", folder,
                           strerror(made != 0 ? error : errno));
    }
    if (!S_ISDIR(status.st_mode)) {
        return problem_set(problem, "%s: is a file, not a folder to write to", folder);
    }
    if (access(folder, W_OK | X_OK) != 0) {
        return problem_set(problem, "%s: cannot be written: %s", folder, strerror(errno));
    }
    return true;
}

double record_bus_load(const struct ensemble *ensemble, const struct scenario *scenario)
{
    return (double)ensemble->traffic.wire_bits / ensemble->runs /
           (scenario->bitrate * scenario->period * ensemble->steps);
}

double record_latency(const struct ensemble *ensemble)
{
    return ensemble->traffic.messages == 0
               ? 0
               : ensemble->traffic.latency_sum / (double)ensemble->traffic.messages;
}

static void write_mse(FILE *stream, const struct ensemble *ensemble,
                      const struct scenario *scenario)
{
    fputs("step,t,mse,mse_se,estimate_mse,average_error\n", stream);
    for (uint32_t row = 0; row < ensemble->row_count; ++row) {
        const struct sample *mean = &ensemble->means[row];
        fprintf(stream, "%lu,%lu,%.17g,", (unsigned long)ensemble->rows[row],
                (unsigned long)scenario->t0 + 1 + ensemble->rows[row], mean->mse);
        if (ensemble->runs > 1) {
            fprintf(stream, "%.17g", ensemble->mse_se[row]);
        }
        fprintf(stream, ",%.17g,%.17g\n", mean->estimate_mse, mean->average_error);
    }
}

static void write_trajectory(FILE *stream, const struct ensemble *ensemble,
                             const struct scenario *scenario)
{
    uint32_t n = scenario->state_count;
    fputs("step,agent", stream);
    for (uint32_t k = 1; k <= n; ++k) {
        fprintf(stream, ",x%lu", (unsigned long)k);
    }
    fputc('\n', stream);
    const double *x = ensemble->trajectory;
    for (uint32_t row = 0; row < ensemble->row_count; ++row) {
        for (uint32_t agent = 1; agent <= scenario->topology.agent_count; ++agent) {
            fprintf(stream, "%lu,%lu", (unsigned long)ensemble->rows[row], (unsigned long)agent);
            for (uint32_t k = 0; k < n; ++k) {
                fprintf(stream, ",%.17g", *x++);
            }
            fputc('\n', stream);
        }
    }
}

/* Null where there is no such number. */
static void add_number(cJSON *object, const char *key, double value, bool there)
{
    if (there && isfinite(value)) {
        cJSON_AddNumberToObject(object, key, value);
    } else {
        cJSON_AddNullToObject(object, key);
    }
}

static char *summary_text(const struct ensemble *ensemble, const struct scenario *scenario,
                          const struct summary *summary)
{
    const struct sample *last = &ensemble->means[ensemble->row_count - 1];
    double runs = ensemble->runs;
    double window[2] = {summary->slope_first, summary->slope_last};
    cJSON *object = cJSON_CreateObject();
    cJSON_AddStringToObject(object, "scenario", scenario->name);
    cJSON_AddStringToObject(object, "arith", arithmetic_names[ensemble->arithmetic]);
    cJSON_AddNumberToObject(object, "runs", runs);
    cJSON_AddNumberToObject(object, "steps", ensemble->steps);
    cJSON_AddNumberToObject(object, "seed", ensemble->seed);
    add_number(object, "mse", last->mse, true);
    add_number(object, "mse_se", ensemble->mse_se[ensemble->row_count - 1], runs > 1);
    add_number(object, "estimate_mse", last->estimate_mse, true);
    add_number(object, "average_error", last->average_error, true);
    add_number(object, "slope", summary->slope, true);
    cJSON_AddItemToObject(object, "slope_window", cJSON_CreateDoubleArray(window, 2));
    cJSON_AddNumberToObject(object, "frames", (double)ensemble->traffic.frames / runs);
    cJSON_AddNumberToObject(object, "late_frames", (double)ensemble->traffic.late_frames / runs);
    cJSON_AddNumberToObject(object, "wire_bits", (double)ensemble->traffic.wire_bits / runs);
    cJSON_AddNumberToObject(object, "bus_load", record_bus_load(ensemble, scenario));
    cJSON_AddNumberToObject(object, "latency_mean", record_latency(ensemble));
    cJSON_AddNumberToObject(object, "latency_max", ensemble->traffic.latency_max);
    cJSON_AddNumberToObject(object, "seconds", summary->seconds);
    char *text = cJSON_Print(object);
    cJSON_Delete(object);
    return text;
}

bool record_write(const char *folder, const struct ensemble *ensemble,
                  const struct scenario *scenario, const struct summary *summary,
                  struct problem *problem)
{
    static const char *const names[] = {"mse.csv", "trajectory.csv", "summary.json"};
    struct output_file files[3] = {{0}};
    size_t length = strlen(folder) + sizeof "/trajectory.csv";
    char *path = malloc(length);
    char *text = summary_text(ensemble, scenario, summary);
    bool good = path != NULL && text != NULL;
    if (!good) {
        problem_set(problem, "%s: not enough memory", folder);
    }
    for (int k = 0; good && k < 3; ++k) {
        snprintf(path, length, "%s/%s", folder, names[k]);
        good = output_file_open(&files[k], path, problem);
    }
    if (good) {
        write_mse(files[0].stream, ensemble, scenario);
        write_trajectory(files[1].stream, ensemble, scenario);
        fprintf(files[2].stream, "%s\n", text);
    }
    for (int k = 0; k < 3; ++k) {
        if (good) {
            good = output_file_commit(&files[k], problem);
        } else {
            output_file_discard(&files[k]);
        }
    }
    cJSON_free(text);
    free(path);
    return good;
}

void record_print(FILE *stream, const struct ensemble *ensemble, const struct scenario *scenario,
                  const struct summary *summary)
{
    const struct sample *last = &ensemble->means[ensemble->row_count - 1];
    fprintf(stream, "%s, %s: %lu run%s of %lu steps in %.2f s\n", scenario->name,
            arithmetic_names[ensemble->arithmetic], (unsigned long)ensemble->runs,
            ensemble->runs == 1 ? "" : "s", (unsigned long)ensemble->steps, summary->seconds);
    fprintf(stream, "  disagreement       %.4g", last->mse);
    if (ensemble->runs > 1) {
        fprintf(stream, " +- %.2g", ensemble->mse_se[ensemble->row_count - 1]);
    }
    fprintf(stream, "\n  estimation error   %.4g\n  left the average   %.4g\n", last->estimate_mse,
            last->average_error);
    if (isfinite(summary->slope)) {
        fprintf(stream, "  log-log slope      %.3f over steps %lu..%lu\n", summary->slope,
                (unsigned long)summary->slope_first, (unsigned long)summary->slope_last);
    }
    fprintf(stream, "  a run on the bus   %.0f frames, %.0f late, %.0f bits, load %.3g %%\n",
            (double)ensemble->traffic.frames / ensemble->runs,
            (double)ensemble->traffic.late_frames / ensemble->runs,
            (double)ensemble->traffic.wire_bits / ensemble->runs,
            100 * record_bus_load(ensemble, scenario));
    if (scenario->bus_model == BUS_CAN) {
        fprintf(stream, "  latency            %.3g ms mean, %.3g ms largest\n",
                1e3 * record_latency(ensemble), 1e3 * ensemble->traffic.latency_max);
    }
}
