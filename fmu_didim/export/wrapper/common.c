/* Functions that all versions of FMI have in the same words.
 *
 * Included by the file of a version, which has defined its types, Instance, report() and NAME(), and
 *     FMI(name)          a type, a constant or a function of the version: FMI(Status) is fmi2Status
 *     STATE(verb)        a function for saved states: STATE(Free) is fmi2FreeFMUstate
 *     DESERIALIZE_STATE, STATE_DERIVATIVES   functions whose names are not made like that
 */
#define FUNCTION(type, name) EXPORT type NAME(name)
#define QUOTED_EXPANDED(name) #name
#define QUOTED(name) QUOTED_EXPANDED(name)

/* Only continuous blocks have continuous states. */
#define CONTINUOUS_STATE_COUNT DERIVATIVE_COUNT

APART static int in_mode(Instance *instance, int allowed, const char *function) {
    return report(instance, core_check_mode(instance->core, allowed, function)) == FMI(OK);
}

APART static FMI(Status) not_provided(Instance *instance, const char *what) {
    return report(instance, core_fail(instance->core, "this FMU has no %s", what));
}

/* ---- life cycle ------------------------------------------------------------------------------ */

FUNCTION(FMI(Status), FMI(SetDebugLogging))(void *c, FMI(Boolean) on, size_t count, const FMI(String) categories[]) {
    (void)c, (void)on, (void)count, (void)categories; /* errors are always logged, and nothing else is */
    return FMI(OK);
}

FUNCTION(FMI(Status), FMI(ExitInitializationMode))(void *c) {
    Instance *instance = c;
    if (!in_mode(instance, MODE_BIT(MODE_INITIALIZATION), QUOTED(FMI(ExitInitializationMode)))) return FMI(Error);
    if (core_finish_initialization(instance->core)) return report(instance, CORE_ERROR);
    core_set_mode(instance->core, instance->co_simulation ? MODE_STEP : MODE_EVENT);
    return FMI(OK);
}

FUNCTION(FMI(Status), FMI(Terminate))(void *c) {
    core_set_mode(((Instance *)c)->core, MODE_TERMINATED);
    return FMI(OK);
}

FUNCTION(FMI(Status), FMI(Reset))(void *c) {
    core_reset(((Instance *)c)->core);
    return FMI(OK);
}

/* ---- saved states ---------------------------------------------------------------------------- */

FUNCTION(FMI(Status), STATE(Get))(void *c, void **state) {
    Instance *instance = c;
    if (!*state) *state = malloc(sizeof(CoreState)); /* a state from an earlier call is overwritten */
    if (!*state) return report(instance, core_fail(instance->core, "there is not enough memory to save the state"));
    memcpy(*state, &instance->core->state, sizeof(CoreState));
    return FMI(OK);
}

FUNCTION(FMI(Status), STATE(Set))(void *c, void *state) {
    Instance *instance = c;
    if (!state) return report(instance, core_fail(instance->core, "the state to restore is NULL"));
    memcpy(&instance->core->state, state, sizeof(CoreState));
    return FMI(OK);
}

FUNCTION(FMI(Status), STATE(Free))(void *c, void **state) {
    (void)c;
    if (state) {
        free(*state);
        *state = NULL;
    }
    return FMI(OK);
}

FUNCTION(FMI(Status), PASTE(STATE(Serialized), Size))(void *c, void *state, size_t *size) {
    (void)c, (void)state;
    *size = CORE_SERIALIZED_SIZE;
    return FMI(OK);
}

FUNCTION(FMI(Status), STATE(Serialize))(void *c, void *state, FMI(Byte) bytes[], size_t size) {
    Instance *instance = c;
    if (!state || size < CORE_SERIALIZED_SIZE)
        return report(instance, core_fail(instance->core, "a state is %zu bytes long, the memory given for it %zu",
                                          CORE_SERIALIZED_SIZE, size));
    core_serialize(state, (char *)bytes);
    return FMI(OK);
}

FUNCTION(FMI(Status), DESERIALIZE_STATE)(void *c, const FMI(Byte) bytes[], size_t size, void **state) {
    Instance *instance = c;
    CoreState read;
    if (core_deserialize(instance->core, (const char *)bytes, size, &read)) return report(instance, CORE_ERROR);
    if (!*state) *state = malloc(sizeof(CoreState));
    if (!*state) return report(instance, core_fail(instance->core, "there is not enough memory to read the state"));
    memcpy(*state, &read, sizeof(read));
    return FMI(OK);
}

/* ---- model exchange -------------------------------------------------------------------------- */

FUNCTION(FMI(Status), FMI(EnterEventMode))(void *c) {
    Instance *instance = c;
    if (!in_mode(instance, MODE_BIT(MODE_CONTINUOUS) | MODE_BIT(MODE_EVENT), QUOTED(FMI(EnterEventMode))))
        return FMI(Error);
    core_set_mode(instance->core, MODE_EVENT);
    return FMI(OK);
}

FUNCTION(FMI(Status), FMI(EnterContinuousTimeMode))(void *c) {
    Instance *instance = c;
    if (!in_mode(instance, MODE_BIT(MODE_EVENT), QUOTED(FMI(EnterContinuousTimeMode)))) return FMI(Error);
    core_set_mode(instance->core, MODE_CONTINUOUS);
    return FMI(OK);
}

FUNCTION(FMI(Status), FMI(CompletedIntegratorStep))(void *c, FMI(Boolean) noSetFMUStatePriorToCurrentPoint,
                                                    FMI(Boolean) *enterEventMode, FMI(Boolean) *terminateSimulation) {
    (void)c, (void)noSetFMUStatePriorToCurrentPoint;
    *enterEventMode = *terminateSimulation = 0;
    return FMI(OK);
}

FUNCTION(FMI(Status), FMI(SetTime))(void *c, double time) {
    Instance *instance = c;
    if (!in_mode(instance, MODE_BIT(MODE_EVENT) | MODE_BIT(MODE_CONTINUOUS), QUOTED(FMI(SetTime)))) return FMI(Error);
    return report(instance, core_set_time(instance->core, time));
}

static int has_states(Instance *instance, size_t nx) {
    if (nx == CONTINUOUS_STATE_COUNT) return 1;
    report(instance, core_fail(instance->core, "this FMU has %d continuous states, not %zu",
                               CONTINUOUS_STATE_COUNT, nx));
    return 0;
}

FUNCTION(FMI(Status), FMI(SetContinuousStates))(void *c, const double x[], size_t nx) {
    Instance *instance = c;
    if (!has_states(instance, nx)) return FMI(Error);
    if (!in_mode(instance, MODE_BIT(MODE_CONTINUOUS) | MODE_BIT(MODE_EVENT), QUOTED(FMI(SetContinuousStates))))
        return FMI(Error);
    return nx ? report(instance, core_set_states(instance->core, x)) : FMI(OK);
}

FUNCTION(FMI(Status), STATE_DERIVATIVES)(void *c, double derivatives[], size_t nx) {
    Instance *instance = c;
    const double *values;
    if (!has_states(instance, nx)) return FMI(Error);
    if (nx == 0) return FMI(OK);
    if (core_derivatives(instance->core, &values)) return report(instance, CORE_ERROR);
    memcpy(derivatives, values, nx * sizeof(double));
    return FMI(OK);
}

FUNCTION(FMI(Status), FMI(GetEventIndicators))(void *c, double indicators[], size_t ni) {
    (void)indicators;
    return ni ? not_provided(c, "event indicators") : FMI(OK);
}

FUNCTION(FMI(Status), FMI(GetContinuousStates))(void *c, double x[], size_t nx) {
    Instance *instance = c;
    if (!has_states(instance, nx)) return FMI(Error);
    for (size_t i = 0; i < nx; ++i) {
        const unsigned int reference = STATE_FIRST + (unsigned int)i;
        if (core_get(instance->core, &reference, 1, &x[i])) return report(instance, CORE_ERROR);
    }
    return FMI(OK);
}

FUNCTION(FMI(Status), FMI(GetNominalsOfContinuousStates))(void *c, double nominals[], size_t nx) {
    if (!has_states(c, nx)) return FMI(Error);
    for (size_t i = 0; i < nx; ++i) nominals[i] = 1.0;
    return FMI(OK);
}
