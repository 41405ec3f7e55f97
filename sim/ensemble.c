/*
 * Runs are independent (random words are functions of seed, run, link and t), each thread takes the
 * next one, and the reduction goes over them in their order: so any number of threads gives the
 * same bytes.
 */
#include "ensemble.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#define ROWS_PER_DECADE 20

/* 0, round(10^(j/20)) once each, and the last step. */
static uint32_t *list_rows(uint32_t steps, uint32_t *count)
{
    /* 32-bit steps: fewer than ten decades. */
    uint32_t *rows = malloc((10 * ROWS_PER_DECADE + 2) * sizeof *rows);
    if (rows == NULL) {
        return NULL;
    }
    *count = 0;
    rows[(*count)++] = 0;
    for (int j = 0;; ++j) {
        double row = round(pow(10, j / (double)ROWS_PER_DECADE));
        if (row >= steps) {
            break;
        }
        if ((uint32_t)row > rows[*count - 1]) {
            rows[(*count)++] = (uint32_t)row;
        }
    }
    rows[(*count)++] = steps;
    return rows;
}

static void show_progress(uint32_t done, uint32_t runs)
{
    fprintf(stderr, "\r%lu of %lu runs", (unsigned long)done, (unsigned long)runs);
    if (done == runs) {
        fputs("\r                                \r", stderr);
    }
    fflush(stderr);
}

static void reduce(struct ensemble *ensemble, const struct sample *samples)
{
    uint32_t runs = ensemble->runs;
    for (uint32_t row = 0; row < ensemble->row_count; ++row) {
        struct sample mean = {0};
        for (uint32_t run = 0; run < runs; ++run) {
            const struct sample *sample = &samples[(size_t)run * ensemble->row_count + row];
            mean.mse += sample->mse / runs;
            mean.estimate_mse += sample->estimate_mse / runs;
            mean.average_error += sample->average_error / runs;
        }
        double squares = 0;
        for (uint32_t run = 0; run < runs; ++run) {
            double deviation = samples[(size_t)run * ensemble->row_count + row].mse - mean.mse;
            squares += deviation * deviation;
        }
        ensemble->means[row] = mean;
        ensemble->mse_se[row] = runs > 1 ? sqrt(squares / (runs - 1.0) / runs) : 0;
    }
}

bool ensemble_run(struct ensemble *ensemble, const struct scenario *scenario,
                  const struct formats *formats, struct problem *problem)
{
    uint32_t runs = ensemble->runs;
    ensemble->rows = list_rows(ensemble->steps, &ensemble->row_count);
    size_t row_count = ensemble->row_count;
    size_t entries = (size_t)scenario->topology.agent_count * scenario->state_count;
    ensemble->means = calloc(row_count, sizeof *ensemble->means);
    ensemble->mse_se = calloc(row_count, sizeof *ensemble->mse_se);
    ensemble->trajectory = calloc(row_count * entries, sizeof *ensemble->trajectory);
    struct sample *samples = calloc(runs * row_count, sizeof *samples);
    struct bus_traffic *traffic = calloc(runs, sizeof *traffic);
    bool good = ensemble->rows != NULL && ensemble->means != NULL && ensemble->mse_se != NULL &&
                ensemble->trajectory != NULL && samples != NULL && traffic != NULL;
    if (!good) {
        problem_set(problem, "%s: not enough memory for %lu runs", scenario->path,
                    (unsigned long)runs);
    }
    uint32_t done = 0;
    uint32_t todo = good ? runs : 0;
#pragma omp parallel for schedule(dynamic, 1) num_threads(ensemble->threads)
    for (uint32_t number = 0; number < todo; ++number) {
        struct run run = {
            .seed = ensemble->seed,
            .number = number,
            .rows = ensemble->rows,
            .row_count = ensemble->row_count,
            .log = number == 0 ? ensemble->log : NULL,
            .samples = &samples[number * row_count],
            .trajectory = number == 0 ? ensemble->trajectory : NULL,
        };
        struct problem own = {{0}};
        bool run_good = simulate(ensemble->arithmetic, scenario, formats, &run, &own);
        traffic[number] = run.traffic;
#pragma omp critical
        {
            if (!run_good) {
                good = false;
                *problem = own;
            }
            ++done;
            if (ensemble->progress) {
                show_progress(done, runs);
            }
        }
    }
    if (good) {
        reduce(ensemble, samples);
        ensemble->traffic = (struct bus_traffic){0};
        for (uint32_t run = 0; run < runs; ++run) {
            ensemble->traffic.frames += traffic[run].frames;
            ensemble->traffic.late_frames += traffic[run].late_frames;
            ensemble->traffic.wire_bits += traffic[run].wire_bits;
            ensemble->traffic.messages += traffic[run].messages;
            ensemble->traffic.latency_sum += traffic[run].latency_sum;
            ensemble->traffic.latency_max =
                fmax(ensemble->traffic.latency_max, traffic[run].latency_max);
        }
    }
    free(samples);
    free(traffic);
    return good;
}

void ensemble_free(struct ensemble *ensemble)
{
    free(ensemble->rows);
    free(ensemble->means);
    free(ensemble->mse_se);
    free(ensemble->trajectory);
}

double ensemble_slope(const struct ensemble *ensemble, uint32_t t0, uint32_t first, uint32_t last)
{
    double count = 0;
    double sum_x = 0;
    double sum_y = 0;
    double sum_xx = 0;
    double sum_xy = 0;
    for (uint32_t row = 0; row < ensemble->row_count; ++row) {
        uint32_t step = ensemble->rows[row];
        double mse = ensemble->means[row].mse;
        if (step < first || step > last || !(mse > 0)) {
            continue;
        }
        double x = log10((double)t0 + 1.0 + step);
        double y = log10(mse);
        count += 1;
        sum_x += x;
        sum_y += y;
        sum_xx += x * x;
        sum_xy += x * y;
    }
    return count < 2 ? (double)NAN
                     : (count * sum_xy - sum_x * sum_y) / (count * sum_xx - sum_x * sum_x);
}
