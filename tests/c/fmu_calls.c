/* Calls an FMU for co-simulation by lines on standard input, on Linux and on Windows, and prints what it answers.

   fmu_calls VERSION LIBRARY TOKEN RESOURCES, of FMI 2 or 3. Lines, of which `run` ends the initialisation:
       real REFERENCE COUNT BITS ...     integer REFERENCE COUNT VALUE ...     run     step TIME SIZE
       reals REFERENCE COUNT             integers REFERENCE COUNT
   A real number is the 16 hexadecimal digits of its bits, so that no C library rounds it. COUNT values belong to one
   array (FMI 3) or to as many references (FMI 2). */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmu.h"
#include "shared_library.h"

enum { MOST = 1024 };

static const Version *version;
static Log messages;

static void must(bool is_right, const char *what) {
    if (is_right)
        return;
    fprintf(stderr, "fmu_calls: %s failed\n%s\n", what, messages.text);
    exit(1);
}

static double read_real(void) {
    uint64_t bits;
    double value;
    must(scanf("%" SCNx64, &bits) == 1, "reading the bits of a number");
    memcpy(&value, &bits, sizeof value);
    return value;
}

static void exchange(void *it, const char *verb) {
    static double reals[MOST];
    static int32_t integers[MOST];
    static uint32_t references[MOST];
    unsigned first, count;
    const bool is_real = strncmp(verb, "real", 4) == 0,
               gives = strcmp(verb, "real") == 0 || strcmp(verb, "integer") == 0;
    void *values = is_real ? (void *)reals : (void *)integers;
    must(is_real || strncmp(verb, "integer", 7) == 0, verb);
    must(scanf("%u %u", &first, &count) == 2 && count <= MOST, "reading a reference and a count");
    for (unsigned k = 0; k < count; k++)
        references[k] = first + k;
    for (unsigned k = 0; gives && k < count; k++) {
        if (is_real)
            reals[k] = read_real();
        else
            must(scanf("%" SCNd32, &integers[k]) == 1, "reading an integer");
    }
    const size_t named = version == &VERSION_2 ? count : 1;
    must((gives ? version->set(it, is_real ? 'r' : 'i', references, named, values, count)
                : version->get(it, is_real ? 'r' : 'i', references, named, values, count)) == OK,
         verb);
    for (unsigned k = 0; !gives && k < count; k++) {
        uint64_t bits;
        memcpy(&bits, &reals[k], sizeof bits);
        if (is_real)
            printf("%016" PRIx64 "\n", bits);
        else
            printf("%" PRId32 "\n", integers[k]);
    }
}

int main(int count, char **words) {
    must(count == 5, "counting the arguments VERSION, LIBRARY, TOKEN and RESOURCES");
    version = strcmp(words[1], "2") == 0 ? &VERSION_2 : &VERSION_3;
    void *library = (void *)open_library(words[2]);
    must(library && version->load(library), "loading the library");
    void *it = version->instantiate(words[3], words[4], &messages);
    must(it != NULL, "instantiation");
    must(version->enter(it, 0.0) == OK, "the begin of the initialisation");
    char verb[16];
    while (scanf("%15s", verb) == 1) {
        if (strcmp(verb, "run") == 0) {
            must(version->exit(it) == OK, "the end of the initialisation");
        } else if (strcmp(verb, "step") == 0) {
            const double time = read_real(), size = read_real();
            must(version->step(it, time, size) == OK, "a step");
        } else {
            exchange(it, verb);
        }
    }
    return 0;
}
