/* The files of output_file.h. */
#include "output_file.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

/* Makes a new file beside `path` under a name that nothing has; 0 or errno. */
static int open_temporary(struct output_file *file, const char *path)
{
    size_t length = strlen(path);
    file->temporary = malloc(length + sizeof ".XXXXXX");
    if (file->temporary == NULL) {
        return ENOMEM;
    }
    memcpy(file->temporary, path, length);
    memcpy(file->temporary + length, ".XXXXXX", sizeof ".XXXXXX");
    int descriptor = mkstemp(file->temporary);
    if (descriptor < 0) {
        return errno;
    }
    /* mkstemp makes private files; this one gets what any new file would get. */
    mode_t mask = umask(0);
    umask(mask);
    fchmod(descriptor, 0666 & ~mask);
    file->stream = fdopen(descriptor, "wb");
    if (file->stream == NULL) {
        int error = errno;
        close(descriptor);
        unlink(file->temporary);
        return error;
    }
    return 0;
}

bool output_file_open(struct output_file *file, const char *path, struct problem *problem)
{
    *file = (struct output_file){0};
    if (path[0] == '\0') {
        return problem_set(problem, "the name of a file to write is empty");
    }
    struct stat status;
    if (stat(path, &status) == 0 && S_ISDIR(status.st_mode)) {
        return problem_set(problem, "%s: is a directory, not a file to write", path);
    }
    int error = 0;
    file->path = malloc(strlen(path) + 1);
    if (file->path == NULL) {
        error = ENOMEM;
    } else {
        strcpy(file->path, path);
        if (lstat(path, &status) != 0 || S_ISREG(status.st_mode)) {
            error = open_temporary(file, path);
        } else {
            /* A rename would put a file where, say, /dev/null was. */
            file->stream = fopen(path, "wb");
            error = file->stream == NULL ? errno : 0;
        }
    }
    if (error != 0) {
        output_file_discard(file);
        return problem_set(problem, "%s: cannot be written: %s", path, strerror(error));
    }
    return true;
}

bool output_file_commit(struct output_file *file, struct problem *problem)
{
    errno = 0;
    bool written = ferror(file->stream) == 0;
    written = fclose(file->stream) == 0 && written;
    file->stream = NULL;
    if (!written || (file->temporary != NULL && rename(file->temporary, file->path) != 0)) {
        problem_set(problem, "%s: cannot be written: %s", file->path,
                    errno != 0 ? strerror(errno) : "a write failed");
        if (file->temporary != NULL) {
            unlink(file->temporary);
        }
        output_file_discard(file);
        return false;
    }
    output_file_discard(file);
    return true;
}

void output_file_discard(struct output_file *file)
{
    if (file->stream != NULL) {
        fclose(file->stream);
        if (file->temporary != NULL) {
            unlink(file->temporary);
        }
    }
    free(file->path);
    free(file->temporary);
    *file = (struct output_file){0};
}
