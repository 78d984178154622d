/* FMI 3.0 co-simulation: a discrete PI controller on a clock, strict about modes and clocks; and without a clock.
 *
 * At each tick e = r - y, u = kp e + ki x, then x := x + T e, with the interval T of the clock in s.
 * Value references: r 0, y 1, u 2, kp 3, ki 4, the clock 5, ticks 6 (not clocked, the number of ticks, Int32).
 * PLAIN: no clock, no event mode, one sample for each doStep.
 */
#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif
#ifndef INTERVAL
#define INTERVAL 0.01
#endif

typedef void *Instance;
typedef uint32_t Reference;
typedef enum { OK, WARNING, DISCARD, ERROR } Status;
enum { NEW, INITIALISATION, EVENT, STEP };
typedef struct { double r, y, kp, ki, x, time; int32_t ticks; int mode; bool active; } Pi;

static void defaults(Pi *s) {
    memset(s, 0, sizeof(*s));
    s->kp = 3;
    s->ki = 5;
}
static bool sampled(const Pi *s) {
#ifdef PLAIN
    return true;
#else
    return s->active && s->mode == EVENT;
#endif
}

EXPORT const char *fmi3GetVersion(void) { return "3.0"; }
EXPORT Instance fmi3InstantiateCoSimulation(const char *name, const char *token, const char *resources, bool visible,
                                            bool logging, bool events, bool early, const Reference needed[], size_t n,
                                            void *environment, void *log, void *update) {
#ifndef PLAIN
    if (!events) return NULL;
#endif
    Pi *s = calloc(1, sizeof(Pi));
    defaults(s);
    return s;
}
EXPORT void fmi3FreeInstance(Instance c) { free(c); }
EXPORT Status fmi3Reset(Instance c) { defaults(c); return OK; }
EXPORT Status fmi3EnterInitializationMode(Instance c, bool td, double tol, double t0, bool sd, double t1) {
    Pi *s = c;
    if (s->mode != NEW) return ERROR;
    s->mode = INITIALISATION;
    s->time = t0;
    return OK;
}
EXPORT Status fmi3ExitInitializationMode(Instance c) {
#ifdef PLAIN
    ((Pi *)c)->mode = STEP;
#else
    ((Pi *)c)->mode = EVENT;
#endif
    return OK;
}
EXPORT Status fmi3SetFloat64(Instance c, const Reference r[], size_t n, const double v[], size_t count) {
    Pi *s = c;
    double *places[] = {&s->r, &s->y, NULL, &s->kp, &s->ki};
    for (size_t i = 0; i < n; i++) {
        if (r[i] > 4 || r[i] == 2 || (r[i] < 2 && !sampled(s))) return ERROR;
        *places[r[i]] = v[i];
    }
    return OK;
}
EXPORT Status fmi3GetFloat64(Instance c, const Reference r[], size_t n, double v[], size_t count) {
    Pi *s = c;
    for (size_t i = 0; i < n; i++) {
        if (r[i] != 2 || !sampled(s)) return ERROR;
        v[i] = s->kp * (s->r - s->y) + s->ki * s->x;
    }
    return OK;
}
EXPORT Status fmi3GetInt32(Instance c, const Reference r[], size_t n, int32_t v[], size_t count) {
    for (size_t i = 0; i < n; i++) v[i] = ((Pi *)c)->ticks;
    return OK;
}
EXPORT Status fmi3SetClock(Instance c, const Reference r[], size_t n, const bool v[]) {
    Pi *s = c;
    if (s->mode != EVENT || n != 1 || r[0] != 5) return ERROR;
    s->active = v[0];
    return OK;
}
static void tick(Pi *s) {
    s->x += INTERVAL * (s->r - s->y);
    s->ticks++;
    s->active = false;
}
EXPORT Status fmi3UpdateDiscreteStates(Instance c, bool *need, bool *end, bool *nominals, bool *values, bool *defined,
                                       double *next) {
    Pi *s = c;
    if (s->mode != EVENT) return ERROR;
    if (s->active) tick(s);
    *need = *end = *nominals = *values = *defined = false;
    return OK;
}
EXPORT Status fmi3EnterEventMode(Instance c) {
    if (((Pi *)c)->mode != STEP) return ERROR;
    ((Pi *)c)->mode = EVENT;
    return OK;
}
EXPORT Status fmi3EnterStepMode(Instance c) {
    if (((Pi *)c)->mode != EVENT) return ERROR;
    ((Pi *)c)->mode = STEP;
    return OK;
}
EXPORT Status fmi3DoStep(Instance c, double t, double h, bool keep, bool *event, bool *end, bool *early, double *last) {
    Pi *s = c;
    if (s->mode != STEP || fabs(t - s->time) > 1e-9) return ERROR;
#ifdef PLAIN
    tick(s);
#endif
    s->time = *last = t + h;
    *event = *end = *early = false;
    return OK;
}
EXPORT Status fmi3GetFMUState(Instance c, void **state) {
    if (!*state) *state = malloc(sizeof(Pi));
    memcpy(*state, c, sizeof(Pi));
    return OK;
}
EXPORT Status fmi3SetFMUState(Instance c, void *state) { memcpy(c, state, sizeof(Pi)); return OK; }
EXPORT Status fmi3FreeFMUState(Instance c, void **state) { free(*state); *state = NULL; return OK; }
