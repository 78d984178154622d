/* FMI 3.0 co-simulation with arrays: y[2] = A[2,2] u[2] at once, and time in z. Counts only, no states.
 * Value references: u 0, y 1, A 2, z 3; Int32 n 4 and Boolean off 5 scale y by n and to 0.
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
typedef struct { double u[2], a[4], t; int32_t n; bool off; } Slave;

EXPORT const char *fmi3GetVersion(void) { return "3.0"; }
EXPORT Instance fmi3InstantiateCoSimulation(const char *name, const char *token, const char *resources, bool visible,
                                            bool logging, bool events, bool early, const Reference needed[], size_t n,
                                            void *environment, void *log, void *update) {
    Slave *s = calloc(1, sizeof(Slave));
    s->a[0] = s->a[3] = s->n = 1;
    return s;
}
EXPORT void fmi3FreeInstance(Instance c) { free(c); }
EXPORT Status fmi3EnterInitializationMode(Instance c, bool td, double tol, double t0, bool sd, double t1) {
    ((Slave *)c)->t = t0;
#ifdef ENTER_OVERWRITES
    ((Slave *)c)->a[1] = 0;
#endif
    return OK;
}
EXPORT Status fmi3ExitInitializationMode(Instance c) { return OK; }

EXPORT Status fmi3SetFloat64(Instance c, const Reference r[], size_t n, const double v[], size_t count) {
    Slave *s = c;
    for (size_t i = 0; i < n; i++) {
        double *place = r[i] == 0 ? s->u : r[i] == 2 ? s->a : NULL;
        const size_t size = r[i] == 0 ? 2 : 4;
        if (!place || count < size) return ERROR;
        for (size_t k = 0; k < size; k++) place[k] = *v++;
        count -= size;
    }
    return count ? ERROR : OK;
}
EXPORT Status fmi3GetFloat64(Instance c, const Reference r[], size_t n, double v[], size_t count) {
    Slave *s = c;
    for (size_t i = 0; i < n; i++) {
        if (r[i] == 3 && count >= 1) {
            *v++ = s->t;
            count -= 1;
        } else if (r[i] == 2 && count >= 4) {
            for (int k = 0; k < 4; k++) *v++ = s->a[k];
            count -= 4;
        } else if (r[i] == 1 && count >= 2) {
            for (int k = 0; k < 2; k++) *v++ = s->off ? 0 : s->n * (s->a[2 * k] * s->u[0] + s->a[2 * k + 1] * s->u[1]);
            count -= 2;
        } else {
            return ERROR;
        }
    }
    return count ? ERROR : OK;
}
EXPORT Status fmi3SetInt32(Instance c, const Reference r[], size_t n, const int32_t v[], size_t count) {
    ((Slave *)c)->n = v[0];
    return OK;
}
EXPORT Status fmi3SetBoolean(Instance c, const Reference r[], size_t n, const bool v[], size_t count) {
    ((Slave *)c)->off = v[0];
    return OK;
}
EXPORT Status fmi3DoStep(Instance c, double t, double h, bool keep, bool *event, bool *end, bool *early, double *last) {
    ((Slave *)c)->t = *last = t + h;
    *event = *end = *early = false;
    return OK;
}
