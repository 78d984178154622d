/* A block together with the derivatives of its states and outputs by some parameters, one lane a parameter.

   The derivatives are those of the discrete equations: the same substeps, differentiated stage by stage. Of a block whose
   stiff part is known they are linearly implicit, where a block without derivatives may take RK4 instead, which errs less.
   set, get and step have the signatures of FMI 2.0, so that the compiled loop calls them as it calls an FMU; the
   arrays are the values, then for each variable its LANES derivatives. */
#include <math.h>
#include <string.h>

#include "variational_config.h"

#define CASADI_SYMBOL_EXPORT static
#define casadi_real double
#define casadi_int long long int
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wunused-function"
#pragma GCC diagnostic ignored "-Wunused-parameter"
#include "variational_equations.c"
#pragma GCC diagnostic pop

#ifdef _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif
#define SIZE(n) ((n) > 0 ? (n) : 1) /* C has no empty array */
enum { OK = 0, ERROR = 3 };

typedef double Lane[LANES];

typedef struct {
    double p[SIZE(PARAMETERS)], x[SIZE(STATES)], u[SIZE(INPUTS)], rate, work[SIZE(WORK)];
    Lane dx[SIZE(STATES)], du[SIZE(INPUTS)], hidden[SIZE(HIDDEN)], rest[SIZE(HIDDEN)];
    double coefficients[SIZE(COEFFICIENTS)];
    double stage[SIZE(STATES)];
    Lane dstage[SIZE(STATES)];
#if IMPLICIT
    double memory[SIZE(MEMORY)], remembered[SIZE(MEMORY)];
    Lane dmemory[SIZE(MEMORY)], dremembered[SIZE(MEMORY)];
#else
    double slope[SIZE(STATES)], sum[SIZE(STATES)];
    Lane dslope[SIZE(STATES)], dsum[SIZE(STATES)];
#endif
    int substeps, initialising;
} Instance;

#include "variational_lanes.c"

static void start(Instance *s) {
    const double *arguments[] = {s->u, s->p};
    double *results[] = {s->x, s->coefficients};
    variational_start(arguments, results, 0, s->work, 0);
    lanes_start(s->coefficients, (const Lane *)s->du, s->dx);
}

#if !IMPLICIT
/* Derivative of the states, or the next states of a sampled block, at (x, dx). */
static void update(Instance *s, const double *x, const Lane *dx, double *result, Lane *dresult) {
    const double *arguments[] = {x, s->u, s->p};
    double *results[] = {result, s->coefficients};
    variational_update(arguments, results, 0, s->work, 0);
    lanes_update(s->coefficients, dx, (const Lane *)s->du, s->rest, s->hidden, dresult);
}
#endif

/* The rule of choose_substeps in fmu_didim/dynamics/block.py; 0: too stiff. */
static int substeps_for(const Instance *s, double step) {
    if (s->substeps > 0) return s->substeps;
    const double wanted = step * s->rate / SUBSTEP_RATE;
    int count = MINIMUM_SUBSTEPS;
    while (count < wanted && count < MAXIMUM_SUBSTEPS) count *= 2;
    return wanted <= count ? count : 0;
}

#if IMPLICIT
/* Equal substeps of the linearly implicit method of fmu_didim/dynamics/linearly_implicit.py. */
static int integrate(Instance *s, double step) {
    const int count = substeps_for(s, step);
    if (count == 0) return ERROR;
    const double h = step / count;
    for (int n = 0; n < count; ++n) {
        const double *arguments[] = {s->x, s->memory, s->u, s->p, &h};
        double *results[] = {s->stage, s->remembered, s->coefficients};
        variational_step(arguments, results, 0, s->work, 0);
        lanes_step(s->coefficients, (const Lane *)s->dx, (const Lane *)s->dmemory, (const Lane *)s->du, s->rest,
                   s->hidden, s->dstage, s->dremembered);
        memcpy(s->x, s->stage, sizeof(s->x));
        memcpy(s->dx, s->dstage, sizeof(s->dx));
        memcpy(s->memory, s->remembered, sizeof(s->memory));
        memcpy(s->dmemory, s->dremembered, sizeof(s->dmemory));
    }
    return OK;
}
#else
static void move(Lane *result, const Lane *x, const Lane *restrict slope, double h) {
    for (int i = 0; i < STATES; ++i)
        for (int l = 0; l < LANES; ++l) result[i][l] = x[i][l] + h * slope[i][l];
}

static void add(Lane *restrict sum, const Lane *restrict slope, double weight) {
    for (int i = 0; i < STATES; ++i)
        for (int l = 0; l < LANES; ++l) sum[i][l] += weight * slope[i][l];
}

/* One stage: the slopes at (x, dx), added to their sums with this weight. */
static void stage(Instance *s, const double *x, const Lane *dx, double weight) {
    update(s, x, dx, s->slope, s->dslope);
    for (int i = 0; i < STATES; ++i) s->sum[i] += weight * s->slope[i];
    add(s->dsum, (const Lane *)s->dslope, weight);
}

/* Where the next stage is: x + size * slope. */
static void next_stage(Instance *s, double size) {
    for (int i = 0; i < STATES; ++i) s->stage[i] = s->x[i] + size * s->slope[i];
    move(s->dstage, (const Lane *)s->dx, (const Lane *)s->dslope, size);
}

/* Classical Runge-Kutta method of fourth order with equal substeps, as in block.c. */
static int integrate(Instance *s, double step) {
    const int count = substeps_for(s, step);
    if (count == 0) return ERROR;
    const double h = step / count;
    for (int n = 0; n < count; ++n) {
        memset(s->sum, 0, sizeof(s->sum));
        memset(s->dsum, 0, sizeof(s->dsum));
        stage(s, s->x, (const Lane *)s->dx, 1.0);
        next_stage(s, 0.5 * h);
        stage(s, s->stage, (const Lane *)s->dstage, 2.0);
        next_stage(s, 0.5 * h);
        stage(s, s->stage, (const Lane *)s->dstage, 2.0);
        next_stage(s, h);
        stage(s, s->stage, (const Lane *)s->dstage, 1.0);
        for (int i = 0; i < STATES; ++i) s->x[i] += h / 6.0 * s->sum[i];
        move(s->dx, (const Lane *)s->dx, (const Lane *)s->dsum, h / 6.0);
    }
    return OK;
}
#endif

EXPORT unsigned long long instance_size(void) { return sizeof(Instance); }

/* substeps: 0 chooses them from the fastest rate. */
EXPORT void begin(Instance *s, const double *parameters, int substeps) {
    memset(s, 0, sizeof(*s));
    memcpy(s->p, parameters, PARAMETERS * sizeof(double));
    s->substeps = substeps;
    s->initialising = 1;
}

EXPORT void finish_initialization(Instance *s) {
    start(s);
    s->initialising = 0;
    const double *arguments[] = {s->x, s->p};
    double *results[] = {&s->rate};
    variational_rate(arguments, results, 0, s->work, 0);
}

EXPORT int set_values(Instance *s, const unsigned int *references, size_t count, const double *values) {
    (void)references, (void)count;
    memcpy(s->u, values, INPUTS * sizeof(double));
    memcpy(s->du, values + INPUTS, INPUTS * sizeof(Lane));
    return OK;
}

EXPORT int get_values(Instance *s, const unsigned int *references, size_t count, double *values) {
    (void)references, (void)count;
    if (s->initialising) start(s);
    const double *arguments[] = {s->x, s->u, s->p};
    double *results[] = {values, s->coefficients};
    variational_output(arguments, results, 0, s->work, 0);
    lanes_output(s->coefficients, (const Lane *)s->dx, (const Lane *)s->du, s->rest, s->hidden,
                 (Lane *)(values + OUTPUTS));
    return OK;
}

EXPORT int do_step(Instance *s, double time, double step, int unused) {
    (void)time, (void)unused;
#if SAMPLED
    (void)step;
    update(s, s->x, (const Lane *)s->dx, s->stage, s->dstage);
    memcpy(s->x, s->stage, sizeof(s->x));
    memcpy(s->dx, s->dstage, sizeof(s->dx));
#else
    if (step > 0.0 && integrate(s, step)) return ERROR;
#endif
    for (int i = 0; i < STATES; ++i)
        if (!isfinite(s->x[i])) return ERROR;
    return OK;
}
