/* resource.c - the model of an FMU in its resources. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmu/fmu.h"

static const char NAME[] = "model.pma";

static void *read_whole(FILE *file, size_t *size)
{
    const long length = fseek(file, 0, SEEK_END) == 0 ? ftell(file) : -1;
    if (length < 0 || fseek(file, 0, SEEK_SET) != 0)
        return NULL;
    void *bytes = malloc((size_t)length + 1);
    *size = (size_t)length;
    if (bytes && fread(bytes, 1, *size, file) != *size) {
        free(bytes);
        bytes = NULL;
    }
    return bytes;
}

const void *fmu_bytes(const char *resources, size_t *size, void **owned)
{
    const size_t length = resources ? strlen(resources) : 0;
    char *path = length > 0 ? malloc(length + sizeof NAME) : NULL;
    *owned = NULL;
    if (!path)
        return NULL;
    memcpy(path, resources, length);
    memcpy(path + length, NAME, sizeof NAME);
    FILE *file = fopen(path, "rb");
    free(path);
    if (!file)
        return NULL;
    *owned = read_whole(file, size);
    fclose(file);
    return *owned;
}
