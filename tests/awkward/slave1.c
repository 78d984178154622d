/* One FMI 1.0 co-simulation slave, strict about the order of calls.
 *
 * x' = -a x + u by explicit Euler, one step for each doStep; y = n (x + d u), negative if `flip` is true.
 * Value references: Real u 0, y 1, a 2, d 3; Integer n 4; Boolean flip 5; String label 6; Integer output count 7.
 */
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif
#define F(name) slave1_##name

typedef void *Component;
typedef unsigned int Reference;
typedef enum { OK, WARNING, DISCARD, ERROR } Status;
typedef void (*Logger)(Component, const char *, Status, const char *, const char *, ...);
typedef struct { Logger logger; void *allocate; void *release; void *finished; } Callbacks;
typedef struct { double u, a, d, x; int n, running, steps; char flip; Callbacks callbacks; } Slave;

static Status fail(Slave *s, const char *text) {
    s->callbacks.logger(s, "slave1", ERROR, "error", text);
    return ERROR;
}

static void defaults(Slave *s) {
    const Callbacks kept = s->callbacks;
    memset(s, 0, sizeof(*s));
    s->a = 2;
    s->d = 0.5;
    s->n = 1;
    s->callbacks = kept;
}

EXPORT const char *F(fmiGetTypesPlatform)(void) { return "standard32"; }
EXPORT const char *F(fmiGetVersion)(void) { return "1.0"; }
EXPORT Status F(fmiSetDebugLogging)(Component c, char on) { return OK; }

EXPORT Component F(fmiInstantiateSlave)(const char *name, const char *guid, const char *location, const char *mime,
                                        double timeout, char visible, char interactive, Callbacks callbacks,
                                        char logging) {
    if (strcmp(guid, "awkward") || strcmp(mime, "application/x-fmu-sharedlibrary")) return NULL;
    if (strncmp(location, "file:///", 8)) return NULL;
    Slave *s = calloc(1, sizeof(Slave));
    s->callbacks = callbacks;
    defaults(s);
    return s;
}
EXPORT void F(fmiFreeSlaveInstance)(Component c) { free(c); }
EXPORT Status F(fmiInitializeSlave)(Component c, double start, char defined, double stop) {
    Slave *s = c;
    if (s->running) return fail(s, "initialised twice");
    s->running = 1;
    return OK;
}
EXPORT Status F(fmiTerminateSlave)(Component c) { return ((Slave *)c)->running ? OK : ERROR; }
EXPORT Status F(fmiResetSlave)(Component c) {
    Slave *s = c;
#ifdef RESET_KEEPS_STATE
    s->running = 0;
#else
    defaults(s);
#endif
    return OK;
}

EXPORT Status F(fmiGetReal)(Component c, const Reference r[], size_t n, double v[]) {
    Slave *s = c;
    if (!s->running) return fail(s, "there are no values before fmiInitializeSlave");
    for (size_t i = 0; i < n; i++) {
        if (r[i] != 1) return fail(s, "no such output");
        v[i] = s->n * (s->x + s->d * s->u) * (s->flip ? -1 : 1);
    }
    return OK;
}
EXPORT Status F(fmiSetReal)(Component c, const Reference r[], size_t n, const double v[]) {
    Slave *s = c;
    double *places[] = {&s->u, NULL, &s->a, &s->d};
    for (size_t i = 0; i < n; i++) {
        if (r[i] > 3 || r[i] == 1) return fail(s, "no such Real variable that can be set");
        if (r[i] > 1 && s->running) return fail(s, "parameters are fixed after the initialisation");
        *places[r[i]] = v[i];
    }
    return OK;
}
EXPORT Status F(fmiGetInteger)(Component c, const Reference r[], size_t n, int v[]) {
    for (size_t i = 0; i < n; i++) v[i] = r[i] == 4 ? ((Slave *)c)->n : ((Slave *)c)->steps;
    return OK;
}
EXPORT Status F(fmiSetInteger)(Component c, const Reference r[], size_t n, const int v[]) {
    for (size_t i = 0; i < n; i++) ((Slave *)c)->n = v[i];
    return OK;
}
EXPORT Status F(fmiGetBoolean)(Component c, const Reference r[], size_t n, char v[]) { return ERROR; }
EXPORT Status F(fmiSetBoolean)(Component c, const Reference r[], size_t n, const char v[]) {
    for (size_t i = 0; i < n; i++) ((Slave *)c)->flip = v[i];
    return OK;
}
EXPORT Status F(fmiSetString)(Component c, const Reference r[], size_t n, const char *const v[]) { return OK; }

EXPORT Status F(fmiDoStep)(Component c, double t, double h, char new) {
    Slave *s = c;
    if (!s->running || !new) return fail(s, "not initialised");
    s->x += h * (s->u - s->a * s->x);
    s->steps++;
    return OK;
}
