/* A foreign plant for tests, FMI 2 with scalars: 8 rows of 12 cells, rows counted from the top.
 *
 * A step lays down what is dosed, in nanolitres on cells 263.256 um square, a twentieth of it on each of four
 * neighbours; surfaces are in millimetres. References: 0 to 95 doses, 100 to 195 heights, row by row. */
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

enum { ROWS = 8, COLUMNS = 12, CELLS = ROWS * COLUMNS, HEIGHT = 100, OK = 0, ERROR = 3 };
static const double MM_PER_NL = 1.0 / (0.263256 * 0.263256) * 1e-3;

typedef struct {
    double dose[CELLS], height[CELLS];
} Plant;

const char *fmi2GetTypesPlatform(void) {
    return "default";
}
const char *fmi2GetVersion(void) {
    return "2.0";
}
void *fmi2Instantiate(const char *name, int type, const char *guid, const char *resources, const void *callbacks,
                      int visible, int logging) {
    (void)name, (void)type, (void)guid, (void)resources, (void)callbacks, (void)visible, (void)logging;
    return calloc(1, sizeof(Plant));
}
void fmi2FreeInstance(Plant *plant) {
    free(plant);
}
int fmi2SetReal(Plant *plant, const uint32_t *reference, size_t count, const double *value) {
    for (size_t i = 0; i < count; i++) {
        if (reference[i] >= CELLS)
            return ERROR;
        plant->dose[reference[i]] = value[i];
    }
    return OK;
}
int fmi2GetReal(Plant *plant, const uint32_t *reference, size_t count, double *value) {
    for (size_t i = 0; i < count; i++)
        value[i] = reference[i] < CELLS ? plant->dose[reference[i]] : plant->height[reference[i] - HEIGHT];
    return OK;
}
static void add(Plant *plant, int row, int column, double rise) {
    if (row >= 0 && row < ROWS && column >= 0 && column < COLUMNS)
        plant->height[row * COLUMNS + column] += rise;
}
int fmi2DoStep(Plant *plant, double time, double step, int keeps) {
    (void)time, (void)step, (void)keeps;
    for (int row = 0; row < ROWS; row++)
        for (int column = 0; column < COLUMNS; column++) {
            const double rise = plant->dose[row * COLUMNS + column] * MM_PER_NL;
            add(plant, row, column, 0.8 * rise);
            add(plant, row - 1, column, 0.05 * rise);
            add(plant, row + 1, column, 0.05 * rise);
            add(plant, row, column - 1, 0.05 * rise);
            add(plant, row, column + 1, 0.05 * rise);
        }
    return OK;
}

#define DOES_NOTHING(name, status)                                                                                     \
    int name(void) {                                                                                                   \
        return status;                                                                                                 \
    }
DOES_NOTHING(fmi2SetupExperiment, OK)
DOES_NOTHING(fmi2EnterInitializationMode, OK)
DOES_NOTHING(fmi2ExitInitializationMode, OK)
DOES_NOTHING(fmi2Terminate, OK)
DOES_NOTHING(fmi2SetDebugLogging, ERROR)
DOES_NOTHING(fmi2Reset, ERROR)
DOES_NOTHING(fmi2CancelStep, ERROR)
DOES_NOTHING(fmi2GetStatus, ERROR)
DOES_NOTHING(fmi2GetRealStatus, ERROR)
DOES_NOTHING(fmi2GetIntegerStatus, ERROR)
DOES_NOTHING(fmi2GetBooleanStatus, ERROR)
DOES_NOTHING(fmi2GetStringStatus, ERROR)
DOES_NOTHING(fmi2GetInteger, ERROR)
DOES_NOTHING(fmi2SetInteger, ERROR)
DOES_NOTHING(fmi2GetBoolean, ERROR)
DOES_NOTHING(fmi2SetBoolean, ERROR)
DOES_NOTHING(fmi2GetString, ERROR)
DOES_NOTHING(fmi2SetString, ERROR)
DOES_NOTHING(fmi2GetFMUstate, ERROR)
DOES_NOTHING(fmi2SetFMUstate, ERROR)
DOES_NOTHING(fmi2FreeFMUstate, ERROR)
DOES_NOTHING(fmi2SerializedFMUstateSize, ERROR)
DOES_NOTHING(fmi2SerializeFMUstate, ERROR)
DOES_NOTHING(fmi2DeSerializeFMUstate, ERROR)
DOES_NOTHING(fmi2GetDirectionalDerivative, ERROR)
DOES_NOTHING(fmi2SetRealInputDerivatives, ERROR)
DOES_NOTHING(fmi2GetRealOutputDerivatives, ERROR)
