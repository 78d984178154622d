/* One FMI 2.0 co-simulation slave with faults seen in FMUs of the field, one for each macro.
 *
 * x' = -a x + u by explicit Euler, one step for each doStep; y = n (x + d u), negative if `flip` is true,
 * doubled if `label` is "double". The parameter `unused` has no effect.
 * Value references: Real u 0, y 1, a 2, d 3, unused 4, internal 10, the initial x; Integer n 5; Boolean flip 6;
 * String label 7.
 */
#ifdef LICENCES
#define _GNU_SOURCE
#endif
#include <math.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

typedef void *Component;
typedef unsigned int Reference;
typedef enum { OK, WARNING, DISCARD, ERROR } Status;
typedef void (*Logger)(void *, const char *, Status, const char *, const char *, ...);
typedef struct { Logger logger; void *allocate; void *release; void *finished; void *environment; } Callbacks;

typedef struct {
    double u, a, d, unused, x, held, acting_a, acting_d;
    double time;
    int n, flip, twice, running, steps, stepped, refused;
    const Callbacks *callbacks;
} Slave;

#ifdef SHARED_STATE
static double shared_x;
#define X(s) shared_x
#else
#define X(s) (s)->x
#endif
static int instances;
#if defined(CRASH_AT_THIRD) || defined(CRASH_AT_SECOND) || defined(HANG_AT_SECOND) || defined(REFUSES_SECOND)
static int ever;
#endif
#ifdef CHDIR_IN_STEP
int chdir(const char *);
#endif
#ifdef LICENCES
/* A process that instantiates takes one of LICENCES licences and keeps it to its end, as with a server of licences. */
#include <fcntl.h>
#include <stdio.h>
#include <sys/file.h>
static int licence(void) {
    static int have;
    for (int k = 0; k < LICENCES && !have; k++) {
        char name[4096];
        snprintf(name, sizeof name, "%s/licence%d", getenv("SLAVE_LICENCES"), k);
        have = flock(open(name, O_CREAT | O_RDWR | O_CLOEXEC, 0600), LOCK_EX | LOCK_NB) == 0;
    }
    return have;
}
#endif

#ifdef CRASH_WHEN_LOADED
__attribute__((constructor)) static void crash(void) { abort(); }
#endif

static Status fail(Slave *s, Status status, const char *text) {
    if (s->callbacks && s->callbacks->logger)
        s->callbacks->logger(s->callbacks->environment, "slave", status, "logStatusError", text);
    return status;
}

static double output(Slave *s) {
    double y = s->n * (X(s) + s->d * s->u) * (s->twice ? 2 : 1);
#ifdef NAN_OUTPUT
    if (s->steps > 5) return NAN;
#endif
    return s->flip ? -y : y;
}

static void defaults(Slave *s) {
    s->u = s->unused = 0;
    s->a = 2;
    s->d = 0.5;
    s->n = 1;
    s->flip = s->twice = s->running = s->steps = 0;
    X(s) = 0;
    s->time = 0;
#ifdef COUNTS_INSTANCES
    X(s) = 0.25 * instances;
#endif
    s->held = output(s);
}

EXPORT const char *fmi2GetTypesPlatform(void) { return "default"; }
EXPORT const char *fmi2GetVersion(void) { return "2.0"; }
EXPORT Status fmi2SetDebugLogging(Component c, int on, size_t n, const char *const names[]) { return OK; }

EXPORT Component fmi2Instantiate(const char *name, int kind, const char *guid, const char *resources,
                                 const Callbacks *callbacks, int visible, int logging) {
#ifdef ONCE_PER_PROCESS
    if (instances > 0) return NULL;
#endif
#ifdef LICENCES
    if (!licence()) return NULL;
#endif
#ifdef CRASH_AT_THIRD
    if (++ever > 2) abort();
#endif
#ifdef CRASH_AT_SECOND
    if (++ever > 1) abort();
#endif
#ifdef HANG_AT_SECOND
    volatile int for_ever = ++ever > 1;
    while (for_ever) {}
#endif
    Slave *s = calloc(1, sizeof(Slave));
    s->callbacks = callbacks;
#ifdef REFUSES_SECOND
    s->refused = ++ever > 1;
#endif
    defaults(s);
    instances++;
    return s;
}

EXPORT void fmi2FreeInstance(Component c) {
#ifndef COUNTS_INSTANCES
    instances--;
#endif
    free(c);
}

EXPORT Status fmi2SetupExperiment(Component c, int td, double tol, double t0, int sd, double t1) {
#ifdef SETUP_OVERWRITES
    defaults(c); /* as FMUs of 20-sim do */
#endif
    return OK;
}
EXPORT Status fmi2EnterInitializationMode(Component c) {
#ifdef ENTER_OVERWRITES
    defaults(c);
#endif
    return OK;
}
EXPORT Status fmi2ExitInitializationMode(Component c) {
    Slave *s = c;
    s->running = s->stepped = 1;
    s->acting_a = s->a;
    s->acting_d = s->d;
    s->held = output(s);
#ifdef REFUSES_SECOND
    if (s->refused) return ERROR; /* as FMUs of Amesim do, whose properties are defined already */
#endif
    return OK;
}
EXPORT Status fmi2Terminate(Component c) { return OK; }
EXPORT Status fmi2Reset(Component c) {
    Slave *s = c;
#ifdef CRASH_IN_RESET
    *(volatile int *)NULL = 1;
#endif
#ifdef RESET_KEEPS_PARAMETERS
    const double a = s->a;
    defaults(s);
    s->a = a;
#elif defined(RESET_KEEPS_STATE)
    double x = X(s);
    defaults(s);
    X(s) = x;
#else
    defaults(s);
#endif
    return OK;
}

EXPORT Status fmi2GetReal(Component c, const Reference r[], size_t n, double v[]) {
    Slave *s = c;
#ifdef READING_ACTS
    if (s->running && !s->stepped) X(s) += 1e-3; /* its solver goes on otherwise once it was asked in between */
#endif
    for (size_t i = 0; i < n; i++) {
#ifdef DELAYED_OUTPUT
        const double y = s->held;
#else
        double y = output(s);
#endif
#ifdef ROUGH_BETWEEN_STEPS
        /* Its solver has got beyond the end of the step, by chance: as FMUs with a step control of their own do. */
        if (!s->stepped) y *= 1 + 0.005 * sin(1e9 * s->u);
#endif
        const double values[] = {s->u, y, s->a, s->d, s->unused};
        if (r[i] > 4 && r[i] != 10) return fail(s, ERROR, "no such Real variable");
#ifdef PARAMETERS_UNREADABLE
        if (r[i] > 1) return fail(s, ERROR, "parameters cannot be read");
#endif
        v[i] = r[i] == 10 ? X(s) : values[r[i]];
    }
    return OK;
}

EXPORT Status fmi2SetReal(Component c, const Reference r[], size_t n, const double v[]) {
    Slave *s = c;
    for (size_t i = 0; i < n; i++) {
        double *places[] = {&s->u, NULL, &s->a, &s->d, &s->unused};
        if (r[i] == 10 && !s->running) {
            X(s) = v[i];
            continue;
        }
        if (r[i] > 4 || !places[r[i]]) return fail(s, ERROR, "no such Real variable that can be set");
        s->stepped = 0;
#ifdef FIXED_PARAMETERS
        if (s->running && r[i] > 1) return fail(s, ERROR, "parameters are fixed after the initialisation");
#endif
#ifdef SINGLE_PRECISION
        *places[r[i]] = (float)v[i];
        continue;
#endif
#ifdef LIMITED
        if (r[i] == 2 && v[i] > 3) {
            s->a = 3;
            continue;
        }
#endif
        *places[r[i]] = v[i];
    }
    return OK;
}

EXPORT Status fmi2GetInteger(Component c, const Reference r[], size_t n, int v[]) {
    for (size_t i = 0; i < n; i++) v[i] = ((Slave *)c)->n;
    return OK;
}
EXPORT Status fmi2GetBoolean(Component c, const Reference r[], size_t n, int v[]) {
    for (size_t i = 0; i < n; i++) v[i] = ((Slave *)c)->flip;
    return OK;
}
EXPORT Status fmi2SetInteger(Component c, const Reference r[], size_t n, const int v[]) {
    for (size_t i = 0; i < n; i++) ((Slave *)c)->n = v[i];
    return OK;
}
EXPORT Status fmi2SetBoolean(Component c, const Reference r[], size_t n, const int v[]) {
    for (size_t i = 0; i < n; i++) ((Slave *)c)->flip = v[i];
    return OK;
}
EXPORT Status fmi2SetString(Component c, const Reference r[], size_t n, const char *const v[]) {
    for (size_t i = 0; i < n; i++) ((Slave *)c)->twice = !strcmp(v[i], "double");
    return OK;
}

#ifndef MISSING_SYMBOL
EXPORT Status fmi2DoStep(Component c, double t, double h, int keep) {
    Slave *s = c;
    s->stepped = 1;
#ifdef CRASH_IN_STEP
    if (s->steps >= 3) *(volatile int *)NULL = 1;
#endif
#ifdef ERROR_IN_STEP
    if (s->steps >= 3) return fail(s, ERROR, "the solver gave up");
#endif
#ifdef ERROR_LATER
    static long ever_stepped;
    if (++ever_stepped > 1200) return fail(s, ERROR, "the licence has run out");
#endif
#ifdef EXIT_IN_STEP
    if (s->steps >= 3) exit(7);
#endif
#ifdef ONLY_SMALL_INPUTS
    if (s->u < -0.2 || s->u > 0.2) return fail(s, ERROR, "the input is out of range");
#endif
#ifdef EXIT_WELL_IN_STEP
    if (s->steps >= 3) exit(0); /* as if all had gone well */
#endif
#ifdef CHDIR_IN_STEP
    if (chdir("/")) return ERROR;
#endif
#ifdef HANG_IN_STEP
    volatile int forever = 1;
    while (s->steps >= 3 && forever) {}
#endif
#ifdef REFUSED_STEP
    if (h < 0.01) return fail(s, DISCARD, "only steps of 10 ms and more");
#endif
    s->held = output(s);
#ifdef TUNABLE_IGNORED
    s->a = s->acting_a; /* what was set after the initialisation is forgotten */
    s->d = s->acting_d;
#endif
#ifdef OTHER_AT_HALF_STEP
    h = 0.01; /* whatever was asked for */
#endif
    s->steps++;
#ifdef OWN_STEPS /* a solver with a fixed step of 10 ms, which goes on until it has passed the end of the step */
    while (s->time < t + h) {
        const double decay = exp(-s->a * 0.01);
        X(s) = decay * X(s) + (1 - decay) / s->a * s->u;
        s->time = 0.01 * (floor(s->time / 0.01 + 0.5) + 1);
    }
    return OK;
#endif
#ifdef HOLDS
    if (s->steps % 10) return OK; /* it takes steps of its own */
    h *= 10;
#endif
    X(s) += h * (s->u - s->a * X(s));
    return OK;
}
#endif

EXPORT Status fmi2GetFMUstate(Component c, void **state) {
    if (!*state) *state = malloc(sizeof(Slave));
    memcpy(*state, c, sizeof(Slave));
    return OK;
}
EXPORT Status fmi2SetFMUstate(Component c, void *state) {
#ifdef CRASH_IN_NEW_STATE
    if (!((Slave *)state)->running) abort();
#endif
#ifdef STATE_INCOMPLETE
    const double x = ((Slave *)c)->x;
    memcpy(c, state, sizeof(Slave));
    ((Slave *)c)->x = x;
#else
    memcpy(c, state, sizeof(Slave));
#endif
    return OK;
}
EXPORT Status fmi2FreeFMUstate(Component c, void **state) {
#ifdef ABORT_IN_FREE_STATE
    abort();
#endif
    free(*state);
    *state = NULL;
    return OK;
}
