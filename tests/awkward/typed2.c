/* FMI 2.0 co-simulation with inputs and outputs of every type that is a number.
 *
 * y = gear u if `on`, else 0, at once; mode_out = mode, off = not on, double_gear = 2 gear.
 * Value references: Real u 0, y 1; Integer gear 2, double_gear 3; Boolean on 4, off 5; Enumeration mode 6, mode_out 7.
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
typedef struct { double u; int gear, on, mode; } Slave;

EXPORT const char *fmi2GetTypesPlatform(void) { return "default"; }
EXPORT const char *fmi2GetVersion(void) { return "2.0"; }
EXPORT Component fmi2Instantiate(const char *n, int k, const char *g, const char *r, const void *f, int v, int l) {
    Slave *s = calloc(1, sizeof(Slave));
    s->gear = s->mode = 1;
    return s;
}
EXPORT void fmi2FreeInstance(Component c) { free(c); }
EXPORT Status fmi2SetupExperiment(Component c, int td, double tol, double t0, int sd, double t1) { return OK; }
EXPORT Status fmi2EnterInitializationMode(Component c) { return OK; }
EXPORT Status fmi2ExitInitializationMode(Component c) { return OK; }
EXPORT Status fmi2SetReal(Component c, const Reference r[], size_t n, const double v[]) {
    for (size_t i = 0; i < n; i++) if (r[i] == 0) ((Slave *)c)->u = v[i]; else return ERROR;
    return OK;
}
EXPORT Status fmi2GetReal(Component c, const Reference r[], size_t n, double v[]) {
    const Slave *s = c;
    for (size_t i = 0; i < n; i++) if (r[i] == 1) v[i] = s->on ? s->gear * s->u : 0; else return ERROR;
    return OK;
}
EXPORT Status fmi2SetInteger(Component c, const Reference r[], size_t n, const int v[]) {
    Slave *s = c;
    for (size_t i = 0; i < n; i++) if (r[i] == 2) s->gear = v[i]; else if (r[i] == 6) s->mode = v[i]; else return ERROR;
    return OK;
}
EXPORT Status fmi2GetInteger(Component c, const Reference r[], size_t n, int v[]) {
    const Slave *s = c;
    for (size_t i = 0; i < n; i++) if (r[i] == 3) v[i] = 2 * s->gear; else if (r[i] == 7) v[i] = s->mode; else return ERROR;
    return OK;
}
EXPORT Status fmi2SetBoolean(Component c, const Reference r[], size_t n, const int v[]) {
    for (size_t i = 0; i < n; i++) if (r[i] == 4) ((Slave *)c)->on = v[i]; else return ERROR;
    return OK;
}
EXPORT Status fmi2GetBoolean(Component c, const Reference r[], size_t n, int v[]) {
    for (size_t i = 0; i < n; i++) if (r[i] == 5) v[i] = !((Slave *)c)->on; else return ERROR;
    return OK;
}
EXPORT Status fmi2DoStep(Component c, double t, double h, int keep) { return OK; }
