/* The functions that differ between FMI 2.0 and 3.0 by their names alone.

   The file of a version defines Instance and result, Byte, FMI(name), which begins all names,
   FMI_STATE(before, after) of the states of a unit, FMI_DESERIALIZE and FMI_DERIVATIVES. */
EXPORT FMI(Status) FMI(ExitInitializationMode)(void *c) {
    Model *model = &((Instance *)c)->model;
    model->phase = model->exchanged ? EVENT : RUNNING;
    return FMI(OK);
}

EXPORT FMI(Status) FMI(Terminate)(void *c) {
    ((Instance *)c)->model.phase = TERMINATED;
    return FMI(OK);
}

EXPORT FMI(Status) FMI(Reset)(void *c) {
    Model *model = &((Instance *)c)->model;
    model_reset(model, model->exchanged);
    return FMI(OK);
}

EXPORT FMI(Status) FMI_STATE(Get, )(void *c, void **state) {
    if (*state == NULL) *state = malloc(sizeof(Model));
    if (*state == NULL) return result(c, "out of memory");
    memcpy(*state, &((Instance *)c)->model, sizeof(Model));
    return FMI(OK);
}

EXPORT FMI(Status) FMI_STATE(Set, )(void *c, void *state) {
    memcpy(&((Instance *)c)->model, state, sizeof(Model));
    return FMI(OK);
}

EXPORT FMI(Status) FMI_STATE(Free, )(void *c, void **state) {
    free(*state);
    *state = NULL;
    return FMI(OK);
}

EXPORT FMI(Status) FMI_STATE(Serialized, Size)(void *c, void *state, size_t *size) {
    *size = sizeof(Model);
    return FMI(OK);
}

EXPORT FMI(Status) FMI_STATE(Serialize, )(void *c, void *state, Byte bytes[], size_t size) {
    if (size < sizeof(Model)) return result(c, "the buffer is smaller than a state");
    memcpy(bytes, state, sizeof(Model));
    return FMI(OK);
}

EXPORT FMI(Status) FMI_DESERIALIZE(void *c, const Byte bytes[], size_t size, void **state) {
    if (size != sizeof(Model)) return result(c, "these bytes are no state of the model");
    if (*state == NULL) *state = malloc(sizeof(Model));
    if (*state == NULL) return result(c, "out of memory");
    memcpy(*state, bytes, sizeof(Model));
    return FMI(OK);
}

EXPORT FMI(Status) FMI(EnterEventMode)(void *c) {
    return result(c, model_enter(&((Instance *)c)->model, EVENT));
}

EXPORT FMI(Status) FMI(EnterContinuousTimeMode)(void *c) {
    return result(c, model_enter(&((Instance *)c)->model, RUNNING));
}

EXPORT FMI(Status) FMI(SetTime)(void *c, double time) {
    return result(c, model_set_time(&((Instance *)c)->model, time));
}

EXPORT FMI(Status) FMI(SetContinuousStates)(void *c, const double states[], size_t n) {
    return result(c, model_set_states(&((Instance *)c)->model, states, n));
}

EXPORT FMI(Status) FMI(GetContinuousStates)(void *c, double states[], size_t n) {
    return result(c, model_states(&((Instance *)c)->model, states, n));
}

EXPORT FMI(Status) FMI_DERIVATIVES(void *c, double slopes[], size_t n) {
    return result(c, model_slopes(&((Instance *)c)->model, slopes, n));
}

EXPORT FMI(Status) FMI(GetNominalsOfContinuousStates)(void *c, double nominals[], size_t n) {
    return result(c, model_nominals(nominals, n));
}

EXPORT FMI(Status) FMI(GetEventIndicators)(void *c, double values[], size_t n) {
    return n == 0 ? FMI(OK) : result(c, "the model has no event indicators");
}
