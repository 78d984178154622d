/* The FMI calls of two FMUs in a loop, by their function pointers: the limit for a master. */
#include <stddef.h>

#ifdef _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

typedef int (*Values)(void *, const unsigned int *, size_t, double *);
typedef int (*Step)(void *, double, double, int);

typedef struct {
    void *component;
    Values set, get;
    Step step;
    const unsigned int *inputs, *outputs;
} Slave;

/* a.u = gain[0] reference, a.v = gain[1] b.y, b.u = gain[2] a.y; a before b. A record is
   (reference, a.y, b.y, a.u, a.v, b.u) after both have their inputs. Only outputs that somebody reads are asked for:
   a.y after a's inputs, b.y after those of b, for the record, and after b's step. Returns the first bad status, or 0. */
EXPORT int run(const Slave *a, const Slave *b, long long count, double start, double h, const double *reference,
               const double *gain, double *record) {
    double u[2], w[1], ya[1], yb[1];
    int status = 0;
    if ((status = b->get(b->component, b->outputs, 1, yb)) > 1) return status;
    for (long long k = 0; k < count; ++k, record += 6) {
        const double time = start + (double)k * h;
        u[0] = gain[0] * reference[k], u[1] = gain[1] * yb[0];
        if ((status = a->set(a->component, a->inputs, 2, u)) > 1) return status;
        if ((status = a->get(a->component, a->outputs, 1, ya)) > 1) return status;
        w[0] = gain[2] * ya[0];
        if ((status = b->set(b->component, b->inputs, 1, w)) > 1) return status;
        if ((status = b->get(b->component, b->outputs, 1, yb)) > 1) return status;
        record[0] = reference[k], record[1] = ya[0], record[2] = yb[0];
        record[3] = u[0], record[4] = u[1], record[5] = w[0];
        if ((status = a->step(a->component, time, h, 1)) > 1) return status;
        if ((status = b->step(b->component, time, h, 1)) > 1) return status;
        if ((status = b->get(b->component, b->outputs, 1, yb)) > 1) return status;
    }
    return 0;
}
