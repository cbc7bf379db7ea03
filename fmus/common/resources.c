#include "resources.h"

#include <ctype.h>
#include <errno.h>
#include <limits.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#if defined(_WIN32)
#include <windows.h>
#endif

char *text_copy(const char *text) {
    char *copy = text ? malloc(strlen(text) + 1) : NULL;
    return copy ? strcpy(copy, text) : NULL;
}

static int hexadecimal(char digit) {
    return isdigit((unsigned char)digit) ? digit - '0' : tolower((unsigned char)digit) - 'a' + 10;
}

/* Replaces "%20" and the like by the bytes that they encode, in place. */
static void decode_percent(char *text) {
    char *to = text;
    for (const char *from = text; *from; from++) {
        if (from[0] == '%' && isxdigit((unsigned char)from[1]) && isxdigit((unsigned char)from[2])) {
            *to++ = (char)(16 * hexadecimal(from[1]) + hexadecimal(from[2]));
            from += 2;
        } else {
            *to++ = *from;
        }
    }
    *to = '\0';
}

static bool is_drive(const char *path) {
    return isalpha((unsigned char)path[0]) && path[1] == ':';
}

static bool begins_with(const char *text, const char *scheme) {
    for (; *scheme; text++, scheme++)
        if (tolower((unsigned char)*text) != *scheme)
            return false;
    return true;
}

char *resource_path(const char *uri) {
    char *path = text_copy(uri);
    if (!path || !begins_with(path, "file:"))
        return path;
    const char *rest = path + strlen("file:");
    if (begins_with(rest, "//localhost/"))
        rest += strlen("//localhost");
    else if (rest[0] == '/' && rest[1] == '/' && rest[2] == '/')
        rest += 2;
    if (rest[0] == '/' && is_drive(rest + 1))
        rest++;
    memmove(path, rest, strlen(rest) + 1);
    decode_percent(path);
    return path;
}

static FILE *open_file(const char *path) {
#if defined(_WIN32) /* paths of FMI are UTF-8, those of fopen there are not */
    wchar_t wide[4096];
    const int count = MultiByteToWideChar(CP_UTF8, 0, path, -1, wide, 4096);
    return count > 0 ? _wfopen(wide, L"rb") : NULL;
#else
    return fopen(path, "rb");
#endif
}

/* The whole file; NULL, with errno set, if it cannot be read. */
static unsigned char *read_all(FILE *file, size_t *size) {
    if (fseek(file, 0, SEEK_END) != 0)
        return NULL;
    const long length = ftell(file);
    /* LONG_MAX: the size of a folder on Linux */
    if (length < 0 || length == LONG_MAX || fseek(file, 0, SEEK_SET) != 0)
        return NULL;
    unsigned char *bytes = malloc((size_t)length + 1); /* one more, so that an empty file is not NULL */
    if (bytes && fread(bytes, 1, (size_t)length, file) != (size_t)length) {
        free(bytes);
        return NULL;
    }
    *size = (size_t)length;
    return bytes;
}

unsigned char *read_resource(const char *folder, const char *name, size_t *size, char *message, size_t message_size) {
    if (!folder) {
        snprintf(message, message_size, "the importer names no folder of resources; %s is expected in it", name);
        return NULL;
    }
    const size_t length = strlen(folder);
    const bool is_closed = length > 0 && (folder[length - 1] == '/' || folder[length - 1] == '\\');
    char *path = malloc(length + 1 + strlen(name) + 1);
    unsigned char *bytes = NULL;
    errno = 0;
    if (path) {
        sprintf(path, "%s%s%s", folder, is_closed ? "" : "/", name);
        FILE *file = open_file(path);
        if (file) {
            bytes = read_all(file, size);
            fclose(file);
        }
    }
    if (!bytes)
        snprintf(message, message_size, "%.300s cannot be read: %s", path ? path : name,
                 errno ? strerror(errno) : "it is no file");
    free(path);
    return bytes;
}
