/* FMI 3.0 for co-simulation and model exchange: a thin translation to the core in block.c.
 *
 * Types and functions follow "Functional Mock-up Interface Specification", version 3.0
 * (fmi-standard.org), declared here so that the FMU builds from its own sources alone. This is the
 * one file to compile; it includes the others. It behaves as fmi2.c: outputs follow inputs and
 * tunable parameters at once, those of a sampled block at its sample instants only.
 *
 * Float64 variables have the value references of the core; then come the Int32 `substeps`
 * (continuous blocks), the Float64 `time` and `relative_tolerance` (continuous blocks).
 */
#include "block.c"

#include <stdbool.h>
#include <stdint.h>

/* ---- types of the standard (section 2.2) ----------------------------------------------------- */

typedef void *fmi3Instance;
typedef void *fmi3InstanceEnvironment;
typedef void *fmi3FMUState;
typedef uint32_t fmi3ValueReference;
typedef float fmi3Float32;
typedef double fmi3Float64;
typedef int8_t fmi3Int8;
typedef uint8_t fmi3UInt8;
typedef int16_t fmi3Int16;
typedef uint16_t fmi3UInt16;
typedef int32_t fmi3Int32;
typedef uint32_t fmi3UInt32;
typedef int64_t fmi3Int64;
typedef uint64_t fmi3UInt64;
typedef bool fmi3Boolean;
typedef const char *fmi3String;
typedef uint8_t fmi3Byte;
typedef const fmi3Byte *fmi3Binary;
typedef bool fmi3Clock;

typedef enum { fmi3OK, fmi3Warning, fmi3Discard, fmi3Error, fmi3Fatal } fmi3Status;
typedef enum { fmi3Independent, fmi3Constant, fmi3Fixed, fmi3Tunable, fmi3Discrete, fmi3Dependent } fmi3DependencyKind;
typedef enum { fmi3IntervalNotYetKnown, fmi3IntervalUnchanged, fmi3IntervalChanged } fmi3IntervalQualifier;

typedef void (*fmi3LogMessageCallback)(fmi3InstanceEnvironment, fmi3Status, fmi3String, fmi3String);
typedef void (*fmi3ClockUpdateCallback)(fmi3InstanceEnvironment);
typedef void (*fmi3IntermediateUpdateCallback)(fmi3InstanceEnvironment, fmi3Float64, fmi3Boolean, fmi3Boolean,
                                               fmi3Boolean, fmi3Boolean, fmi3Boolean *, fmi3Float64 *);
typedef void (*fmi3LockPreemptionCallback)(void);
typedef void (*fmi3UnlockPreemptionCallback)(void);

/* A prefix is asked for where FMUs are linked statically (section 2.2.1). */
#if defined(FMI3_OVERRIDE_FUNCTION_PREFIX)
#define NAME(name) PASTE(FMI3_OVERRIDE_FUNCTION_PREFIX, name)
#elif defined(FMI3_FUNCTION_PREFIX)
#define NAME(name) PASTE(FMI3_FUNCTION_PREFIX, name)
#else
#define NAME(name) name
#endif
#define FMI3(type, name) EXPORT type NAME(name)

/* ---- instance and messages ------------------------------------------------------------------- */

typedef struct {
    Core *core;
    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback log_message;
    int co_simulation;
} Instance;

static void log_error(fmi3LogMessageCallback log_message, fmi3InstanceEnvironment environment, fmi3String text) {
    if (log_message) log_message(environment, fmi3Error, "logStatusError", text);
}

APART static fmi3Status report(Instance *instance, int core_status) {
    if (core_status == CORE_OK) return fmi3OK;
    log_error(instance->log_message, instance->environment, instance->core->message);
    return fmi3Error;
}

#define FMI(name) fmi3##name
#define STATE(verb) fmi3##verb##FMUState
#define DESERIALIZE_STATE fmi3DeserializeFMUState
#define STATE_DERIVATIVES fmi3GetContinuousStateDerivatives
#include "common.c"

/* All variables are scalars: as many values as value references. */
APART static int same_count(Instance *instance, size_t references, size_t values, const char *function) {
    if (references == values) return 1;
    report(instance, core_fail(instance->core, "%s needs one value for each value reference: %zu references, "
                               "%zu values", function, references, values));
    return 0;
}

/* ---- life cycle (section 2.3) ---------------------------------------------------------------- */

FMI3(const char *, fmi3GetVersion)(void) { return "3.0"; }

static Instance *instantiate(fmi3String token, int co_simulation, fmi3InstanceEnvironment environment,
                             fmi3LogMessageCallback log_message) {
    if (!token || strcmp(token, BLOCK_GUID)) {
        log_error(log_message, environment, "the instantiation token is not " BLOCK_GUID ": modelDescription.xml and "
                  "the binary of the FMU '" BLOCK_NAME "' do not belong together");
        return NULL;
    }
    Instance *instance = calloc(1, sizeof(Instance));
    if (instance) instance->core = core_create();
    if (!instance || !instance->core) {
        log_error(log_message, environment, "there is not enough memory for an instance");
        free(instance);
        return NULL;
    }
    instance->environment = environment;
    instance->log_message = log_message;
    instance->co_simulation = co_simulation;
    return instance;
}

FMI3(fmi3Instance, fmi3InstantiateModelExchange)(fmi3String name, fmi3String token, fmi3String resources,
                                                 fmi3Boolean visible, fmi3Boolean logging,
                                                 fmi3InstanceEnvironment environment,
                                                 fmi3LogMessageCallback log_message) {
    (void)name, (void)resources, (void)visible, (void)logging;
    return instantiate(token, 0, environment, log_message);
}

FMI3(fmi3Instance, fmi3InstantiateCoSimulation)(fmi3String name, fmi3String token, fmi3String resources,
                                                fmi3Boolean visible, fmi3Boolean logging, fmi3Boolean event_mode_used,
                                                fmi3Boolean early_return_allowed,
                                                const fmi3ValueReference intermediate[], size_t intermediate_count,
                                                fmi3InstanceEnvironment environment,
                                                fmi3LogMessageCallback log_message,
                                                fmi3IntermediateUpdateCallback intermediate_update) {
    (void)name, (void)resources, (void)visible, (void)logging, (void)early_return_allowed;
    (void)intermediate, (void)intermediate_count, (void)intermediate_update;
    if (event_mode_used) { /* a master that waits for events would never see one */
        log_error(log_message, environment, "the FMU '" BLOCK_NAME "' has no event mode in co-simulation "
                  "(hasEventMode=\"false\"): instantiate it with eventModeUsed=fmi3False");
        return NULL;
    }
    return instantiate(token, 1, environment, log_message);
}

FMI3(fmi3Instance, fmi3InstantiateScheduledExecution)(fmi3String name, fmi3String token, fmi3String resources,
                                                      fmi3Boolean visible, fmi3Boolean logging,
                                                      fmi3InstanceEnvironment environment,
                                                      fmi3LogMessageCallback log_message,
                                                      fmi3ClockUpdateCallback clock_update,
                                                      fmi3LockPreemptionCallback lock_preemption,
                                                      fmi3UnlockPreemptionCallback unlock_preemption) {
    (void)name, (void)token, (void)resources, (void)visible, (void)logging;
    (void)clock_update, (void)lock_preemption, (void)unlock_preemption;
    log_error(log_message, environment, "the FMU '" BLOCK_NAME "' has no scheduled execution");
    return NULL;
}

FMI3(void, fmi3FreeInstance)(fmi3Instance c) {
    Instance *instance = c;
    if (!instance) return;
    core_free(instance->core);
    free(instance);
}

FMI3(fmi3Status, fmi3EnterInitializationMode)(fmi3Instance c, fmi3Boolean toleranceDefined, fmi3Float64 tolerance,
                                              fmi3Float64 startTime, fmi3Boolean stopTimeDefined,
                                              fmi3Float64 stopTime) {
    Instance *instance = c;
    (void)stopTimeDefined, (void)stopTime;
    if (!in_mode(instance, MODE_BIT(MODE_INSTANTIATED), "fmi3EnterInitializationMode")) return fmi3Error;
    if (core_set_tolerance(instance->core, 1, toleranceDefined ? tolerance : 0.0)) return report(instance, CORE_ERROR);
    if (core_set_time(instance->core, startTime)) return report(instance, CORE_ERROR);
    core_set_mode(instance->core, MODE_INITIALIZATION);
    return fmi3OK;
}

/* There are no structural parameters. */
FMI3(fmi3Status, fmi3EnterConfigurationMode)(fmi3Instance c) { return not_provided(c, "configuration mode"); }

FMI3(fmi3Status, fmi3ExitConfigurationMode)(fmi3Instance c) { return not_provided(c, "configuration mode"); }

/* ---- variables (section 2.2.6) ---------------------------------------------------------------- */

FMI3(fmi3Status, fmi3GetFloat64)(fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, fmi3Float64 values[],
                                 size_t nValues) {
    Instance *instance = c;
    if (!same_count(instance, nvr, nValues, "fmi3GetFloat64")) return fmi3Error;
    for (size_t i = 0; i < nvr; ++i) {
        if (vr[i] == TIME_REFERENCE)
            values[i] = instance->core->state.time;
        else if (core_get(instance->core, &vr[i], 1, &values[i]))
            return report(instance, CORE_ERROR);
    }
    return fmi3OK;
}

FMI3(fmi3Status, fmi3SetFloat64)(fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, const fmi3Float64 values[],
                                 size_t nValues) {
    Instance *instance = c;
    if (!same_count(instance, nvr, nValues, "fmi3SetFloat64")) return fmi3Error;
    for (size_t i = 0; i < nvr; ++i)
        if (vr[i] == TIME_REFERENCE)
            return report(instance, core_fail(instance->core, "variable 'time' (value reference %u) is the independent "
                                              "variable and cannot be set", (unsigned int)vr[i]));
    return report(instance, core_set(instance->core, vr, nvr, values));
}

static int is_substeps(Instance *instance, fmi3ValueReference vr) {
    if (!BLOCK_SAMPLED && vr == SUBSTEPS_REFERENCE) return 1;
    report(instance, core_fail(instance->core, "there is no Int32 variable with value reference %u", (unsigned int)vr));
    return 0;
}

FMI3(fmi3Status, fmi3GetInt32)(fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, fmi3Int32 values[],
                               size_t nValues) {
    Instance *instance = c;
    if (!same_count(instance, nvr, nValues, "fmi3GetInt32")) return fmi3Error;
    for (size_t i = 0; i < nvr; ++i) {
        if (!is_substeps(instance, vr[i])) return fmi3Error;
        values[i] = instance->core->state.substeps;
    }
    return fmi3OK;
}

FMI3(fmi3Status, fmi3SetInt32)(fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, const fmi3Int32 values[],
                               size_t nValues) {
    Instance *instance = c;
    if (!same_count(instance, nvr, nValues, "fmi3SetInt32")) return fmi3Error;
    for (size_t i = 0; i < nvr; ++i) {
        if (!is_substeps(instance, vr[i])) return fmi3Error;
        if (core_set_substeps(instance->core, values[i])) return report(instance, CORE_ERROR);
    }
    return fmi3OK;
}

/* There are no variables of the other types, so only empty lists are in order. */
#define NONE(name, kind, ...)                                                                            \
    FMI3(fmi3Status, name)(fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, __VA_ARGS__) {     \
        (void)vr;                                                                                        \
        return nvr ? not_provided(c, kind) : fmi3OK;                                                     \
    }
#define NO_VARIABLES(type)                                                                               \
    NONE(fmi3Get##type, #type " variables", fmi3##type values[], size_t nValues)                         \
    NONE(fmi3Set##type, #type " variables", const fmi3##type values[], size_t nValues)
#if defined(__GNUC__)
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif
NO_VARIABLES(Float32)
NO_VARIABLES(Int8)
NO_VARIABLES(UInt8)
NO_VARIABLES(Int16)
NO_VARIABLES(UInt16)
NO_VARIABLES(UInt32)
NO_VARIABLES(Int64)
NO_VARIABLES(UInt64)
NO_VARIABLES(Boolean)
NO_VARIABLES(String)
NONE(fmi3GetBinary, "Binary variables", size_t valueSizes[], fmi3Binary values[], size_t nValues)
NONE(fmi3SetBinary, "Binary variables", const size_t valueSizes[], const fmi3Binary values[], size_t nValues)
NONE(fmi3GetClock, "Clock variables", fmi3Clock values[])
NONE(fmi3SetClock, "Clock variables", const fmi3Clock values[])
NONE(fmi3GetIntervalDecimal, "clocks", fmi3Float64 intervals[], fmi3IntervalQualifier qualifiers[])
NONE(fmi3GetIntervalFraction, "clocks", fmi3UInt64 counters[], fmi3UInt64 resolutions[],
     fmi3IntervalQualifier qualifiers[])
NONE(fmi3GetShiftDecimal, "clocks", fmi3Float64 shifts[])
NONE(fmi3GetShiftFraction, "clocks", fmi3UInt64 counters[], fmi3UInt64 resolutions[])
NONE(fmi3SetIntervalDecimal, "clocks", const fmi3Float64 intervals[])
NONE(fmi3SetIntervalFraction, "clocks", const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])
NONE(fmi3SetShiftDecimal, "clocks", const fmi3Float64 shifts[])
NONE(fmi3SetShiftFraction, "clocks", const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])
NONE(fmi3GetOutputDerivatives, "output derivatives", const fmi3Int32 orders[], fmi3Float64 values[], size_t nValues)
#if defined(__GNUC__)
#pragma GCC diagnostic pop
#endif

/* Dependencies stand in modelDescription.xml; these functions are for variables that are arrays. */
FMI3(fmi3Status, fmi3GetNumberOfVariableDependencies)(fmi3Instance c, fmi3ValueReference vr, size_t *nDependencies) {
    (void)vr, (void)nDependencies;
    return not_provided(c, "dependencies per element");
}

FMI3(fmi3Status, fmi3GetVariableDependencies)(fmi3Instance c, fmi3ValueReference dependent,
                                              size_t elementIndicesOfDependent[], fmi3ValueReference independents[],
                                              size_t elementIndicesOfIndependents[],
                                              fmi3DependencyKind dependencyKinds[], size_t nDependencies) {
    (void)dependent, (void)elementIndicesOfDependent, (void)independents, (void)elementIndicesOfIndependents;
    (void)dependencyKinds, (void)nDependencies;
    return not_provided(c, "dependencies per element");
}

/* ---- saved states and derivatives (sections 2.2.10 and 2.2.11) --------------------------------- */

FMI3(fmi3Status, fmi3GetDirectionalDerivative)(fmi3Instance c, const fmi3ValueReference unknowns[], size_t nUnknowns,
                                               const fmi3ValueReference knowns[], size_t nKnowns,
                                               const fmi3Float64 seed[], size_t nSeed, fmi3Float64 sensitivity[],
                                               size_t nSensitivity) {
    Instance *instance = c;
    if (!same_count(instance, nKnowns, nSeed, "fmi3GetDirectionalDerivative")) return fmi3Error;
    if (!same_count(instance, nUnknowns, nSensitivity, "fmi3GetDirectionalDerivative")) return fmi3Error;
    return report(instance, core_directional(instance->core, unknowns, nUnknowns, knowns, nKnowns, seed, sensitivity));
}

FMI3(fmi3Status, fmi3GetAdjointDerivative)(fmi3Instance c, const fmi3ValueReference unknowns[], size_t nUnknowns,
                                           const fmi3ValueReference knowns[], size_t nKnowns, const fmi3Float64 seed[],
                                           size_t nSeed, fmi3Float64 sensitivity[], size_t nSensitivity) {
    (void)unknowns, (void)nUnknowns, (void)knowns, (void)nKnowns;
    (void)seed, (void)nSeed, (void)sensitivity, (void)nSensitivity;
    return not_provided(c, "adjoint derivatives");
}

/* ---- model exchange (section 3) ----------------------------------------------------------------- */

FMI3(fmi3Status, fmi3UpdateDiscreteStates)(fmi3Instance c, fmi3Boolean *discreteStatesNeedUpdate,
                                           fmi3Boolean *terminateSimulation,
                                           fmi3Boolean *nominalsOfContinuousStatesChanged,
                                           fmi3Boolean *valuesOfContinuousStatesChanged,
                                           fmi3Boolean *nextEventTimeDefined, fmi3Float64 *nextEventTime) {
    Instance *instance = c;
    *discreteStatesNeedUpdate = *terminateSimulation = false;
    *nominalsOfContinuousStatesChanged = *valuesOfContinuousStatesChanged = *nextEventTimeDefined = false;
    if (!in_mode(instance, MODE_BIT(MODE_EVENT), "fmi3UpdateDiscreteStates")) return fmi3Error;
    *nextEventTimeDefined = BLOCK_SAMPLED ? true : false;
    return report(instance, core_event(instance->core, nextEventTime));
}

FMI3(fmi3Status, fmi3EvaluateDiscreteStates)(fmi3Instance c) {
    return not_provided(c, "evaluation of discrete states before their update");
}

FMI3(fmi3Status, fmi3GetNumberOfEventIndicators)(fmi3Instance c, size_t *count) {
    (void)c;
    *count = 0;
    return fmi3OK;
}

FMI3(fmi3Status, fmi3GetNumberOfContinuousStates)(fmi3Instance c, size_t *count) {
    (void)c;
    *count = CONTINUOUS_STATE_COUNT;
    return fmi3OK;
}

/* ---- co-simulation (section 4) and scheduled execution (section 5) -------------------------------- */

/* Step mode follows initialization mode at once, because there is no event mode. */
FMI3(fmi3Status, fmi3EnterStepMode)(fmi3Instance c) { return not_provided(c, "event mode in co-simulation"); }

FMI3(fmi3Status, fmi3DoStep)(fmi3Instance c, fmi3Float64 currentCommunicationPoint, fmi3Float64 communicationStepSize,
                             fmi3Boolean noSetFMUStatePriorToCurrentPoint, fmi3Boolean *eventHandlingNeeded,
                             fmi3Boolean *terminateSimulation, fmi3Boolean *earlyReturn,
                             fmi3Float64 *lastSuccessfulTime) {
    Instance *instance = c;
    (void)noSetFMUStatePriorToCurrentPoint;
    *eventHandlingNeeded = *terminateSimulation = *earlyReturn = false;
    *lastSuccessfulTime = currentCommunicationPoint;
    if (!in_mode(instance, MODE_BIT(MODE_STEP), "fmi3DoStep")) return fmi3Error;
    if (core_step(instance->core, currentCommunicationPoint, communicationStepSize))
        return report(instance, CORE_ERROR);
    *lastSuccessfulTime = instance->core->state.time;
    return fmi3OK;
}

FMI3(fmi3Status, fmi3ActivateModelPartition)(fmi3Instance c, fmi3ValueReference clock, fmi3Float64 activationTime) {
    (void)clock, (void)activationTime;
    return not_provided(c, "model partitions");
}
