/* Runs a fuzz target without a fuzzer: over the files named on the command line, or over inputs that come on standard
 * input, each as two bytes of length, low byte first, and that many bytes; one byte is written for each that is
 * through. */
#define _POSIX_C_SOURCE 200809L
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#include "input.h"

enum { LENGTH_MAX = 65535 };
enum { SECONDS_MAX = 20 }; /* an input that takes longer hangs: the signal of the alarm ends the process */

static int run_file(const char *path) {
    static uint8_t bytes[LENGTH_MAX];
    FILE *file = fopen(path, "rb");
    if (!file) {
        perror(path);
        return 1;
    }
    const size_t length = fread(bytes, 1, sizeof bytes, file);
    fclose(file);
    fprintf(stderr, "%s\n", path);
    alarm(SECONDS_MAX);
    return LLVMFuzzerTestOneInput(bytes, length);
}

/* A copy of its own for each input: a read beyond its end is seen. */
static int run_stream(void) {
    for (;;) {
        const int low = getchar(), high = getchar();
        if (low == EOF || high == EOF)
            return 0;
        const size_t length = (size_t)low | (size_t)high << 8;
        uint8_t *bytes = malloc(length ? length : 1);
        if (!bytes || fread(bytes, 1, length, stdin) != length) {
            free(bytes);
            return 1;
        }
        alarm(SECONDS_MAX);
        LLVMFuzzerTestOneInput(bytes, length);
        free(bytes);
        putchar('.');
        fflush(stdout);
    }
}

int main(int count, char **arguments) {
    if (count == 1)
        return run_stream();
    for (int k = 1; k < count; k++)
        if (run_file(arguments[k]) != 0)
            return 1;
    return 0;
}
