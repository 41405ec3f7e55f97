/* The files of output_file.h. */
#include "output_file.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

bool output_file_open(struct output_file *file, const char *path, struct problem *problem)
{
    *file = (struct output_file){0};
    struct stat status;
    if (stat(path, &status) == 0 && S_ISDIR(status.st_mode)) {
        return problem_set(problem, "%s: is a directory, not a file to write", path);
    }
    size_t length = strlen(path);
    file->path = malloc(length + 1);
    file->temporary = malloc(length + sizeof ".XXXXXX");
    if (file->path == NULL || file->temporary == NULL) {
        output_file_discard(file);
        return problem_set(problem, "%s: not enough memory", path);
    }
    memcpy(file->path, path, length + 1);
    memcpy(file->temporary, path, length);
    memcpy(file->temporary + length, ".XXXXXX", sizeof ".XXXXXX");
    int descriptor = mkstemp(file->temporary);
    if (descriptor >= 0) {
        /* mkstemp makes private files; this one gets what any new file would get. */
        mode_t mask = umask(0);
        umask(mask);
        fchmod(descriptor, 0666 & ~mask);
        file->stream = fdopen(descriptor, "wb");
    }
    if (file->stream == NULL) {
        int error = errno;
        if (descriptor >= 0) {
            close(descriptor);
            unlink(file->temporary);
        }
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
    if (!written || rename(file->temporary, file->path) != 0) {
        problem_set(problem, "%s: cannot be written: %s", file->path,
                    errno != 0 ? strerror(errno) : "a write failed");
        unlink(file->temporary);
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
        unlink(file->temporary);
    }
    free(file->path);
    free(file->temporary);
    *file = (struct output_file){0};
}
