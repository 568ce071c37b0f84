/* file.c - a model from a path: the one file of the library that needs an operating system. */
#if !defined(_WIN32)
#define _POSIX_C_SOURCE 200809L
#include <sys/stat.h>
#endif

#include <errno.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "library/model.h"
#include "text.h"

/* What a path must not be: opening a pipe waits for its writer, and a folder has no length. */
#if defined(_WIN32)
static bool is_no_file(const char *path)
{
    (void)path;
    return false;
}
#else
static bool is_no_file(const char *path)
{
    struct stat about;
    return stat(path, &about) == 0 && !S_ISREG(about.st_mode);
}
#endif

static pmalpha_status refuse(const char *reason, char *message)
{
    return pmalpha_refuse(PMALPHA_BAD_FILE, reason, message);
}

/* The same with the reason of the system. */
static pmalpha_status refuse_for(const char *what, int error, char *message)
{
    char reason[PMALPHA_MESSAGE];
    pma_text text = pma_text_begin(reason, sizeof reason);
    pma_text_word(&text, what);
    pma_text_word(&text, ": ");
    pma_text_word(&text, strerror(error));
    return refuse(reason, message);
}

/* The bytes of a file, to be freed. */
static pmalpha_status read_whole(FILE *file, char *message, void **bytes, size_t *size)
{
    const long length = fseek(file, 0, SEEK_END) == 0 ? ftell(file) : -1;
    if (length < 0 || length == LONG_MAX || fseek(file, 0, SEEK_SET) != 0)
        return refuse_for("the file cannot be read", errno, message);
    *bytes = malloc((size_t)length + 1);
    *size = (size_t)length;
    if (!*bytes)
        return pmalpha_refuse(PMALPHA_NO_MEMORY, "there is no memory for the file", message);
    if (fread(*bytes, 1, *size, file) == *size)
        return PMALPHA_OK;
    free(*bytes);
    return refuse_for("the file cannot be read", errno, message);
}

pmalpha_status pmalpha_open(const char *path, char *message, pmalpha_model **out)
{
    void *bytes = NULL;
    size_t size = 0;
    if (out)
        *out = NULL;
    if (!path || !out)
        return pmalpha_refuse(PMALPHA_BAD_ARGUMENT, "there is no path, or no place for the model",
                              message);
    if (is_no_file(path))
        return refuse("the file cannot be opened: it is no regular file", message);
    errno = 0;
    FILE *file = fopen(path, "rb");
    if (!file)
        return refuse_for("the file cannot be opened", errno, message);
    pmalpha_status status = read_whole(file, message, &bytes, &size);
    fclose(file);
    if (status != PMALPHA_OK)
        return status;
    status = pmalpha_open_bytes(bytes, size, message, out);
    if (status == PMALPHA_OK)
        (*out)->file = bytes;
    else
        free(bytes);
    return status;
}
