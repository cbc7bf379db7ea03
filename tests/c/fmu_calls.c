/* Calls an FMU for co-simulation by lines on standard input, on Linux and on Windows, and prints what it answers.

   fmu_calls LIBRARY TOKEN RESOURCES, compiled with FMI_VERSION 2 or 3. Lines, of which `run` ends the initialisation:
       real REFERENCE COUNT BITS ...     integer REFERENCE COUNT VALUE ...     run     step TIME SIZE
       reals REFERENCE COUNT             integers REFERENCE COUNT
   A real number is the 16 hexadecimal digits of its bits, so that no C library rounds it. COUNT values belong to one
   array (FMI 3) or to as many references (FMI 2). */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#if FMI_VERSION == 2
#include "fmi2FunctionTypes.h"
#else
#include "fmi3FunctionTypes.h"
#endif

#if defined(_WIN32)
#include <windows.h>
typedef HMODULE Library;
typedef FARPROC Symbol;
#define open_library LoadLibraryA
#define symbol_of GetProcAddress
#else
#include <dlfcn.h>
typedef void *Library;
typedef void *Symbol;
#define open_library(path) dlopen(path, RTLD_NOW)
#define symbol_of dlsym
#endif

enum { MOST = 1024 };

static Library library;

static void must(int is_right, const char *what) {
    if (is_right)
        return;
    fprintf(stderr, "fmu_calls: %s failed\n", what);
    exit(1);
}

/* memcpy, since C has no cast from an object to a function. */
#define FUNCTION(type, name)                                                                                           \
    type *name;                                                                                                        \
    do {                                                                                                               \
        Symbol found = symbol_of(library, #name);                                                                      \
        must(found != NULL, "looking up " #name);                                                                      \
        memcpy(&name, &found, sizeof name);                                                                            \
    } while (0)

#if FMI_VERSION == 2
static void quiet(fmi2ComponentEnvironment e, fmi2String name, fmi2Status s, fmi2String category, fmi2String text,
                  ...) {
    (void)e, (void)name, (void)s, (void)category;
    fprintf(stderr, "%s\n", text);
}

static fmi2Component begin(const char *token, const char *resources) {
    static const fmi2CallbackFunctions callbacks = {quiet, calloc, free, NULL, NULL};
    FUNCTION(fmi2InstantiateTYPE, fmi2Instantiate);
    FUNCTION(fmi2SetupExperimentTYPE, fmi2SetupExperiment);
    FUNCTION(fmi2EnterInitializationModeTYPE, fmi2EnterInitializationMode);
    fmi2Component made = fmi2Instantiate("it", fmi2CoSimulation, token, resources, &callbacks, fmi2False, fmi2False);
    must(made != NULL, "fmi2Instantiate");
    must(!fmi2SetupExperiment(made, fmi2False, 0.0, 0.0, fmi2False, 0.0), "fmi2SetupExperiment");
    must(!fmi2EnterInitializationMode(made), "fmi2EnterInitializationMode");
    return made;
}

static void run(fmi2Component it) {
    FUNCTION(fmi2ExitInitializationModeTYPE, fmi2ExitInitializationMode);
    must(!fmi2ExitInitializationMode(it), "fmi2ExitInitializationMode");
}

static void step(fmi2Component it, double time, double size) {
    FUNCTION(fmi2DoStepTYPE, fmi2DoStep);
    must(!fmi2DoStep(it, time, size, fmi2True), "fmi2DoStep");
}

static const fmi2ValueReference *references(unsigned first, size_t count) {
    static fmi2ValueReference made[MOST];
    for (size_t k = 0; k < count; k++)
        made[k] = first + (unsigned)k;
    return made;
}

#define ACCESS(verb, kind, type, function)                                                                             \
    static void verb##_##kind(fmi2Component it, unsigned first, size_t count, type *values) {                          \
        FUNCTION(function##TYPE, function);                                                                            \
        must(!function(it, references(first, count), count, values), #function);                                       \
    }
ACCESS(set, reals, double, fmi2SetReal)
ACCESS(get, reals, double, fmi2GetReal)
ACCESS(set, integers, int, fmi2SetInteger)
ACCESS(get, integers, int, fmi2GetInteger)
typedef fmi2Component Instance;
#else
static void quiet(fmi3InstanceEnvironment e, fmi3Status s, fmi3String category, fmi3String text) {
    (void)e, (void)s, (void)category;
    fprintf(stderr, "%s\n", text);
}

static fmi3Instance begin(const char *token, const char *resources) {
    FUNCTION(fmi3InstantiateCoSimulationTYPE, fmi3InstantiateCoSimulation);
    FUNCTION(fmi3EnterInitializationModeTYPE, fmi3EnterInitializationMode);
    fmi3Instance made = fmi3InstantiateCoSimulation("it", token, resources, fmi3False, fmi3False, fmi3False, fmi3False,
                                                    NULL, 0, NULL, quiet, NULL);
    must(made != NULL, "fmi3InstantiateCoSimulation");
    must(!fmi3EnterInitializationMode(made, fmi3False, 0.0, 0.0, fmi3False, 0.0), "fmi3EnterInitializationMode");
    return made;
}

static void run(fmi3Instance it) {
    FUNCTION(fmi3ExitInitializationModeTYPE, fmi3ExitInitializationMode);
    must(!fmi3ExitInitializationMode(it), "fmi3ExitInitializationMode");
}

static void step(fmi3Instance it, double time, double size) {
    fmi3Boolean event, terminate, early;
    fmi3Float64 reached;
    FUNCTION(fmi3DoStepTYPE, fmi3DoStep);
    must(!fmi3DoStep(it, time, size, fmi3True, &event, &terminate, &early, &reached), "fmi3DoStep");
}

#define ACCESS(verb, kind, type, function)                                                                             \
    static void verb##_##kind(fmi3Instance it, unsigned reference, size_t count, type *values) {                       \
        FUNCTION(function##TYPE, function);                                                                            \
        must(!function(it, &reference, 1, values, count), #function);                                                  \
    }
ACCESS(set, reals, double, fmi3SetFloat64)
ACCESS(get, reals, double, fmi3GetFloat64)
ACCESS(set, integers, int32_t, fmi3SetInt32)
ACCESS(get, integers, int32_t, fmi3GetInt32)
typedef fmi3Instance Instance;
#endif

static double read_real(void) {
    uint64_t bits;
    double value;
    must(scanf("%" SCNx64, &bits) == 1, "reading the bits of a number");
    memcpy(&value, &bits, sizeof value);
    return value;
}

static void exchange(Instance it, const char *verb) {
    static double reals[MOST];
    static int integers[MOST];
    unsigned reference, count;
    must(scanf("%u %u", &reference, &count) == 2 && count <= MOST, "reading a reference and a count");
    if (strcmp(verb, "real") == 0) {
        for (unsigned k = 0; k < count; k++)
            reals[k] = read_real();
        set_reals(it, reference, count, reals);
    } else if (strcmp(verb, "integer") == 0) {
        for (unsigned k = 0; k < count; k++)
            must(scanf("%d", &integers[k]) == 1, "reading an integer");
        set_integers(it, reference, count, integers);
    } else if (strcmp(verb, "reals") == 0) {
        get_reals(it, reference, count, reals);
        for (unsigned k = 0; k < count; k++) {
            uint64_t bits;
            memcpy(&bits, &reals[k], sizeof bits);
            printf("%016" PRIx64 "\n", bits);
        }
    } else {
        must(strcmp(verb, "integers") == 0, verb);
        get_integers(it, reference, count, integers);
        for (unsigned k = 0; k < count; k++)
            printf("%d\n", integers[k]);
    }
}

int main(int count, char **words) {
    must(count == 4, "counting the arguments LIBRARY, TOKEN and RESOURCES");
    library = open_library(words[1]);
    must(library != NULL, "loading the library");
    Instance it = begin(words[2], words[3]);
    char verb[16];
    while (scanf("%15s", verb) == 1) {
        if (strcmp(verb, "run") == 0) {
            run(it);
        } else if (strcmp(verb, "step") == 0) {
            double time = read_real(), size = read_real();
            step(it, time, size);
        } else {
            exchange(it, verb);
        }
    }
    return 0;
}
