/* FMI 2.0 for co-simulation and model exchange: a thin translation to the core in block.c.
 *
 * Types and functions follow "Functional Mock-up Interface for Model Exchange and Co-Simulation",
 * version 2.0 (modelica.org/fmi), declared here so that the FMU builds from its own sources alone.
 * This is the one file to compile; it includes the others.
 */
#include "block.c"

/* ---- types of the standard (section 2.1.2, 2.1.3, 2.1.5) ------------------------------------ */

typedef void *fmi2Component;
typedef void *fmi2ComponentEnvironment;
typedef void *fmi2FMUstate;
typedef unsigned int fmi2ValueReference;
typedef double fmi2Real;
typedef int fmi2Integer;
typedef int fmi2Boolean;
typedef const char *fmi2String;
typedef char fmi2Byte;

enum { fmi2False = 0, fmi2True = 1 };

typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending } fmi2Status;
typedef enum { fmi2ModelExchange, fmi2CoSimulation } fmi2Type;
typedef enum { fmi2DoStepStatus, fmi2PendingStatus, fmi2LastSuccessfulTime, fmi2Terminated } fmi2StatusKind;

typedef struct {
    void (*logger)(fmi2ComponentEnvironment, fmi2String, fmi2Status, fmi2String, fmi2String, ...);
    void *(*allocateMemory)(size_t, size_t);
    void (*freeMemory)(void *);
    void (*stepFinished)(fmi2ComponentEnvironment, fmi2Status);
    fmi2ComponentEnvironment componentEnvironment;
} fmi2CallbackFunctions;

typedef struct {
    fmi2Boolean newDiscreteStatesNeeded;
    fmi2Boolean terminateSimulation;
    fmi2Boolean nominalsOfContinuousStatesChanged;
    fmi2Boolean valuesOfContinuousStatesChanged;
    fmi2Boolean nextEventTimeDefined;
    fmi2Real nextEventTime;
} fmi2EventInfo;

/* A prefix is asked for where FMUs are linked statically (section 2.1.1). */
#ifdef FMI2_FUNCTION_PREFIX
#define NAME(name) PASTE(FMI2_FUNCTION_PREFIX, name)
#else
#define NAME(name) name
#endif
#define FMI2(type, name) EXPORT type NAME(name)

/* ---- instance and messages ----------------------------------------------------------------- */

typedef struct {
    Core *core;
    char *name;
    fmi2CallbackFunctions callbacks;
    int co_simulation;
} Instance;

static void log_error(const fmi2CallbackFunctions *callbacks, fmi2String name, const char *text) {
    char message[sizeof(((Core *)0)->message)];
    if (!callbacks || !callbacks->logger) return;
    /* The logger reads its message as a printf format, and a variable may have a % in its name. */
    snprintf(message, sizeof(message), "%s", text);
    for (char *c = message; *c; ++c)
        if (*c == '%') *c = '#';
    callbacks->logger(callbacks->componentEnvironment, name, fmi2Error, "logStatusError", message);
}

APART static fmi2Status report(Instance *instance, int core_status) {
    if (core_status == CORE_OK) return fmi2OK;
    log_error(&instance->callbacks, instance->name, instance->core->message);
    return fmi2Error;
}

#define FMI(name) fmi2##name
#define STATE(verb) fmi2##verb##FMUstate
#define DESERIALIZE_STATE fmi2DeSerializeFMUstate
#define STATE_DERIVATIVES fmi2GetDerivatives
#include "common.c"

/* ---- life cycle (section 2.1) --------------------------------------------------------------- */

FMI2(const char *, fmi2GetTypesPlatform)(void) { return "default"; }

FMI2(const char *, fmi2GetVersion)(void) { return "2.0"; }

FMI2(fmi2Component, fmi2Instantiate)(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                                     const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging) {
    (void)resources, (void)visible, (void)logging;
    if (!name) name = BLOCK_NAME;
    if (!guid || strcmp(guid, BLOCK_GUID)) {
        log_error(callbacks, name, "the GUID is not " BLOCK_GUID ": modelDescription.xml and the binary of the FMU '"
                  BLOCK_NAME "' do not belong together");
        return NULL;
    }
    Instance *instance = calloc(1, sizeof(Instance));
    if (instance) {
        instance->core = core_create();
        instance->name = malloc(strlen(name) + 1);
    }
    if (!instance || !instance->core || !instance->name) {
        log_error(callbacks, name, "there is not enough memory for an instance");
        if (instance) {
            core_free(instance->core);
            free(instance->name);
            free(instance);
        }
        return NULL;
    }
    strcpy(instance->name, name);
    if (callbacks) instance->callbacks = *callbacks;
    instance->co_simulation = type == fmi2CoSimulation;
    return instance;
}

FMI2(void, fmi2FreeInstance)(fmi2Component c) {
    Instance *instance = c;
    if (!instance) return;
    core_free(instance->core);
    free(instance->name);
    free(instance);
}

FMI2(fmi2Status, fmi2SetupExperiment)(fmi2Component c, fmi2Boolean toleranceDefined, fmi2Real tolerance,
                                      fmi2Real startTime, fmi2Boolean stopTimeDefined, fmi2Real stopTime) {
    Instance *instance = c;
    (void)stopTimeDefined, (void)stopTime;
    if (!in_mode(instance, MODE_BIT(MODE_INSTANTIATED), "fmi2SetupExperiment")) return fmi2Error;
    if (core_set_tolerance(instance->core, 1, toleranceDefined ? tolerance : 0.0)) return report(instance, CORE_ERROR);
    return report(instance, core_set_time(instance->core, startTime));
}

FMI2(fmi2Status, fmi2EnterInitializationMode)(fmi2Component c) {
    Instance *instance = c;
    if (!in_mode(instance, MODE_BIT(MODE_INSTANTIATED), "fmi2EnterInitializationMode")) return fmi2Error;
    core_set_mode(instance->core, MODE_INITIALIZATION);
    return fmi2OK;
}

/* ---- variables (section 2.1.7) --------------------------------------------------------------- */

FMI2(fmi2Status, fmi2GetReal)(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Real value[]) {
    Instance *instance = c;
    return report(instance, core_get(instance->core, vr, nvr, value));
}

FMI2(fmi2Status, fmi2SetReal)(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Real value[]) {
    Instance *instance = c;
    return report(instance, core_set(instance->core, vr, nvr, value));
}

static int is_substeps(Instance *instance, fmi2ValueReference vr) {
    if (!BLOCK_SAMPLED && vr == SUBSTEPS_REFERENCE) return 1;
    report(instance, core_fail(instance->core, "there is no Integer variable with value reference %u", vr));
    return 0;
}

FMI2(fmi2Status, fmi2GetInteger)(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Integer value[]) {
    Instance *instance = c;
    for (size_t i = 0; i < nvr; ++i) {
        if (!is_substeps(instance, vr[i])) return fmi2Error;
        value[i] = instance->core->state.substeps;
    }
    return fmi2OK;
}

FMI2(fmi2Status, fmi2SetInteger)(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                                 const fmi2Integer value[]) {
    Instance *instance = c;
    for (size_t i = 0; i < nvr; ++i) {
        if (!is_substeps(instance, vr[i])) return fmi2Error;
        if (core_set_substeps(instance->core, value[i])) return report(instance, CORE_ERROR);
    }
    return fmi2OK;
}

/* There are no variables of the other types, so only empty lists are in order. */
#define NO_VARIABLES(name, type, kind)                                                            \
    FMI2(fmi2Status, name)(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, type value[]) { \
        (void)vr, (void)value;                                                                     \
        return nvr ? not_provided(c, kind " variables") : fmi2OK;                                  \
    }
NO_VARIABLES(fmi2GetBoolean, fmi2Boolean, "Boolean")
NO_VARIABLES(fmi2SetBoolean, const fmi2Boolean, "Boolean")
NO_VARIABLES(fmi2GetString, fmi2String, "String")
NO_VARIABLES(fmi2SetString, const fmi2String, "String")

/* ---- saved states and derivatives (sections 2.1.8 and 2.1.9) ---------------------------------- */

FMI2(fmi2Status, fmi2GetDirectionalDerivative)(fmi2Component c, const fmi2ValueReference unknowns[], size_t nUnknown,
                                               const fmi2ValueReference knowns[], size_t nKnown,
                                               const fmi2Real dvKnown[], fmi2Real dvUnknown[]) {
    Instance *instance = c;
    return report(instance,
                  core_directional(instance->core, unknowns, nUnknown, knowns, nKnown, dvKnown, dvUnknown));
}

/* ---- model exchange (section 3.2) -------------------------------------------------------------- */

FMI2(fmi2Status, fmi2NewDiscreteStates)(fmi2Component c, fmi2EventInfo *info) {
    Instance *instance = c;
    memset(info, 0, sizeof(*info));
    if (!in_mode(instance, MODE_BIT(MODE_EVENT), "fmi2NewDiscreteStates")) return fmi2Error;
    info->nextEventTimeDefined = BLOCK_SAMPLED ? fmi2True : fmi2False;
    return report(instance, core_event(instance->core, &info->nextEventTime));
}

/* ---- co-simulation (section 4.2) ---------------------------------------------------------------- */

FMI2(fmi2Status, fmi2SetRealInputDerivatives)(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                                              const fmi2Integer order[], const fmi2Real value[]) {
    (void)vr, (void)order, (void)value;
    return nvr ? not_provided(c, "input derivatives") : fmi2OK;
}

FMI2(fmi2Status, fmi2GetRealOutputDerivatives)(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                                               const fmi2Integer order[], fmi2Real value[]) {
    (void)vr, (void)order, (void)value;
    return nvr ? not_provided(c, "output derivatives") : fmi2OK;
}

FMI2(fmi2Status, fmi2DoStep)(fmi2Component c, fmi2Real currentCommunicationPoint, fmi2Real communicationStepSize,
                             fmi2Boolean noSetFMUStatePriorToCurrentPoint) {
    Instance *instance = c;
    (void)noSetFMUStatePriorToCurrentPoint;
    if (!in_mode(instance, MODE_BIT(MODE_STEP), "fmi2DoStep")) return fmi2Error;
    return report(instance, core_step(instance->core, currentCommunicationPoint, communicationStepSize));
}

FMI2(fmi2Status, fmi2CancelStep)(fmi2Component c) { return not_provided(c, "asynchronous steps"); }

/* fmi2DoStep always ends before it returns, so there is never a pending step to ask about. */
FMI2(fmi2Status, fmi2GetStatus)(fmi2Component c, const fmi2StatusKind kind, fmi2Status *value) {
    (void)c, (void)kind, (void)value;
    return fmi2Discard;
}

FMI2(fmi2Status, fmi2GetRealStatus)(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value) {
    Instance *instance = c;
    if (kind != fmi2LastSuccessfulTime) return fmi2Discard;
    *value = instance->core->state.time;
    return fmi2OK;
}

FMI2(fmi2Status, fmi2GetIntegerStatus)(fmi2Component c, const fmi2StatusKind kind, fmi2Integer *value) {
    (void)c, (void)kind, (void)value;
    return fmi2Discard;
}

FMI2(fmi2Status, fmi2GetBooleanStatus)(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value) {
    (void)c;
    if (kind != fmi2Terminated) return fmi2Discard;
    *value = fmi2False;
    return fmi2OK;
}

FMI2(fmi2Status, fmi2GetStringStatus)(fmi2Component c, const fmi2StatusKind kind, fmi2String *value) {
    (void)c, (void)kind, (void)value;
    return fmi2Discard;
}
