/* Loaded before the C library (LD_PRELOAD), so that a program as it is installed kills itself at a place that is
 * counted, not timed: INKLOOP_KILL_AT=N ends it at the N-th look, jN at the N-th look at a record of a journal, sN at
 * the N-th answer of the head or the lamp that a step is under way. Looks are before and after each frame of ISO-TP
 * that comes or goes on slcan, before, in the middle of and after each write to a file, before and after each renaming.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { ANYWHERE, RECORD, STEP, KINDS, RECORD_BYTES = 40 };
static unsigned long looks[KINDS], kill_at[KINDS];
static const char FRAME_OF_ISOTP[] = "t64"; /* ids 0x640 to 0x647 */
static const char *const BUSY[] = {"t6418037F3178", "t6458037F3178"};

static size_t (*real_fwrite)(const void *, size_t, size_t, FILE *);
static int (*real_rename)(const char *, const char *);
static ssize_t (*real_read)(int, void *, size_t);
static ssize_t (*real_write)(int, const void *, size_t);

static void find(void *to, const char *name) {
    void *found = dlsym(RTLD_NEXT, name);
    memcpy(to, &found, sizeof found);
}

__attribute__((constructor)) static void prepare(void) {
    const char *at = getenv("INKLOOP_KILL_AT");
    if (at && *at == 'j')
        kill_at[RECORD] = strtoul(at + 1, NULL, 10);
    else if (at && *at == 's')
        kill_at[STEP] = strtoul(at + 1, NULL, 10);
    else if (at)
        kill_at[ANYWHERE] = strtoul(at, NULL, 10);
    find(&real_fwrite, "fwrite");
    find(&real_rename, "rename");
    find(&real_read, "read");
    find(&real_write, "write");
}

__attribute__((destructor)) static void report(void) {
    fprintf(stderr, "looks %lu, at records %lu, in steps %lu\n", looks[ANYWHERE], looks[RECORD], looks[STEP]);
}

static void look_at(int kind) {
    if (++looks[ANYWHERE] == kill_at[ANYWHERE] || (kind != ANYWHERE && ++looks[kind] == kill_at[kind]))
        kill(getpid(), SIGKILL);
}

static int holds(const void *bytes, size_t length, const char *text) {
    return memmem(bytes, length, text, strlen(text)) != NULL;
}

size_t fwrite(const void *from, size_t size, size_t count, FILE *file) {
    if (file == stdout || file == stderr)
        return real_fwrite(from, size, count, file);
    const size_t bytes = size * count, half = bytes / 2;
    const int kind = bytes == RECORD_BYTES ? RECORD : ANYWHERE;
    look_at(kind);
    if (real_fwrite(from, 1, half, file) != half || fflush(file) != 0)
        return 0;
    look_at(kind);
    if (real_fwrite((const char *)from + half, 1, bytes - half, file) != bytes - half || fflush(file) != 0)
        return 0;
    look_at(kind);
    return count;
}

int rename(const char *from, const char *to) {
    look_at(ANYWHERE);
    const int result = real_rename(from, to);
    look_at(ANYWHERE);
    return result;
}

ssize_t read(int file, void *to, size_t room) {
    const ssize_t got = real_read(file, to, room);
    if (got > 0 && holds(to, (size_t)got, FRAME_OF_ISOTP))
        look_at(ANYWHERE);
    return got;
}

ssize_t write(int file, const void *from, size_t length) {
    const int counts = holds(from, length, FRAME_OF_ISOTP);
    const int step = holds(from, length, BUSY[0]) || holds(from, length, BUSY[1]);
    if (counts)
        look_at(ANYWHERE);
    const ssize_t written = real_write(file, from, length);
    if (counts)
        look_at(step ? STEP : ANYWHERE);
    return written;
}
