/* The core of an exported block; see block.h. */
#include "block.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* CasADi also writes functions that describe its functions; they are not used here. */
#if defined(__GNUC__)
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wunused-function"
#pragma GCC diagnostic ignored "-Wunused-parameter"
#pragma GCC diagnostic ignored "-Wunused-variable"
#pragma GCC diagnostic ignored "-Wunused-but-set-variable"
#endif
#define CASADI_SYMBOL_EXPORT static
#define casadi_real double
#define casadi_int long long int
#include "block_equations.c"
#if defined(__GNUC__)
#pragma GCC diagnostic pop
#endif

/* Two instants closer than this part of the sample time are the same instant. */
#define SAMPLE_TOLERANCE (1e-6 * BLOCK_SAMPLE_TIME)

/* ---- instance ------------------------------------------------------------------------------ */

static void grow(casadi_int total[4], int (*work)(casadi_int *, casadi_int *, casadi_int *, casadi_int *)) {
    casadi_int size[4] = {0, 0, 0, 0};
    work(&size[0], &size[1], &size[2], &size[3]);
    for (int i = 0; i < 4; ++i)
        if (size[i] > total[i]) total[i] = size[i];
}

static Core *core_create(void) {
    casadi_int size[4] = {1, 1, 1, 1};
    grow(size, block_update_work);
    grow(size, block_output_work);
    grow(size, block_start_work);
    grow(size, block_rate_work);
#if BLOCK_DIRECTIONAL
    grow(size, block_directional_work);
    grow(size, block_start_directional_work);
#endif
#if READY_COUNT
    grow(size, block_ready_work);
#endif
#if BLOCK_IMPLICIT
    grow(size, block_step_work);
#endif
    Core *core = calloc(1, sizeof(Core));
    if (!core) return NULL;
    core->arguments = calloc((size_t)size[0], sizeof(*core->arguments));
    core->results = calloc((size_t)size[1], sizeof(*core->results));
    core->integers = calloc((size_t)size[2], sizeof(*core->integers));
    core->reals = calloc((size_t)size[3], sizeof(*core->reals));
    if (!core->arguments || !core->results || !core->integers || !core->reals) {
        core_free(core);
        return NULL;
    }
    core_reset(core);
    return core;
}

static void core_free(Core *core) {
    if (!core) return;
    free(core->arguments);
    free(core->results);
    free(core->integers);
    free(core->reals);
    free(core);
}

static void core_reset(Core *core) {
    CoreState *s = &core->state;
    memset(s, 0, sizeof(*s)); /* padding too: equal states are equal bytes */
    memcpy(s->values, block_start_values, VALUE_COUNT * sizeof(double));
    s->mode = MODE_INSTANTIATED;
    s->start_stale = s->outputs_stale = s->ready_stale = s->derivatives_stale = s->rate_stale = 1;
}

static int core_fail(Core *core, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(core->message, sizeof(core->message), format, arguments);
    va_end(arguments);
    return CORE_ERROR;
}

/* ---- equations ----------------------------------------------------------------------------- */

typedef int (*Equation)(const double **, double **, casadi_int *, double *, int);

/* The arguments are set before each call because CasADi uses the rest of these arrays as work space. */
static int evaluate(Core *core, Equation equation, const char *name) {
    if (equation(core->arguments, core->results, core->integers, core->reals, 0))
        return core_fail(core, "the %s equation could not be evaluated at t=%.9g s", name, core->state.time);
    return CORE_OK;
}

APART static int evaluate_update(Core *core, const double *x, double *result) {
    core->arguments[0] = x;
    core->arguments[1] = core->state.values + INPUT_FIRST;
    core->arguments[2] = core->state.values + PARAMETER_FIRST;
    core->results[0] = result;
    return evaluate(core, block_update, "update");
}

APART static int evaluate_output(Core *core, double *result) {
    core->arguments[0] = core->state.values + STATE_FIRST;
    core->arguments[1] = core->state.values + INPUT_FIRST;
    core->arguments[2] = core->state.values + PARAMETER_FIRST;
    core->results[0] = result;
    return evaluate(core, block_output, "output");
}

/* Names the first value that is not finite. */
APART static int check_finite(Core *core, unsigned int first, unsigned int count, const double *values,
                              const char *kind, double time) {
    for (unsigned int i = 0; i < count; ++i)
        if (!isfinite(values[i]))
            return core_fail(core, "%s is not finite at t=%.9g s: '%s' is %g", kind, time, block_names[first + i],
                             values[i]);
    return CORE_OK;
}

static double sample_instant(const CoreState *s) {
    return s->start_time + (double)s->sample_index * BLOCK_SAMPLE_TIME; /* counted: no drift */
}

static int sample_is_due(const CoreState *s) { return sample_instant(s) <= s->time + SAMPLE_TOLERANCE; }

/* Outputs follow the inputs at once, except those of a sampled block between its samples. */
static int outputs_are_live(const CoreState *s) {
    return !BLOCK_SAMPLED || (s->mode != MODE_CONTINUOUS && sample_is_due(s));
}

APART static int refresh_start(Core *core) {
    CoreState *s = &core->state;
    if (!s->start_stale) return CORE_OK;
    core->arguments[0] = s->values + INPUT_FIRST;
    core->arguments[1] = s->values + PARAMETER_FIRST;
    core->results[0] = s->values + STATE_FIRST;
    if (evaluate(core, block_start, "start")) return CORE_ERROR;
    s->start_stale = 0;
    return CORE_OK;
}

APART static int refresh_outputs(Core *core) {
    CoreState *s = &core->state;
    if (refresh_start(core)) return CORE_ERROR;
    if (!s->outputs_stale) return CORE_OK;
    if (outputs_are_live(s)) {
        if (evaluate_output(core, s->values + OUTPUT_FIRST)) return CORE_ERROR;
    } else {
        memcpy(s->values + OUTPUT_FIRST, s->held, OUTPUT_COUNT * sizeof(double));
    }
    s->outputs_stale = s->ready_stale = 0;
    return CORE_OK;
}

#if READY_COUNT
/* The first outputs, which no input reaches, without the others: what a controller reads at each tick. */
APART static int refresh_ready(Core *core) {
    CoreState *s = &core->state;
    if (refresh_start(core)) return CORE_ERROR;
    if (!s->ready_stale) return CORE_OK;
    core->arguments[0] = s->values + STATE_FIRST;
    core->arguments[1] = s->values + PARAMETER_FIRST;
    core->results[0] = s->values + OUTPUT_FIRST;
    if (evaluate(core, block_ready, "output")) return CORE_ERROR;
    s->ready_stale = 0;
    return CORE_OK;
}
#endif

APART static int refresh_derivatives(Core *core) {
    CoreState *s = &core->state;
    if (BLOCK_SAMPLED || refresh_start(core)) return BLOCK_SAMPLED ? CORE_OK : CORE_ERROR;
    if (!s->derivatives_stale) return CORE_OK;
    if (evaluate_update(core, s->values + STATE_FIRST, s->values + DERIVATIVE_FIRST)) return CORE_ERROR;
    s->derivatives_stale = 0;
    return CORE_OK;
}

APART static int refresh_rate(Core *core) {
    CoreState *s = &core->state;
    if (!s->rate_stale) return CORE_OK;
    core->arguments[0] = s->values + STATE_FIRST;
    core->arguments[1] = s->values + PARAMETER_FIRST;
    core->results[0] = s->rates;
    if (evaluate(core, block_rate, "rate bound")) return CORE_ERROR;
    s->rate_stale = 0;
    return CORE_OK;
}

static void values_changed(CoreState *s) { s->outputs_stale = s->ready_stale = s->derivatives_stale = 1; }

/* What the last step has led to, before anybody takes it. */
APART static int refresh_after_step(Core *core) {
    CoreState *s = &core->state;
    if (refresh_outputs(core)) return CORE_ERROR;
    if (BLOCK_SAMPLED || s->mode != MODE_STEP) return CORE_OK;
    return check_finite(core, OUTPUT_FIRST, OUTPUT_COUNT, s->values + OUTPUT_FIRST, "the output", s->time);
}

/* ---- variables ----------------------------------------------------------------------------- */

static int is_tolerance(unsigned int reference) { return !BLOCK_SAMPLED && reference == TOLERANCE_REFERENCE; }

static int core_get(Core *core, const unsigned int references[], size_t count, double values[]) {
    const CoreState *s = &core->state;
    for (size_t i = 0; i < count; ++i) {
        const unsigned int reference = references[i];
        int status = CORE_OK;
        if (reference >= VALUE_COUNT) {
            if (is_tolerance(reference)) {
                values[i] = s->tolerance;
                continue;
            }
            return core_fail(core, "there is no floating-point variable with value reference %u; the largest is %d",
                             reference, VALUE_COUNT - 1);
        }
#if READY_COUNT
        if (reference >= OUTPUT_FIRST && reference < OUTPUT_FIRST + READY_COUNT) {
            if (s->ready_stale || s->start_stale) status = refresh_ready(core);
        } else
#endif
        if (reference >= OUTPUT_FIRST && reference < STATE_FIRST) {
            if (s->outputs_stale || s->start_stale) status = refresh_after_step(core);
        } else if (reference >= STATE_FIRST && reference < PARAMETER_FIRST) {
            if (s->start_stale) status = refresh_start(core);
        } else if (reference >= DERIVATIVE_FIRST) {
            if (s->derivatives_stale || s->start_stale) status = refresh_derivatives(core);
        }
        if (status) return status;
        values[i] = s->values[reference];
    }
    return CORE_OK;
}

static int is_state(unsigned int reference) { return reference >= STATE_FIRST && reference < PARAMETER_FIRST; }

static int core_set(Core *core, const unsigned int references[], size_t count, const double values[]) {
    CoreState *s = &core->state;
    const int initializing = s->mode == MODE_INSTANTIATED || s->mode == MODE_INITIALIZATION;
    /* In model exchange the solver owns the states, and some tools (CasADi) set them one by one. */
    const int exchanging = !BLOCK_SAMPLED && (s->mode == MODE_EVENT || s->mode == MODE_CONTINUOUS);
    for (size_t i = 0; i < count; ++i) {
        const unsigned int reference = references[i];
        if (reference >= VALUE_COUNT) {
            if (is_tolerance(reference)) {
                if (core_set_tolerance(core, 0, values[i])) return CORE_ERROR;
                continue;
            }
            return core_fail(core, "there is no floating-point variable with value reference %u; the largest is %d",
                             reference, VALUE_COUNT - 1);
        }
        if (reference >= PARAMETER_FIRST && reference < DERIVATIVE_FIRST) {
            if (!initializing && block_parameter_fixed[reference - PARAMETER_FIRST])
                return core_fail(core, "parameter '%s' (value reference %u) is fixed: set it before the end of "
                                 "the initialization mode, or reset the instance", block_names[reference], reference);
            s->rate_stale = 1;
        } else if (reference >= OUTPUT_FIRST && !(exchanging && is_state(reference))) {
            return core_fail(core, "variable '%s' (value reference %u) is calculated and cannot be set",
                             block_names[reference], reference);
        }
        s->values[reference] = values[i];
        values_changed(s);
        if (initializing) s->start_stale = 1;
    }
    return CORE_OK;
}

static int core_set_substeps(Core *core, int substeps) {
    CoreState *s = &core->state;
    if (s->mode != MODE_INSTANTIATED && s->mode != MODE_INITIALIZATION)
        return core_fail(core, "parameter 'substeps' is fixed: set it before the end of the initialization mode");
    if (substeps < 0 || substeps > BLOCK_MAXIMUM_SUBSTEPS)
        return core_fail(core, "parameter 'substeps' is %d; valid: 0 (automatic) to %d", substeps,
                         BLOCK_MAXIMUM_SUBSTEPS);
    s->substeps = substeps;
    return CORE_OK;
}

static int core_set_tolerance(Core *core, int stated, double tolerance) {
    CoreState *s = &core->state;
    if (s->mode != MODE_INSTANTIATED && s->mode != MODE_INITIALIZATION)
        return core_fail(core, "parameter 'relative_tolerance' is fixed: set it before the end of the initialization "
                         "mode");
    if (tolerance != 0.0 && !(tolerance >= BLOCK_FINEST_TOLERANCE && isfinite(tolerance)))
        return core_fail(core, "the relative tolerance is %g; valid: 0 (automatic) and numbers from %g", tolerance,
                         BLOCK_FINEST_TOLERANCE);
    *(stated ? &s->stated_tolerance : &s->tolerance) = tolerance;
    return CORE_OK;
}

static int core_set_time(Core *core, double time) {
    CoreState *s = &core->state;
    if (!isfinite(time)) return core_fail(core, "the time is not a finite number");
    s->time = time;
    if (s->mode == MODE_INSTANTIATED) s->start_time = time;
    if (BLOCK_SAMPLED) s->outputs_stale = 1; /* live or held depends on the time */
    return CORE_OK;
}

static void core_set_mode(Core *core, CoreMode mode) {
    /* A stopped instance keeps its outputs as they were last seen. */
    if (BLOCK_SAMPLED && mode != MODE_TERMINATED) core->state.outputs_stale = 1;
    core->state.mode = mode;
}

static int core_check_mode(Core *core, int allowed_modes, const char *function) {
    static const char *const mode_names[] = {"the instantiated state", "initialization mode", "step mode",
                                             "event mode", "continuous-time mode", "the terminated state"};
    const int mode = core->state.mode;
    if (allowed_modes & MODE_BIT(mode)) return CORE_OK;
    return core_fail(core, "%s is not allowed in %s", function, mode_names[mode]);
}

/* ---- simulation ---------------------------------------------------------------------------- */

static int core_finish_initialization(Core *core) {
    CoreState *s = &core->state;
    if (refresh_start(core)) return CORE_ERROR;
    if (check_finite(core, STATE_FIRST, STATE_COUNT, s->values + STATE_FIRST, "the initial state", s->time))
        return CORE_ERROR;
    s->rate_stale = 1; /* the bound belongs to the final initial state */
    return refresh_rate(core);
}

/* By how many times twice the substeps a method comes from the error of the rule to the tolerance asked for. */
static int doublings(const CoreState *s, double refinement) {
    const double tolerance = s->tolerance > 0.0 ? s->tolerance : s->stated_tolerance;
    int count = 0;
    if (tolerance > 0.0)
        for (double error = BLOCK_TOLERANCE; error > tolerance; error /= refinement) ++count;
    return count;
}

/* Whether RK4 costs less than linearly implicit steps of the same accuracy. It does not depend on the step, so that a run
 * does not change its method from one step to the next. */
static int is_explicit(const CoreState *s) {
#if BLOCK_IMPLICIT
    if (s->substeps > 0) return 0;
    return ldexp(BLOCK_EXPLICIT_COST * s->rates[0], doublings(s, BLOCK_REFINEMENT_EXPLICIT)) <=
           ldexp(s->rates[1], doublings(s, BLOCK_REFINEMENT_IMPLICIT));
#else
    (void)s;
    return 1;
#endif
}

/* The power of two >= step * rate / BLOCK_SUBSTEP_RATE: `choose_steps` of fmu_didim/dynamics/block.py. Its error stays
 * below BLOCK_TOLERANCE, and twice the substeps divide it by the refinement of the method. */
static int choose_steps(Core *core, double step, int *substeps, int *explicit_steps) {
    CoreState *s = &core->state;
    if (s->substeps == 0 && refresh_rate(core)) return CORE_ERROR; /* a tunable parameter was changed */
    *explicit_steps = is_explicit(s);
    *substeps = s->substeps;
    if (s->substeps > 0) return CORE_OK;
    const double rate = s->rates[*explicit_steps ? 0 : RATE_COUNT - 1], wanted = step * rate / BLOCK_SUBSTEP_RATE;
    int count = *explicit_steps ? BLOCK_FEWEST_EXPLICIT : BLOCK_FEWEST_IMPLICIT;
    while (count < wanted && count < BLOCK_MAXIMUM_SUBSTEPS) count *= 2;
    if (!(wanted <= count)) /* written so that a NaN fails */
        return core_fail(core, "the communication step of %.6g s at t=%.9g s needs %.6g substeps (fastest rate %.6g "
                         "1/s), more than the largest number of %d: use a shorter step, softer parameters, or set "
                         "'substeps'", step, s->time, wanted, rate, BLOCK_MAXIMUM_SUBSTEPS);
    *substeps = count << doublings(s, *explicit_steps ? BLOCK_REFINEMENT_EXPLICIT : BLOCK_REFINEMENT_IMPLICIT);
    return CORE_OK;
}

#if BLOCK_IMPLICIT
/* Equal substeps of the linearly implicit method of fmu_didim/dynamics/linearly_implicit.py, constant input. */
static int implicit_steps(Core *core, double h, int substeps) {
    double *x = core->state.values + STATE_FIRST, *memory = core->state.memory;
    for (int n = 0; n < substeps; ++n) {
        core->arguments[0] = x;
        core->arguments[1] = memory;
        core->arguments[2] = core->state.values + INPUT_FIRST;
        core->arguments[3] = core->state.values + PARAMETER_FIRST;
        core->arguments[4] = &h;
        core->results[0] = core->stage;
        core->results[1] = core->remembered;
        if (evaluate(core, block_step, "implicit step")) return CORE_ERROR;
        memcpy(x, core->stage, STATE_COUNT * sizeof(double));
        memcpy(memory, core->remembered, MEMORY_COUNT * sizeof(double));
    }
    return CORE_OK;
}
#endif

/* Classical Runge-Kutta of fourth order with equal substeps and constant input. */
static int runge_kutta_steps(Core *core, double h, int substeps) {
    double *x = core->state.values + STATE_FIRST;
    double *k = core->slope, *sum = core->slope_sum, *stage = core->stage;
    for (int n = 0; n < substeps; ++n) {
        if (evaluate_update(core, x, k)) return CORE_ERROR;
        for (int i = 0; i < STATE_COUNT; ++i) {
            sum[i] = k[i];
            stage[i] = x[i] + 0.5 * h * k[i];
        }
        if (evaluate_update(core, stage, k)) return CORE_ERROR;
        for (int i = 0; i < STATE_COUNT; ++i) {
            sum[i] += 2.0 * k[i];
            stage[i] = x[i] + 0.5 * h * k[i];
        }
        if (evaluate_update(core, stage, k)) return CORE_ERROR;
        for (int i = 0; i < STATE_COUNT; ++i) {
            sum[i] += 2.0 * k[i];
            stage[i] = x[i] + h * k[i];
        }
        if (evaluate_update(core, stage, k)) return CORE_ERROR;
        for (int i = 0; i < STATE_COUNT; ++i) x[i] += h / 6.0 * (sum[i] + k[i]);
    }
    return CORE_OK;
}

static int integrate(Core *core, double step) {
    int substeps, explicit_steps;
    if (choose_steps(core, step, &substeps, &explicit_steps)) return CORE_ERROR;
#if BLOCK_IMPLICIT
    if (!explicit_steps) return implicit_steps(core, step / substeps, substeps);
    memset(core->state.memory, 0, sizeof(core->state.memory)); /* RK4 remembers nothing */
#endif
    return runge_kutta_steps(core, step / substeps, substeps);
}

/* One sample of a sampled block: hold the outputs, go to the next state, wait for the next sample. */
APART static int sample(Core *core) {
    CoreState *s = &core->state;
    const double time = sample_instant(s);
    if (evaluate_output(core, s->held)) return CORE_ERROR;
    if (evaluate_update(core, s->values + STATE_FIRST, core->stage)) return CORE_ERROR;
    memcpy(s->values + STATE_FIRST, core->stage, STATE_COUNT * sizeof(double));
    s->sample_index += 1;
    s->outputs_stale = 1;
    if (check_finite(core, OUTPUT_FIRST, OUTPUT_COUNT, s->held, "the output", time)) return CORE_ERROR;
    return check_finite(core, STATE_FIRST, STATE_COUNT, s->values + STATE_FIRST, "the state", time);
}

static int core_step(Core *core, double time, double step) {
    CoreState *s = &core->state;
    const double end = time + step; /* as the master computes it; nothing is accumulated here */
    if (!isfinite(end) || step < 0.0)
        return core_fail(core, "a step of %g s from t=%g s is not possible", step, time);
    if (BLOCK_SAMPLED) {
        while (sample_instant(s) < end - SAMPLE_TOLERANCE)
            if (sample(core)) return CORE_ERROR;
        s->time = end;
        s->outputs_stale = 1;
        return CORE_OK;
    }
    if (step > 0.0 && integrate(core, step)) return CORE_ERROR;
    s->time = end;
    values_changed(s);
    return check_finite(core, STATE_FIRST, STATE_COUNT, s->values + STATE_FIRST, "the state", end);
}

/* In model exchange a sample is taken in the first iteration at its instant: the next one is then
 * due a period later, so further iterations at the same instant find nothing to do. */
static int core_event(Core *core, double *next_event_time) {
    CoreState *s = &core->state;
    if (!BLOCK_SAMPLED) return CORE_OK;
    while (sample_is_due(s))
        if (sample(core)) return CORE_ERROR;
    *next_event_time = sample_instant(s);
    return CORE_OK;
}

static int core_derivatives(Core *core, const double **derivatives) {
    *derivatives = core->state.values + DERIVATIVE_FIRST;
    return refresh_derivatives(core);
}

static int core_set_states(Core *core, const double states[]) {
    memcpy(core->state.values + STATE_FIRST, states, STATE_COUNT * sizeof(double));
    values_changed(&core->state);
    return CORE_OK;
}

/* ---- directional derivatives --------------------------------------------------------------- */

#if BLOCK_DIRECTIONAL
/* Knowns are inputs, parameters and states; before the end of the initialization the states are
 * not known but follow from inputs and parameters. Unknowns are outputs and derivatives (for a
 * sampled block: outputs and next states), before the end of the initialization the states too. */
static int core_directional(Core *core, const unsigned int unknowns[], size_t unknown_count,
                            const unsigned int knowns[], size_t known_count, const double known_seeds[],
                            double unknown_sensitivities[]) {
    CoreState *s = &core->state;
    const int initializing = s->mode == MODE_INSTANTIATED || s->mode == MODE_INITIALIZATION;
    const double *seed = core->seed;
    double *sensitivity = core->sensitivity;
    if (refresh_start(core)) return CORE_ERROR;
    memset(core->seed, 0, sizeof(core->seed));
    memset(sensitivity, 0, sizeof(core->sensitivity));
    for (size_t i = 0; i < known_count; ++i) {
        const unsigned int r = knowns[i];
        const int is_input = r < OUTPUT_FIRST;
        const int is_parameter = r >= PARAMETER_FIRST && r < DERIVATIVE_FIRST;
        if (!(is_input || is_parameter || (is_state(r) && !initializing)))
            return core_fail(core, "value reference %u is not a known of a directional derivative%s", r,
                             is_state(r) ? " in initialization mode" : "");
        core->seed[r] += known_seeds[i];
    }
    for (size_t i = 0; i < unknown_count; ++i) {
        const unsigned int r = unknowns[i];
        const int is_output = r >= OUTPUT_FIRST && r < STATE_FIRST;
        const int is_derivative = r >= DERIVATIVE_FIRST && r < VALUE_COUNT;
        if (!(is_output || is_derivative || (is_state(r) && (initializing || BLOCK_SAMPLED))))
            return core_fail(core, "value reference %u is not an unknown of a directional derivative", r);
    }
    if (initializing) {
        core->arguments[0] = s->values + INPUT_FIRST;
        core->arguments[1] = s->values + PARAMETER_FIRST;
        core->arguments[2] = seed + INPUT_FIRST;
        core->arguments[3] = seed + PARAMETER_FIRST;
        core->results[0] = core->seed + STATE_FIRST;
        if (evaluate(core, block_start_directional, "start sensitivity")) return CORE_ERROR;
    }
    core->arguments[0] = s->values + STATE_FIRST;
    core->arguments[1] = s->values + INPUT_FIRST;
    core->arguments[2] = s->values + PARAMETER_FIRST;
    core->arguments[3] = seed + STATE_FIRST;
    core->arguments[4] = seed + INPUT_FIRST;
    core->arguments[5] = seed + PARAMETER_FIRST;
    core->results[0] = core->state_dot;
    core->results[1] = sensitivity + OUTPUT_FIRST;
    if (evaluate(core, block_directional, "sensitivity")) return CORE_ERROR;
    memcpy(sensitivity + DERIVATIVE_FIRST, core->state_dot, DERIVATIVE_COUNT * sizeof(double));
    memcpy(sensitivity + STATE_FIRST, initializing ? seed + STATE_FIRST : core->state_dot,
           STATE_COUNT * sizeof(double));
    for (size_t i = 0; i < unknown_count; ++i) unknown_sensitivities[i] = sensitivity[unknowns[i]];
    return CORE_OK;
}
#else
static int core_directional(Core *core, const unsigned int unknowns[], size_t unknown_count,
                            const unsigned int knowns[], size_t known_count, const double known_seeds[],
                            double unknown_sensitivities[]) {
    (void)unknowns, (void)unknown_count, (void)knowns, (void)known_count, (void)known_seeds;
    (void)unknown_sensitivities;
    return core_fail(core, "this FMU was built without directional derivatives");
}
#endif

/* ---- saved states -------------------------------------------------------------------------- */

static void core_serialize(const CoreState *state, char bytes[]) {
    memcpy(bytes, BLOCK_GUID, sizeof(BLOCK_GUID));
    memcpy(bytes + sizeof(BLOCK_GUID), state, sizeof(*state));
}

static int core_deserialize(Core *core, const char bytes[], size_t size, CoreState *state) {
    if (size != CORE_SERIALIZED_SIZE || memcmp(bytes, BLOCK_GUID, sizeof(BLOCK_GUID)))
        return core_fail(core, "these %zu bytes are not a state of the FMU '%s' %s", size, BLOCK_NAME, BLOCK_GUID);
    memcpy(state, bytes + sizeof(BLOCK_GUID), sizeof(*state));
    return CORE_OK;
}
