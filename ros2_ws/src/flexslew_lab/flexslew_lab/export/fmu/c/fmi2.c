/* The functions of FMI 2.0 around one model. */
#include "instance.h"

typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending } fmi2Status;
typedef void (*Logger)(void *, const char *, fmi2Status, const char *, const char *, ...);
typedef struct {
    Logger logger;
    void *(*allocate)(size_t, size_t);
    void (*free)(void *);
    void (*finished)(void *, fmi2Status);
    void *environment;
} Callbacks;

typedef struct {
    Model model;
    Logger logger;
    void *environment;
    char *name;
} Instance;

static fmi2Status result(Instance *of, const char *problem) {
    if (problem == NULL) return fmi2OK;
    if (of->logger != NULL)
        of->logger(of->environment, of->name, fmi2Error, "logStatusError", "%s", problem);
    return fmi2Error;
}

#define FMI(name) fmi2##name
#define FMI_STATE(before, after) fmi2##before##FMUstate##after
#define FMI_DESERIALIZE fmi2DeSerializeFMUstate
#define FMI_DERIVATIVES fmi2GetDerivatives
typedef char Byte;
#include "both_versions.h"

EXPORT const char *fmi2GetTypesPlatform(void) { return "default"; }
EXPORT const char *fmi2GetVersion(void) { return "2.0"; }

EXPORT fmi2Status fmi2SetDebugLogging(void *c, int on, size_t n, const char *const names[]) {
    return fmi2OK;
}

EXPORT void fmi2FreeInstance(void *c) {
    Instance *of = c;
    if (of != NULL) free(of->name);
    free(of);
}

EXPORT void *fmi2Instantiate(const char *name, int type, const char *token, const char *resources,
                             const Callbacks *calls, int visible, int logging) {
    int exchanged = type == 0; /* fmi2ModelExchange */
    const char *problem = NULL;
    if (exchanged && MODEL_STATES == 0) problem = "only co-simulation is offered";
    if (token == NULL || strcmp(token, MODEL_TOKEN) != 0) problem = "the GUID is another model's";
    if (problem != NULL) {
        if (calls != NULL && calls->logger != NULL)
            calls->logger(calls->environment, name, fmi2Error, "logStatusError", "%s", problem);
        return NULL;
    }
    Instance *of = calloc(1, sizeof *of);
    if (of == NULL) return NULL;
    size_t length = strlen(name == NULL ? "" : name);
    of->name = calloc(length + 1, 1);
    if (of->name == NULL) {
        free(of);
        return NULL;
    }
    if (length > 0) memcpy(of->name, name, length);
    of->logger = calls == NULL ? NULL : calls->logger;
    of->environment = calls == NULL ? NULL : calls->environment;
    model_reset(&of->model, exchanged);
    return of;
}

EXPORT fmi2Status fmi2SetupExperiment(void *c, int tolerant, double tolerance, double start,
                                      int stops, double stop) {
    Model *model = &((Instance *)c)->model;
    model->start = model->time = start;
    return fmi2OK;
}

EXPORT fmi2Status fmi2EnterInitializationMode(void *c) {
    Model *model = &((Instance *)c)->model;
    model_begin(model, model->start);
    return fmi2OK;
}

EXPORT fmi2Status fmi2GetReal(void *c, const unsigned refs[], size_t n, double values[]) {
    const char *problem = NULL;
    model_refresh(&((Instance *)c)->model);
    for (size_t i = 0; i < n && problem == NULL; i++)
        problem = model_get(&((Instance *)c)->model, refs[i], &values[i]);
    return result(c, problem);
}

EXPORT fmi2Status fmi2SetReal(void *c, const unsigned refs[], size_t n, const double values[]) {
    const char *problem = NULL;
    for (size_t i = 0; i < n && problem == NULL; i++)
        problem = model_set(&((Instance *)c)->model, refs[i], values[i]);
    return result(c, problem);
}

/* the model has real numbers alone */
#define NONE(name, type)                                                              \
    EXPORT fmi2Status fmi2##name(void *c, const unsigned refs[], size_t n, type v[]) { \
        return n == 0 ? fmi2OK : result(c, "the model has variables of type Real alone"); \
    }
NONE(GetInteger, int)
NONE(GetBoolean, int)
NONE(GetString, const char *)
NONE(SetInteger, const int)
NONE(SetBoolean, const int)
NONE(SetString, const char *const)

EXPORT fmi2Status fmi2GetDirectionalDerivative(void *c, const unsigned unknowns[], size_t n,
                                               const unsigned knowns[], size_t m,
                                               const double along[], double derivative[]) {
    Model *model = &((Instance *)c)->model;
    return result(c, model_along(model, unknowns, n, knowns, m, along, derivative));
}

EXPORT fmi2Status fmi2SetRealInputDerivatives(void *c, const unsigned refs[], size_t n,
                                              const int order[], const double values[]) {
    return n == 0 ? fmi2OK : result(c, "inputs are held over a step; they have no derivatives");
}

EXPORT fmi2Status fmi2GetRealOutputDerivatives(void *c, const unsigned refs[], size_t n,
                                               const int order[], double values[]) {
    return n == 0 ? fmi2OK : result(c, "derivatives of outputs are not offered");
}

typedef struct {
    int again, terminate, nominals, states, defined;
    double next;
} EventInfo;

/* there are no discrete states and no events */
EXPORT fmi2Status fmi2NewDiscreteStates(void *c, EventInfo *info) {
    memset(info, 0, sizeof *info);
    return fmi2OK;
}

EXPORT fmi2Status fmi2CompletedIntegratorStep(void *c, int no_rollback, int *event,
                                              int *terminate) {
    *event = *terminate = 0;
    return fmi2OK;
}

EXPORT fmi2Status fmi2DoStep(void *c, double time, double step, int no_rollback) {
    return result(c, model_advance(&((Instance *)c)->model, step));
}

EXPORT fmi2Status fmi2CancelStep(void *c) { return result(c, "a step cannot be cancelled"); }

EXPORT fmi2Status fmi2GetStatus(void *c, int kind, fmi2Status *value) {
    return fmi2Discard;
}

EXPORT fmi2Status fmi2GetRealStatus(void *c, int kind, double *value) {
    if (kind != 2) return fmi2Discard; /* fmi2LastSuccessfulTime */
    *value = model_time(&((Instance *)c)->model);
    return fmi2OK;
}

EXPORT fmi2Status fmi2GetIntegerStatus(void *c, int kind, int *value) {
    return fmi2Discard;
}

EXPORT fmi2Status fmi2GetBooleanStatus(void *c, int kind, int *value) {
    if (kind != 3) return fmi2Discard; /* fmi2Terminated */
    *value = 0;
    return fmi2OK;
}

EXPORT fmi2Status fmi2GetStringStatus(void *c, int kind, const char **value) {
    return fmi2Discard;
}
