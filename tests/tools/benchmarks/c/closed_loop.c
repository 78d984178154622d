/* A plant under a sampled control law as one program: the limit for a loop of two FMUs. */
#include "config.h"

#define CASADI_SYMBOL_EXPORT static
#define casadi_real double
#define casadi_int long long int
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wunused-function"
#pragma GCC diagnostic ignored "-Wunused-parameter"
#include "equations.c"
#pragma GCC diagnostic pop

#ifdef _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif
#define SIZE(n) ((n) > 0 ? (n) : 1) /* C has no empty array */

static double work[4096]; /* scalar code needs hardly any */

static void plant_slope(const double *x, const double *u, const double *p, double *dx) {
    const double *arguments[] = {x, u, p};
    double *results[] = {dx};
    plant_update(arguments, results, 0, work, 0);
}

/* In the order of sums of the exported FMU. */
static void integrate(double *x, const double *u, const double *p) {
    const double h = period / SUBSTEPS;
    double k[PLANT_STATES], sum[PLANT_STATES], stage[PLANT_STATES];
    for (int n = 0; n < SUBSTEPS; ++n) {
        plant_slope(x, u, p, k);
        for (int i = 0; i < PLANT_STATES; ++i) sum[i] = k[i], stage[i] = x[i] + 0.5 * h * k[i];
        plant_slope(stage, u, p, k);
        for (int i = 0; i < PLANT_STATES; ++i) sum[i] += 2.0 * k[i], stage[i] = x[i] + 0.5 * h * k[i];
        plant_slope(stage, u, p, k);
        for (int i = 0; i < PLANT_STATES; ++i) sum[i] += 2.0 * k[i], stage[i] = x[i] + h * k[i];
        plant_slope(stage, u, p, k);
        for (int i = 0; i < PLANT_STATES; ++i) x[i] += h / 6.0 * (sum[i] + k[i]);
    }
}

/* Ticks 0 to count - 1; rows[tick] < 0: not recorded. The state of the plant is (q, dq), its output (q, dq, ddq). */
EXPORT void run(long long count, const double *reference, const double *plant, const double *law,
                const long long *rows, double *record) {
    double x[PLANT_STATES], z[SIZE(LAW_STATES)], next[SIZE(LAW_STATES)], u[LAW_INPUTS], command[JOINTS], tau[JOINTS];
    double y[3 * JOINTS];
    for (int j = 0; j < JOINTS; ++j) tau[j] = 0.0;
    const double *start[] = {tau, plant};
    double *first[] = {x};
    plant_start(start, first, 0, work, 0);
    for (long long tick = 0; tick < count; ++tick, reference += COLUMNS) {
        for (int i = 0; i < LAW_INPUTS; ++i) u[i] = source[i] >= 0 ? reference[source[i]] : x[-1 - source[i]];
        if (tick == 0) {
            const double *arguments[] = {u, law};
            double *results[] = {z};
            law_start(arguments, results, 0, work, 0);
        }
        const double *seen[] = {z, u, law};
        double *commanded[] = {command}, *following[] = {next};
        law_output(seen, commanded, 0, work, 0);
        law_update(seen, following, 0, work, 0);
        for (int i = 0; i < LAW_STATES; ++i) z[i] = next[i];
        for (int j = 0; j < JOINTS; ++j) tau[j] = gain[j] * command[j];
        if (rows[tick] >= 0) {
            const double *arguments[] = {x, tau, plant};
            double *results[] = {y}, *row = record + rows[tick] * 4 * JOINTS;
            plant_output(arguments, results, 0, work, 0);
            for (int j = 0; j < JOINTS; ++j) row[j] = tau[j];
            for (int j = 0; j < 3 * JOINTS; ++j) row[JOINTS + j] = y[j];
        }
        integrate(x, tau, plant);
    }
}

/* The plant's equations alone, `each` times at every one of the given states; dx keeps the calls apart. */
EXPORT double evaluate(long long count, int each, const double *states, const double *torques, const double *plant) {
    double x[PLANT_STATES], dx[PLANT_STATES] = {0}, total = 0.0;
    for (long long tick = 0; tick < count; ++tick, states += PLANT_STATES, torques += JOINTS) {
        for (int n = 0; n < each; ++n) {
            for (int i = 0; i < PLANT_STATES; ++i) x[i] = states[i] + 1e-12 * dx[i];
            plant_slope(x, torques, plant, dx);
        }
        total += dx[PLANT_STATES - 1];
    }
    return total;
}
