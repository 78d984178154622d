/* FMI 3.0 co-simulation with arrays of one, two and three dimensions as inputs, parameters and outputs.
 *   x[i](k+1) = x[i](k) + h (u[i] - a[i] x[i]),   y[i] = x[i]
 *   Y[i,j] = B[i,j] V[i,j] + x[i],   Z[i,j,k] = T[i,j,k] S[i,j,k] + (j + 2 k) x[i] (j, k from 0)
 * with u, a, x, y [2], V, B, Y [2,3], S, T, Z [2,2,3], each stored row by row. Value references in this order:
 * u 0, V 1, S 2, a 3, B 4, T 5, y 6, Y 7, Z 8, time 9. Values must be as many as the arrays that are named have elements.
 */
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

typedef void *Instance;
typedef uint32_t Reference;
typedef enum { OK, WARNING, DISCARD, ERROR } Status;
enum { U, V, S, A, B, T, Y1, Y2, Y3, TIME };
typedef struct { double own[6][12], x[2], time; } Tensors;
static const size_t SIZES[] = {2, 6, 12, 2, 6, 12, 2, 6, 12, 1};

EXPORT const char *fmi3GetVersion(void) { return "3.0"; }
EXPORT Instance fmi3InstantiateCoSimulation(const char *name, const char *token, const char *resources, bool visible,
                                            bool logging, bool events, bool early, const Reference needed[], size_t n,
                                            void *environment, void *log, void *update) {
    Tensors *t = calloc(1, sizeof(Tensors));
    for (int r = A; r <= T; r++)
        for (size_t i = 0; i < SIZES[r]; i++) t->own[r][i] = 1 + i;
    return t;
}
EXPORT void fmi3FreeInstance(Instance c) { free(c); }
EXPORT Status fmi3EnterInitializationMode(Instance c, bool td, double tol, double t0, bool sd, double t1) { return OK; }
EXPORT Status fmi3ExitInitializationMode(Instance c) { return OK; }

EXPORT Status fmi3SetFloat64(Instance c, const Reference r[], size_t n, const double v[], size_t count) {
    Tensors *t = c;
    for (size_t i = 0; i < n; i++) {
        if (r[i] > T || count < SIZES[r[i]]) return ERROR;
        for (size_t k = 0; k < SIZES[r[i]]; k++) t->own[r[i]][k] = *v++;
        count -= SIZES[r[i]];
    }
    return count ? ERROR : OK;
}

static double output(const Tensors *t, Reference r, size_t k) {
    if (r == TIME) return t->time;
    const double x = t->x[k / (SIZES[r] / 2)];
    if (r == Y1) return x;
    const int in = r == Y2 ? V : S, by = r == Y2 ? B : T;
    return t->own[by][k] * t->own[in][k] + (r == Y2 ? 1 : k / 3 % 2 + 2 * (k % 3)) * x;
}

EXPORT Status fmi3GetFloat64(Instance c, const Reference r[], size_t n, double v[], size_t count) {
    const Tensors *t = c;
    for (size_t i = 0; i < n; i++) {
        if (r[i] > TIME || count < SIZES[r[i]]) return ERROR;
        for (size_t k = 0; k < SIZES[r[i]]; k++) *v++ = r[i] <= T ? t->own[r[i]][k] : output(t, r[i], k);
        count -= SIZES[r[i]];
    }
    return count ? ERROR : OK;
}
EXPORT Status fmi3DoStep(Instance c, double at, double h, bool keep, bool *event, bool *end, bool *early, double *last) {
    Tensors *t = c;
    for (int i = 0; i < 2; i++) t->x[i] += h * (t->own[U][i] - t->own[A][i] * t->x[i]);
    *last = t->time = at + h;
    *event = *end = *early = false;
    return OK;
}

/* The rest of the standard, which FMPy wants to find. */
#define NOT(name) EXPORT Status fmi3##name(void) { return ERROR; }
NOT(ActivateModelPartition) NOT(CompletedIntegratorStep) NOT(DeserializeFMUState) NOT(EnterConfigurationMode)
NOT(EnterContinuousTimeMode) NOT(EnterEventMode) NOT(EnterStepMode) NOT(EvaluateDiscreteStates)
NOT(ExitConfigurationMode) NOT(FreeFMUState) NOT(GetAdjointDerivative) NOT(GetBinary) NOT(GetBoolean) NOT(GetClock)
NOT(GetContinuousStateDerivatives) NOT(GetContinuousStates) NOT(GetDirectionalDerivative) NOT(GetEventIndicators)
NOT(GetFMUState) NOT(GetFloat32) NOT(GetInt16) NOT(GetInt32) NOT(GetInt64) NOT(GetInt8) NOT(GetIntervalDecimal)
NOT(GetIntervalFraction) NOT(GetNominalsOfContinuousStates) NOT(GetNumberOfContinuousStates)
NOT(GetNumberOfEventIndicators) NOT(GetNumberOfVariableDependencies) NOT(GetOutputDerivatives) NOT(GetShiftDecimal)
NOT(GetShiftFraction) NOT(GetString) NOT(GetUInt16) NOT(GetUInt32) NOT(GetUInt64) NOT(GetUInt8)
NOT(GetVariableDependencies) NOT(InstantiateModelExchange) NOT(InstantiateScheduledExecution) NOT(Reset)
NOT(SerializeFMUState) NOT(SerializedFMUStateSize) NOT(SetBinary) NOT(SetBoolean) NOT(SetClock)
NOT(SetContinuousStates) NOT(SetDebugLogging) NOT(SetFMUState) NOT(SetFloat32) NOT(SetInt16) NOT(SetInt32)
NOT(SetInt64) NOT(SetInt8) NOT(SetIntervalDecimal) NOT(SetIntervalFraction) NOT(SetShiftDecimal) NOT(SetShiftFraction)
NOT(SetString) NOT(SetTime) NOT(SetUInt16) NOT(SetUInt32) NOT(SetUInt64) NOT(SetUInt8) NOT(Terminate)
NOT(UpdateDiscreteStates)
