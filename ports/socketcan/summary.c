/* The summary of summary.h. */
#include "summary.h"

#include <ctype.h>
#include <math.h>
#include <string.h>

/* "early" of ONEBIT_REFUSED_EARLY. */
static void refusal_name(int place, char name[32])
{
    const char *code = onebit_status_name((onebit_status)(ONEBIT_REFUSED_FIRST + place));
    size_t k = 0;
    for (code += strlen("ONEBIT_REFUSED_"); k < 31 && code[k] != '\0'; ++k) {
        name[k] = (char)tolower((unsigned char)code[k]);
    }
    name[k] = '\0';
}

cJSON *summary_object(const struct summary *summary)
{
    const struct nodes *nodes = summary->nodes;
    const struct machine_report *report = &summary->report;
    cJSON *object = cJSON_CreateObject();
    cJSON_AddStringToObject(object, "scenario", nodes->scenario->name);
    cJSON_AddStringToObject(object, "interface", nodes->interface);
    cJSON_AddNumberToObject(object, "agent", summary->agent);
    cJSON_AddStringToObject(object, "arith", arithmetic_names[nodes->arithmetic]);
    cJSON_AddNumberToObject(object, "seed", nodes->seed);
    cJSON_AddNumberToObject(object, "run", nodes->run);
    cJSON_AddStringToObject(object, "ended", summary->ended);
    cJSON_AddNumberToObject(object, "seconds", summary->seconds);
    cJSON_AddNumberToObject(object, "steps", report->steps);
    cJSON_AddNumberToObject(object, "t", report->clock);
    cJSON_AddNumberToObject(object, "frames_out", (double)summary->frames_out);
    cJSON_AddNumberToObject(object, "frames_in", (double)summary->frames_in);
    cJSON_AddNumberToObject(object, "taken", (double)report->taken);
    cJSON *refused = cJSON_AddObjectToObject(object, "refused");
    for (int k = 0; k < ONEBIT_REFUSALS; ++k) {
        char name[32];
        refusal_name(k, name);
        cJSON_AddNumberToObject(refused, name, (double)report->refused[k]);
    }
    cJSON_AddNumberToObject(object, "duplicates", (double)summary->duplicates);
    cJSON_AddNumberToObject(object, "syncs", (double)summary->syncs);
    cJSON_AddNumberToObject(object, "sync_refused", (double)summary->sync_refused);
    cJSON_AddNumberToObject(object, "aligned", (double)report->aligned);
    cJSON_AddNumberToObject(object, "deadline_misses", (double)summary->deadline_misses);
    cJSON_AddNumberToObject(object, "late", (double)summary->late);
    cJSON_AddNumberToObject(object, "queue_full", (double)summary->queue_full);
    cJSON_AddNumberToObject(object, "lost", (double)summary->lost);
    cJSON_AddNumberToObject(object, "error_frames", (double)summary->error_frames);
    cJSON_AddNumberToObject(object, "bus_off", (double)summary->bus_off);
    cJSON_AddNumberToObject(object, "interface_down", (double)summary->interface_down);
    if (isnan(report->disagreement)) {
        cJSON_AddNullToObject(object, "disagreement");
    } else {
        cJSON_AddNumberToObject(object, "disagreement", report->disagreement);
    }
    return object;
}

void summary_print(const struct summary *summary)
{
    cJSON *object = summary_object(summary);
    printf("agent %lu:", (unsigned long)summary->agent);
    for (const cJSON *item = cJSON_GetObjectItem(object, "steps"); item != NULL;
         item = item->next) {
        if (cJSON_IsNumber(item) && item->valuedouble != 0) {
            printf(" %s %.6g", item->string, item->valuedouble);
        }
        for (const cJSON *part = item->child; part != NULL; part = part->next) {
            if (part->valuedouble != 0) {
                printf(" refused_%s %.0f", part->string, part->valuedouble);
            }
        }
    }
    putchar('\n');
    cJSON_Delete(object);
}

void summary_print_object(const cJSON *object)
{
    char *text = cJSON_Print(object);
    puts(text != NULL ? text : "");
    cJSON_free(text);
}

FILE *summary_open_csv(const struct nodes *nodes, uint32_t agent, struct problem *problem)
{
    char path[4096];
    const char *slash = strrchr(nodes->csv, '/');
    const char *ending = strrchr(nodes->csv, '.');
    if (ending == NULL || (slash != NULL && ending < slash)) {
        ending = nodes->csv + strlen(nodes->csv);
    }
    int length = nodes->agent_count == 1
                     ? snprintf(path, sizeof path, "%s", nodes->csv)
                     : snprintf(path, sizeof path, "%.*s-%lu%s", (int)(ending - nodes->csv),
                                nodes->csv, (unsigned long)agent, ending);
    FILE *file = length < (int)sizeof path ? fopen(path, "w") : NULL;
    if (file == NULL) {
        problem_set(problem, "--csv %s: cannot be written", nodes->csv);
        return NULL;
    }
    /* In place and by the line, so that it can be followed, and a killed node leaves its rows. */
    setvbuf(file, NULL, _IOLBF, BUFSIZ);
    return file;
}
