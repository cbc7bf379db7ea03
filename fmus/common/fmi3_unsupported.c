/* The functions of FMI 3.0 that these models do not support: other types, intervals of clocks, derivatives, other
 * interfaces. */
#include "fmi3_component.h"

#include <stdio.h>

/* A request for zero variables is accepted; any other is an error. */
static fmi3Status answer(const Component *component, const char *function, size_t count) {
    if (count == 0)
        return fmi3OK;
    if (!component)
        return fmi3Error;
    misuse(component->core, "%s offers nothing for this call; see its modelDescription.xml", FMU_MODEL->table->model);
    return fmi3_report(component, function, fmi3Error);
}

#define NO_VARIABLES_OF(Name)                                                                                          \
    fmi3Status fmi3Get##Name(fmi3Instance c, const fmi3ValueReference r[], size_t n, fmi3##Name v[], size_t nv) {      \
        (void)r, (void)v, (void)nv;                                                                                    \
        return answer(c, __func__, n);                                                                                 \
    }                                                                                                                  \
    fmi3Status fmi3Set##Name(fmi3Instance c, const fmi3ValueReference r[], size_t n, const fmi3##Name v[],             \
                             size_t nv) {                                                                              \
        (void)r, (void)v, (void)nv;                                                                                    \
        return answer(c, __func__, n);                                                                                 \
    }

NO_VARIABLES_OF(Float32)
NO_VARIABLES_OF(Int8)
NO_VARIABLES_OF(UInt8)
NO_VARIABLES_OF(Int16)
NO_VARIABLES_OF(UInt16)
NO_VARIABLES_OF(UInt32)

/* No instance for another interface than co-simulation. */
static fmi3Instance not_offered(fmi3InstanceEnvironment environment, fmi3LogMessageCallback log) {
    char message[MESSAGE_SIZE];
    snprintf(message, sizeof message, "%s is for co-simulation only; see its modelDescription.xml",
             FMU_MODEL->table->model);
    if (log)
        log(environment, fmi3Error, "logStatusError", message);
    return NULL;
}

#define UNSUPPORTED(Name, Parameters, count)                                                                           \
    fmi3Status fmi3##Name Parameters {                                                                                 \
        return answer(c, __func__, count);                                                                             \
    }

#if defined(__GNUC__)
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wunused-parameter" /* the functions below use their count at most */
#elif defined(_MSC_VER)
#pragma warning(disable : 4100)
#endif

typedef fmi3ValueReference Reference;
typedef fmi3IntervalQualifier Qualifier;

UNSUPPORTED(GetNumberOfVariableDependencies, (fmi3Instance c, Reference r, size_t *n), 1)
UNSUPPORTED(GetVariableDependencies,
            (fmi3Instance c, Reference r, size_t i[], Reference p[], size_t j[], fmi3DependencyKind k[], size_t n), 1)
UNSUPPORTED(GetDirectionalDerivative,
            (fmi3Instance c, const Reference u[], size_t nu, const Reference k[], size_t nk, const fmi3Float64 s[],
             size_t ns, fmi3Float64 v[], size_t nv),
            1)
UNSUPPORTED(GetAdjointDerivative,
            (fmi3Instance c, const Reference u[], size_t nu, const Reference k[], size_t nk, const fmi3Float64 s[],
             size_t ns, fmi3Float64 v[], size_t nv),
            1)
UNSUPPORTED(GetOutputDerivatives,
            (fmi3Instance c, const Reference r[], size_t n, const fmi3Int32 o[], fmi3Float64 v[], size_t nv), n)

UNSUPPORTED(GetIntervalDecimal, (fmi3Instance c, const Reference r[], size_t n, fmi3Float64 i[], Qualifier q[]), n)
UNSUPPORTED(GetIntervalFraction,
            (fmi3Instance c, const Reference r[], size_t n, fmi3UInt64 i[], fmi3UInt64 d[], Qualifier q[]), n)
UNSUPPORTED(GetShiftDecimal, (fmi3Instance c, const Reference r[], size_t n, fmi3Float64 s[]), n)
UNSUPPORTED(GetShiftFraction, (fmi3Instance c, const Reference r[], size_t n, fmi3UInt64 s[], fmi3UInt64 d[]), n)
UNSUPPORTED(SetIntervalDecimal, (fmi3Instance c, const Reference r[], size_t n, const fmi3Float64 i[]), n)
UNSUPPORTED(SetIntervalFraction,
            (fmi3Instance c, const Reference r[], size_t n, const fmi3UInt64 i[], const fmi3UInt64 d[]), n)
UNSUPPORTED(SetShiftDecimal, (fmi3Instance c, const Reference r[], size_t n, const fmi3Float64 s[]), n)
UNSUPPORTED(SetShiftFraction,
            (fmi3Instance c, const Reference r[], size_t n, const fmi3UInt64 s[], const fmi3UInt64 d[]), n)

UNSUPPORTED(EvaluateDiscreteStates, (fmi3Instance c), 1)

UNSUPPORTED(EnterContinuousTimeMode, (fmi3Instance c), 1)
UNSUPPORTED(CompletedIntegratorStep, (fmi3Instance c, fmi3Boolean a, fmi3Boolean *b, fmi3Boolean *d), 1)
UNSUPPORTED(SetTime, (fmi3Instance c, fmi3Float64 t), 1)
UNSUPPORTED(SetContinuousStates, (fmi3Instance c, const fmi3Float64 x[], size_t n), n)
UNSUPPORTED(GetContinuousStateDerivatives, (fmi3Instance c, fmi3Float64 x[], size_t n), n)
UNSUPPORTED(GetEventIndicators, (fmi3Instance c, fmi3Float64 x[], size_t n), n)
UNSUPPORTED(GetContinuousStates, (fmi3Instance c, fmi3Float64 x[], size_t n), n)
UNSUPPORTED(GetNominalsOfContinuousStates, (fmi3Instance c, fmi3Float64 x[], size_t n), n)
UNSUPPORTED(GetNumberOfEventIndicators, (fmi3Instance c, size_t *n), 1)
UNSUPPORTED(GetNumberOfContinuousStates, (fmi3Instance c, size_t *n), 1)
UNSUPPORTED(ActivateModelPartition, (fmi3Instance c, Reference r, fmi3Float64 t), 1)

fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String path, fmi3Boolean visible,
                                          fmi3Boolean logging, fmi3InstanceEnvironment environment,
                                          fmi3LogMessageCallback log) {
    return not_offered(environment, log);
}

fmi3Instance fmi3InstantiateScheduledExecution(fmi3String name, fmi3String token, fmi3String path, fmi3Boolean visible,
                                               fmi3Boolean logging, fmi3InstanceEnvironment environment,
                                               fmi3LogMessageCallback log, fmi3ClockUpdateCallback update,
                                               fmi3LockPreemptionCallback lock, fmi3UnlockPreemptionCallback unlock) {
    return not_offered(environment, log);
}

#if defined(__GNUC__)
#pragma GCC diagnostic pop
#endif
