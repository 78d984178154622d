/* FMI 2.0 model exchange with events of known solution.
 *
 * x' = s, x(0) = 0; s = 1, and -1 after x has reached 0.53 (state event, indicator x - 0.53 while s = 1);
 * at t = 0.75 (time event) x jumps by 2. So x = t to 0.53, then 1.06 - t, then 3.06 - t after the jump. y = x + 10 u. Value references: u 0, y 1, x 2, der(x) 3.
 */
#include <stddef.h>
#include <stdlib.h>

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

typedef void *Component;
typedef unsigned int Reference;
typedef enum { OK, WARNING, DISCARD, ERROR } Status;
typedef struct { int more, terminate, nominals, values, defined; double time; } EventInfo;
typedef struct { double t, u, x, slope; int jumped, event_mode; } Model;

EXPORT const char *fmi2GetTypesPlatform(void) { return "default"; }
EXPORT const char *fmi2GetVersion(void) { return "2.0"; }
EXPORT Component fmi2Instantiate(const char *n, int k, const char *g, const char *r, const void *f, int v, int l) {
    Model *m = calloc(1, sizeof(Model));
    m->slope = 1;
    return m;
}
EXPORT void fmi2FreeInstance(Component c) { free(c); }
EXPORT Status fmi2SetupExperiment(Component c, int td, double tol, double t0, int sd, double t1) {
    ((Model *)c)->t = t0;
    return OK;
}
EXPORT Status fmi2EnterInitializationMode(Component c) { return OK; }
EXPORT Status fmi2ExitInitializationMode(Component c) { ((Model *)c)->event_mode = 1; return OK; }
EXPORT Status fmi2EnterEventMode(Component c) {
    Model *m = c;
    if (m->event_mode) return ERROR;
    m->event_mode = 1;
    return OK;
}
EXPORT Status fmi2EnterContinuousTimeMode(Component c) {
    Model *m = c;
    if (!m->event_mode) return ERROR;
    m->event_mode = 0;
    return OK;
}
EXPORT Status fmi2NewDiscreteStates(Component c, EventInfo *info) {
    Model *m = c;
    info->more = info->terminate = info->nominals = info->values = 0;
    if (m->x > 0.53 - 1e-9 && !m->jumped) m->slope = -1;
    if (m->t >= 0.75 && !m->jumped) {
        m->x += 2;
        m->jumped = info->values = info->more = 1;
    }
    info->defined = !m->jumped;
    info->time = 0.75;
    return m->event_mode ? OK : ERROR;
}
EXPORT Status fmi2CompletedIntegratorStep(Component c, int keep, int *event, int *terminate) {
    *event = *terminate = 0;
    return OK;
}
EXPORT Status fmi2SetTime(Component c, double t) { ((Model *)c)->t = t; return OK; }
EXPORT Status fmi2SetContinuousStates(Component c, const double x[], size_t n) {
    Model *m = c;
    if (m->event_mode) return ERROR;
    m->x = x[0];
    return OK;
}
EXPORT Status fmi2GetContinuousStates(Component c, double x[], size_t n) { x[0] = ((Model *)c)->x; return OK; }
EXPORT Status fmi2GetNominalsOfContinuousStates(Component c, double x[], size_t n) { x[0] = 0; return OK; }
EXPORT Status fmi2GetDerivatives(Component c, double dx[], size_t n) { dx[0] = ((Model *)c)->slope; return OK; }
EXPORT Status fmi2GetEventIndicators(Component c, double z[], size_t n) {
    Model *m = c;
    z[0] = m->jumped || m->slope < 0 ? 1 : m->x - 0.53;
    return OK;
}
EXPORT Status fmi2SetReal(Component c, const Reference r[], size_t n, const double v[]) {
    Model *m = c;
    for (size_t i = 0; i < n; i++) if (r[i] == 0) m->u = v[i]; else return ERROR;
    return OK;
}
EXPORT Status fmi2GetReal(Component c, const Reference r[], size_t n, double v[]) {
    Model *m = c;
    const double values[] = {m->u, m->x + 10 * m->u, m->x, m->slope};
    for (size_t i = 0; i < n; i++) v[i] = values[r[i]];
    return OK;
}
