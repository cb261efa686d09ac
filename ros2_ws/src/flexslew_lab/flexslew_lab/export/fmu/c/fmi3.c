/* The functions of FMI 3.0 around one model. */
#include <stdbool.h>

#include "instance.h"

typedef enum { fmi3OK, fmi3Warning, fmi3Discard, fmi3Error, fmi3Fatal } fmi3Status;
typedef void (*Logger)(void *, fmi3Status, const char *, const char *);
typedef uint32_t Ref;

typedef struct {
    Model model;
    Logger logger;
    void *environment;
} Instance;

static fmi3Status result(Instance *of, const char *problem) {
    if (problem == NULL) return fmi3OK;
    if (of->logger != NULL) of->logger(of->environment, fmi3Error, "logStatusError", problem);
    return fmi3Error;
}

#define FMI(name) fmi3##name
#define FMI_STATE(before, after) fmi3##before##FMUState##after
#define FMI_DESERIALIZE fmi3DeserializeFMUState
#define FMI_DERIVATIVES fmi3GetContinuousStateDerivatives
typedef uint8_t Byte;
#include "both_versions.h"

EXPORT const char *fmi3GetVersion(void) { return "3.0"; }

EXPORT fmi3Status fmi3SetDebugLogging(void *c, bool on, size_t n, const char *const names[]) {
    return fmi3OK;
}

EXPORT void fmi3FreeInstance(void *c) { free(c); }

static void *instance(const char *token, void *environment, Logger logger, int exchanged) {
    if (token == NULL || strcmp(token, MODEL_TOKEN) != 0) {
        if (logger != NULL)
            logger(environment, fmi3Error, "logStatusError", "the token is another model's");
        return NULL;
    }
    Instance *of = calloc(1, sizeof *of);
    if (of == NULL) return NULL;
    of->logger = logger;
    of->environment = environment;
    model_reset(&of->model, exchanged);
    return of;
}

EXPORT void *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *resources,
                                         bool visible, bool logging, bool events, bool early,
                                         const Ref needed[], size_t n, void *environment,
                                         Logger logger, void (*update)(void)) {
    return instance(token, environment, logger, 0);
}

EXPORT void *fmi3InstantiateModelExchange(const char *name, const char *token,
                                          const char *resources, bool visible, bool logging,
                                          void *environment, Logger logger) {
    return MODEL_STATES ? instance(token, environment, logger, 1) : NULL;
}

EXPORT void *fmi3InstantiateScheduledExecution(const char *name, const char *token,
                                               const char *resources, bool visible, bool logging,
                                               void *environment, Logger logger,
                                               void (*update)(void *), void (*lock)(void),
                                               void (*unlock)(void)) {
    return NULL;
}

EXPORT fmi3Status fmi3EnterInitializationMode(void *c, bool tolerant, double tolerance,
                                              double start, bool stops, double stop) {
    model_begin(&((Instance *)c)->model, start);
    return fmi3OK;
}

EXPORT fmi3Status fmi3GetFloat64(void *c, const Ref refs[], size_t n, double values[], size_t m) {
    const char *problem = n == m ? NULL : "all variables are scalars";
    model_refresh(&((Instance *)c)->model);
    for (size_t i = 0; i < n && problem == NULL; i++)
        problem = model_get(&((Instance *)c)->model, refs[i], &values[i]);
    return result(c, problem);
}

EXPORT fmi3Status fmi3SetFloat64(void *c, const Ref refs[], size_t n, const double values[],
                                 size_t m) {
    const char *problem = n == m ? NULL : "all variables are scalars";
    for (size_t i = 0; i < n && problem == NULL; i++)
        problem = model_set(&((Instance *)c)->model, refs[i], values[i]);
    return result(c, problem);
}

/* the model has variables of type Float64 alone */
#define NONE(name, type)                                                                          \
    EXPORT fmi3Status fmi3Get##name(void *c, const Ref refs[], size_t n, type v[], size_t m) {       \
        return n == 0 ? fmi3OK : result(c, "the model has variables of type Float64 alone");      \
    }                                                                                             \
    EXPORT fmi3Status fmi3Set##name(void *c, const Ref refs[], size_t n, const type v[], size_t m) { \
        return n == 0 ? fmi3OK : result(c, "the model has variables of type Float64 alone");      \
    }
NONE(Float32, float)
NONE(Int8, int8_t)
NONE(UInt8, uint8_t)
NONE(Int16, int16_t)
NONE(UInt16, uint16_t)
NONE(Int32, int32_t)
NONE(UInt32, uint32_t)
NONE(Int64, int64_t)
NONE(UInt64, uint64_t)
NONE(Boolean, bool)
typedef const char *Text;
NONE(String, Text)

EXPORT fmi3Status fmi3EnterStepMode(void *c) { return fmi3OK; }
EXPORT fmi3Status fmi3EnterConfigurationMode(void *c) { return fmi3OK; }
EXPORT fmi3Status fmi3ExitConfigurationMode(void *c) { return fmi3OK; }

EXPORT fmi3Status fmi3DoStep(void *c, double time, double step, bool no_rollback, bool *event,
                             bool *terminate, bool *early, double *last) {
    const char *problem = model_advance(&((Instance *)c)->model, step);
    *event = *terminate = *early = false;
    *last = model_time(&((Instance *)c)->model);
    return result(c, problem);
}

EXPORT fmi3Status fmi3GetNumberOfEventIndicators(void *c, size_t *count) {
    *count = 0;
    return fmi3OK;
}

EXPORT fmi3Status fmi3GetNumberOfContinuousStates(void *c, size_t *count) {
    *count = MODEL_STATES;
    return fmi3OK;
}

/* there are no discrete states and no events */
EXPORT fmi3Status fmi3UpdateDiscreteStates(void *c, bool *again, bool *terminate, bool *nominals,
                                           bool *states, bool *defined, double *next) {
    *again = *terminate = *nominals = *states = *defined = false;
    *next = 0.0;
    return fmi3OK;
}

EXPORT fmi3Status fmi3EvaluateDiscreteStates(void *c) { return fmi3OK; }

EXPORT fmi3Status fmi3CompletedIntegratorStep(void *c, bool no_rollback, bool *event,
                                              bool *terminate) {
    *event = *terminate = false;
    return fmi3OK;
}

EXPORT fmi3Status fmi3GetDirectionalDerivative(void *c, const Ref unknowns[], size_t n,
                                               const Ref knowns[], size_t m,
                                               const double along[], size_t seeds,
                                               double derivatives[], size_t count) {
    if (seeds != m || count != n) return result(c, "all variables are scalars");
    Model *model = &((Instance *)c)->model;
    return result(c, model_along(model, unknowns, n, knowns, m, along, derivatives));
}

/* functions of abilities that the description does not announce */
#define REFUSED(name, ...)                                        \
    EXPORT fmi3Status fmi3##name(void *c, __VA_ARGS__) {          \
        return result(c, "fmi3" #name " is not offered");         \
    }
REFUSED(GetBinary, const Ref r[], size_t n, size_t sizes[], const uint8_t *v[], size_t m)
REFUSED(SetBinary, const Ref r[], size_t n, const size_t sizes[], const uint8_t *const v[], size_t m)
REFUSED(GetClock, const Ref r[], size_t n, bool v[])
REFUSED(SetClock, const Ref r[], size_t n, const bool v[])
REFUSED(GetNumberOfVariableDependencies, Ref r, size_t *n)
REFUSED(GetVariableDependencies, Ref r, size_t d[], Ref i[], size_t e[], int kinds[], size_t n)
REFUSED(GetAdjointDerivative, const Ref u[], size_t n, const Ref k[], size_t m, const double s[],
        size_t ns, double d[], size_t nd)
REFUSED(GetIntervalDecimal, const Ref r[], size_t n, double v[], int q[])
REFUSED(GetIntervalFraction, const Ref r[], size_t n, uint64_t v[], uint64_t d[], int q[])
REFUSED(GetShiftDecimal, const Ref r[], size_t n, double v[])
REFUSED(GetShiftFraction, const Ref r[], size_t n, uint64_t v[], uint64_t d[])
REFUSED(SetIntervalDecimal, const Ref r[], size_t n, const double v[])
REFUSED(SetIntervalFraction, const Ref r[], size_t n, const uint64_t v[], const uint64_t d[])
REFUSED(SetShiftDecimal, const Ref r[], size_t n, const double v[])
REFUSED(SetShiftFraction, const Ref r[], size_t n, const uint64_t v[], const uint64_t d[])
REFUSED(GetOutputDerivatives, const Ref r[], size_t n, const int32_t o[], double v[], size_t m)
REFUSED(ActivateModelPartition, Ref r, double time)
