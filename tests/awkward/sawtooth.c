/* FMI 3.0 co-simulation with an event of known solution: x' = u, and x falls from 1 to 0, so x = t mod 1 for u = 1.
 *
 * In event mode a step comes back early at the fall, and the event iteration does it; without event mode the slave
 * does it by itself, at the right instant. jumps counts. Value references: u 0, x 1, jumps 2 (Int32).
 * EARLY: comes back after 4 ms at most, whatever was asked for. STUCK: comes back early without having moved.
 * TIMED: does not come back early, but announces the fall, for u = 1, as its next time event.
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
typedef struct { double u, x, time; int32_t jumps; bool events, event_mode; } Slave;

EXPORT const char *fmi3GetVersion(void) { return "3.0"; }
EXPORT Instance fmi3InstantiateCoSimulation(const char *name, const char *token, const char *resources, bool visible,
                                            bool logging, bool events, bool early, const Reference needed[], size_t n,
                                            void *environment, void *log, void *update) {
    Slave *s = calloc(1, sizeof(Slave));
    s->events = events;
    return s;
}
EXPORT void fmi3FreeInstance(Instance c) { free(c); }
EXPORT Status fmi3EnterInitializationMode(Instance c, bool td, double tol, double t0, bool sd, double t1) {
    ((Slave *)c)->time = t0;
    return OK;
}
EXPORT Status fmi3ExitInitializationMode(Instance c) {
    ((Slave *)c)->event_mode = ((Slave *)c)->events;
    return OK;
}
EXPORT Status fmi3SetFloat64(Instance c, const Reference r[], size_t n, const double v[], size_t count) {
    ((Slave *)c)->u = v[0];
    return r[0] == 0 ? OK : ERROR;
}
EXPORT Status fmi3GetFloat64(Instance c, const Reference r[], size_t n, double v[], size_t count) {
    v[0] = ((Slave *)c)->x;
    return r[0] == 1 ? OK : ERROR;
}
EXPORT Status fmi3GetInt32(Instance c, const Reference r[], size_t n, int32_t v[], size_t count) {
    v[0] = ((Slave *)c)->jumps;
    return OK;
}
static void fall(Slave *s) {
    if (s->x < 1 - 1e-12) return;
    s->x = 0;
    s->jumps++;
}
EXPORT Status fmi3EnterEventMode(Instance c) {
    Slave *s = c;
    if (!s->events || s->event_mode) return ERROR;
    s->event_mode = true;
    return OK;
}
EXPORT Status fmi3EnterStepMode(Instance c) {
    Slave *s = c;
    if (!s->event_mode) return ERROR;
    s->event_mode = false;
    return OK;
}
EXPORT Status fmi3UpdateDiscreteStates(Instance c, bool *need, bool *end, bool *nominals, bool *values, bool *defined,
                                       double *next) {
    Slave *s = c;
    if (!s->event_mode) return ERROR;
    fall(s);
    *need = *end = *nominals = *values = *defined = false;
#ifdef TIMED
    *defined = true;
    *next = s->time + 1 - s->x;
#endif
    return OK;
}
EXPORT Status fmi3DoStep(Instance c, double t, double h, bool keep, bool *event, bool *end, bool *early, double *last) {
    Slave *s = c;
    if (s->event_mode) return ERROR;
    *event = *end = *early = false;
#ifdef STUCK
    *early = true;
    *last = t;
    return OK;
#endif
#ifdef EARLY
    *early = h > 0.004;
    if (*early) h = 0.004;
#endif
    const double rest = s->u > 0 ? (1 - s->x) / s->u : h + 1;
    *last = t + h;
    if (rest <= h && s->events) {
#ifndef TIMED
        *event = true;
        *early = rest < h;
        *last = t + rest;
        h = rest;
#endif
        s->x += h * s->u;
    } else if (rest <= h) {
        s->x = 1;
        fall(s);
        s->x = (h - rest) * s->u;
    } else {
        s->x += h * s->u;
    }
    s->time = *last;
    return OK;
}
