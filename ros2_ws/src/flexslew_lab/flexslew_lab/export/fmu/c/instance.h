/* One instance of the model: its numbers, its time, and the tick that both FMI versions call.

   model.h, which is generated, includes the model's header and defines
   MODEL_INIT, MODEL_STEP, MODEL_MEMORY, MODEL_INPUT, MODEL_OUTPUT  names of the C code,
   MODEL_INPUTS, MODEL_OUTPUTS  how many numbers the two structs have,
   MODEL_VARIABLES, model_places  the number that each value reference stands for,
   model_start  the numbers at the start, MODEL_PERIOD [s], MODEL_TOKEN, MODEL_TIMED,
   MODEL_PARAMETERS  how many parameters it has; if any: MODEL_PARAMETERS_OF, their struct in the
   memory, MODEL_SET_PARAMETERS, the function that replaces them, and MODEL_TUNABLE, whether they
   may change in the run: gains; else they are factors, above 0, that are set before it,
   MODEL_STATES  how many continuous states it has; if any: MODEL_STATE, the member of the memory,
   and MODEL_DERIVATIVES, MODEL_OUTPUTS_AT, MODEL_MEASURE  functions of them,
   MODEL_DERIVATIVES_ALONG, MODEL_OUTPUTS_ALONG  their directional derivatives, if it has them. */
#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "model.h"

#if defined(__GNUC__) /* functions of the interface have arguments that no model needs */
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif

#define MODEL_NUMBERS (MODEL_INPUTS + MODEL_OUTPUTS)
#define STEP_TOLERANCE 1e-6 /* of a period, by which a communication step may miss its multiple */

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

typedef enum { CREATED, INITIALIZING, EVENT, RUNNING, TERMINATED } Phase;

typedef struct {
    MODEL_MEMORY memory;
    union {
        MODEL_INPUT of;
        double numbers[MODEL_INPUTS];
    } input;
    union {
        MODEL_OUTPUT of;
        double numbers[MODEL_OUTPUTS];
    } output;
    double start;  /* time of tick 0 [s] */
    int64_t ticks; /* since then */
    int exchanged; /* whether another program integrates the states: model exchange */
    double time;   /* which it has set [s] */
#if MODEL_STATES
    double slopes[MODEL_STATES]; /* derivatives of the states */
#endif
    Phase phase;
} Model;

/* fails to compile if the structs hold anything but these numbers */
typedef char inputs_are_doubles[sizeof(MODEL_INPUT) == MODEL_INPUTS * sizeof(double) ? 1 : -1];
typedef char outputs_are_doubles[sizeof(MODEL_OUTPUT) == MODEL_OUTPUTS * sizeof(double) ? 1 : -1];
#if MODEL_PARAMETERS
typedef char parameters_are_doubles[
    sizeof(MODEL_PARAMETERS_OF) == MODEL_PARAMETERS * sizeof(double) ? 1 : -1];
#endif

static double model_time(const Model *model) {
    if (model->exchanged) return model->time;
    return model->start + (double)model->ticks * MODEL_PERIOD;
}

static void model_reset(Model *model, int exchanged) {
    memset(model, 0, sizeof *model);
    model->exchanged = exchanged;
    MODEL_INIT(&model->memory);
    memcpy(model->input.numbers, model_start, sizeof model->input);
    memcpy(model->output.numbers, model_start + MODEL_INPUTS, sizeof model->output);
    model->phase = CREATED;
}

/* Start at a time [s]. */
static void model_begin(Model *model, double start) {
    model->start = model->time = start;
    model->phase = INITIALIZING;
}

/* Calculate what depends on states, inputs and time, before it is read. */
static void model_refresh(Model *model) {
#if MODEL_STATES
    model->input.numbers[0] = model_time(model);
    MODEL_DERIVATIVES(&model->memory, model->memory.MODEL_STATE, &model->input.of, model->slopes);
    if (model->exchanged)
        MODEL_OUTPUTS_AT(&model->memory, model->memory.MODEL_STATE, &model->input.of,
                         &model->output.of);
    else if (model->ticks == 0) { /* no effort has acted yet; later they are of the last tick */
        union {
            MODEL_INPUT of;
            double numbers[MODEL_INPUTS];
        } none = {{0}};
        none.numbers[0] = model_time(model);
        MODEL_MEASURE(&model->memory, &none.of, &model->output.of);
    }
#else
    (void)model;
#endif
}

/* Return the number that a value reference above 0 stands for. */
static double *model_number(Model *model, uint32_t reference) {
    size_t place = model_places[reference];
    if (place < MODEL_INPUTS) return &model->input.numbers[place];
    if (place < MODEL_NUMBERS) return &model->output.numbers[place - MODEL_INPUTS];
    place -= MODEL_NUMBERS;
#if MODEL_STATES
    if (place < MODEL_STATES) return &model->memory.MODEL_STATE[place];
    if (place < 2 * MODEL_STATES) return &model->slopes[place - MODEL_STATES];
    place -= 2 * MODEL_STATES;
#endif
#if MODEL_PARAMETERS
    return (double *)&model->memory.parameters + place;
#else
    return NULL;
#endif
}

/* Write the number of a value reference; return NULL, or what is wrong. */
static const char *model_get(Model *model, uint32_t reference, double *value) {
    if (reference >= MODEL_VARIABLES) return "no variable has this value reference";
    *value = reference == 0 ? model_time(model) : *model_number(model, reference);
    return NULL;
}

static const char *model_set(Model *model, uint32_t reference, double value) {
    if (reference == 0 || reference >= MODEL_VARIABLES) return "no variable can be set here";
    size_t place = model_places[reference];
    if (!isfinite(value)) return "what is set must be a finite number";
#if MODEL_PARAMETERS
    if (place >= MODEL_NUMBERS + 2 * MODEL_STATES) {
        if (!MODEL_TUNABLE && model->phase > INITIALIZING)
            return "a fixed parameter is set before the run";
        if (!MODEL_TUNABLE && value <= 0.0) return "a factor must be above 0";
        MODEL_PARAMETERS_OF changed = model->memory.parameters;
        ((double *)&changed)[place - MODEL_NUMBERS - 2 * MODEL_STATES] = value;
        MODEL_SET_PARAMETERS(&model->memory, &changed);
        return NULL;
    }
#endif
    if (place >= MODEL_INPUTS && (place < MODEL_NUMBERS || place >= MODEL_NUMBERS + MODEL_STATES))
        return "an output or a derivative cannot be set";
    if (place >= MODEL_INPUTS && model->phase == RUNNING)
        return "a state can be set before the run and in event mode";
    *model_number(model, reference) = value;
    return NULL;
}

/* The calls of an integrator of another program, the same for both versions of FMI. */
static const char *model_states(const Model *model, double states[], size_t count) {
    if (count != MODEL_STATES) return "the model has another number of states";
#if MODEL_STATES
    memcpy(states, model->memory.MODEL_STATE, sizeof model->memory.MODEL_STATE);
#endif
    return NULL;
}

static const char *model_set_states(Model *model, const double states[], size_t count) {
    if (count != MODEL_STATES) return "the model has another number of states";
    if (!model->exchanged) return "states are set by integrators in model exchange";
#if MODEL_STATES
    memcpy(model->memory.MODEL_STATE, states, sizeof model->memory.MODEL_STATE);
#endif
    return NULL;
}

static const char *model_slopes(Model *model, double slopes[], size_t count) {
    if (count != MODEL_STATES) return "the model has another number of states";
    model_refresh(model);
#if MODEL_STATES
    memcpy(slopes, model->slopes, sizeof model->slopes);
#endif
    return NULL;
}

/* Write the derivatives of unknowns along a direction of knowns; return NULL, or what is wrong. */
static const char *model_along(Model *model, const uint32_t unknowns[], size_t n,
                               const uint32_t knowns[], size_t m, const double direction[],
                               double derivatives[]) {
#ifdef MODEL_DERIVATIVES_ALONG
    double state[MODEL_STATES] = {0.0}, slope[MODEL_STATES];
    union {
        MODEL_INPUT of;
        double numbers[MODEL_INPUTS];
    } input = {{0}};
    union {
        MODEL_OUTPUT of;
        double numbers[MODEL_OUTPUTS];
    } output;
    model->input.numbers[0] = model_time(model);
    for (size_t k = 0; k < m; k++) {
        if (knowns[k] >= MODEL_VARIABLES) return "no variable has this value reference";
        size_t place = model_places[knowns[k]];
        if (place < MODEL_INPUTS)
            input.numbers[place] = direction[k];
        else if (place >= MODEL_NUMBERS && place < MODEL_NUMBERS + MODEL_STATES)
            state[place - MODEL_NUMBERS] = direction[k];
        else
            return "derivatives are taken by states, inputs and the time";
    }
    MODEL_DERIVATIVES_ALONG(&model->memory, model->memory.MODEL_STATE, &model->input.of, state,
                            &input.of, model->slopes, slope);
    MODEL_OUTPUTS_ALONG(&model->memory, model->memory.MODEL_STATE, &model->input.of, state,
                        &input.of, &model->output.of, &output.of);
    for (size_t k = 0; k < n; k++) {
        if (unknowns[k] >= MODEL_VARIABLES) return "no variable has this value reference";
        size_t place = model_places[unknowns[k]] - MODEL_INPUTS;
        if (unknowns[k] > 0 && place < MODEL_OUTPUTS)
            derivatives[k] = output.numbers[place];
        else if (place >= MODEL_OUTPUTS + MODEL_STATES && place < MODEL_OUTPUTS + 2 * MODEL_STATES)
            derivatives[k] = slope[place - MODEL_OUTPUTS - MODEL_STATES];
        else
            return "derivatives are those of outputs and of derivatives of states";
    }
    return model->exchanged ? NULL : "directional derivatives are those of model exchange";
#else
    return "the model has no directional derivatives";
#endif
}

static const char *model_nominals(double nominals[], size_t count) {
    if (count != MODEL_STATES) return "the model has another number of states";
    for (size_t k = 0; k < count; k++) nominals[k] = 1.0;
    return NULL;
}

static const char *model_set_time(Model *model, double time) {
    if (!model->exchanged) return "the time is set in model exchange";
    model->time = time;
    return NULL;
}

static const char *model_enter(Model *model, Phase phase) {
    if (!model->exchanged) return "there are no modes of events and of continuous time here";
    model->phase = phase;
    return NULL;
}

/* Advance by a communication step [s] with the inputs held; return NULL, or what is wrong. */
static const char *model_advance(Model *model, double step) {
    double ticks = floor(step / MODEL_PERIOD + 0.5);
    if (model->exchanged) return "model exchange has no steps";
    if (model->phase != RUNNING) return "a step is only possible after the initialization";
    if (!(ticks >= 1.0 && ticks <= 1e15 &&
          fabs(step - ticks * MODEL_PERIOD) <= STEP_TOLERANCE * MODEL_PERIOD))
        return "the communication step must be a multiple of the period, " MODEL_PERIOD_TEXT " s";
    for (int64_t end = model->ticks + (int64_t)ticks; model->ticks < end;) {
#if MODEL_TIMED
        model->input.numbers[0] = model_time(model);
#endif
        MODEL_STEP(&model->memory, &model->input.of, &model->output.of);
        model->ticks += 1;
    }
    return NULL;
}
