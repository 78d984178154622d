/* Model exchange in C: the equations of an FMU, integrated between two ticks in the same order as model_exchange.py.
   RK4 gives the same bits as there. CVode is that of the library whose functions are handed over; its right-hand side and
   its root function are here, so that no Python stands between the solver and the FMU. */

enum { RK4 = 0, CVODE = 1 };
enum { ENDED = -1, NO_END_OF_EVENTS = -2, NOT_INTEGRATED = -3 };
enum { MOST_EVENT_ITERATIONS = 1000 };
static const double TIME_TOLERANCE = 1e-9; /* of a step: two instants closer than that are one */

typedef struct Part Part;

typedef struct {
    int32_t version, completes, solver, has_next; /* completes: it wants to know of each complete substep */
    void *self;
    void *set_time, *set_states, *get_states, *derive, *indicators, *completed, *enter_event, *enter_continuous, *update;
    int64_t states, indicator_count, substeps;
    double *x, *dx, *stage, *total, *z, *z_before;
    double next_event;
    double *slopes, *held; /* of the inputs, per second, and what they are where the step begins; NULL: they are held */
    double begin;
    void *memory, *vector, *advance, *restart, *stop, *array_of; /* CVode, its vector of states and its functions */
    Part *part;
    int64_t worst;
} Exchange;

typedef struct {
    int needed, terminate, nominals, values, has_next;
    double next_event;
} EventInfo2;

static int set_part(Part *p);
static double *inputs_of(Part *p);
static int64_t input_count_of(const Part *p);

static int set_time(const Exchange *e, double t) { return ((int (*)(void *, double))e->set_time)(e->self, t); }
static int set_states(const Exchange *e, const double *x) {
    return ((int (*)(void *, const double *, size_t))e->set_states)(e->self, x, (size_t)e->states);
}
static int get_states(const Exchange *e, double *x) {
    return ((int (*)(void *, double *, size_t))e->get_states)(e->self, x, (size_t)e->states);
}
static int derive(const Exchange *e, double *dx) {
    return ((int (*)(void *, double *, size_t))e->derive)(e->self, dx, (size_t)e->states);
}
static int indicators(const Exchange *e, double *z) {
    return ((int (*)(void *, double *, size_t))e->indicators)(e->self, z, (size_t)e->indicator_count);
}
static int call(const Exchange *e, void *function) { return ((int (*)(void *))function)(e->self); }

#define CHECKED(what)                  \
    do {                               \
        int status_ = (what);          \
        if (status_ > 1) return status_; \
    } while (0)

/* The inputs at an instant, on straight lines from where the step began. */
static int inputs_at(const Exchange *e, double t) {
    if (!e->slopes) return 0;
    double *inputs = inputs_of(e->part), late = t - e->begin;
    for (int64_t i = 0; i < input_count_of(e->part); i++) inputs[i] = e->held[i] + e->slopes[i] * late;
    return set_part(e->part);
}

static int event_iteration(Exchange *e) {
    for (int64_t i = 0; i < MOST_EVENT_ITERATIONS; i++) {
        if (e->version == 2) {
            EventInfo2 info = {0};
            CHECKED(((int (*)(void *, EventInfo2 *))e->update)(e->self, &info));
            e->has_next = info.has_next, e->next_event = info.next_event;
            if (info.terminate) return ENDED;
            if (!info.needed) return 0;
        } else {
            bool needed = false, terminate = false, nominals = false, values = false, has_next = false;
            double next = 0.0;
            CHECKED(((int (*)(void *, bool *, bool *, bool *, bool *, bool *, double *))e->update)(
                e->self, &needed, &terminate, &nominals, &values, &has_next, &next));
            e->has_next = has_next, e->next_event = next;
            if (terminate) return ENDED;
            if (!needed) return 0;
        }
    }
    return NO_END_OF_EVENTS;
}

static int leave_event_mode(Exchange *e) {
    int result = event_iteration(e);
    if (result > 1 || result < 0) return result;
    CHECKED(call(e, e->enter_continuous));
    if (e->states) CHECKED(get_states(e, e->x));
    if (e->indicator_count) CHECKED(indicators(e, e->z));
    return 0;
}

/* Tell the FMU that a substep is complete; whether it or an indicator asks for an event. */
static int look_for_event(Exchange *e, bool *found) {
    *found = false;
    if (e->completes) {
        int enter2 = 0, end2 = 0;
        bool enter3 = false, end3 = false;
        if (e->version == 2) {
            CHECKED(((int (*)(void *, int, int *, int *))e->completed)(e->self, 1, &enter2, &end2));
        } else {
            CHECKED(((int (*)(void *, bool, bool *, bool *))e->completed)(e->self, true, &enter3, &end3));
        }
        if (end2 || end3) return ENDED;
        *found = enter2 || enter3;
    }
    if (e->indicator_count) {
        memcpy(e->z_before, e->z, (size_t)e->indicator_count * sizeof(double));
        CHECKED(indicators(e, e->z));
        for (int64_t i = 0; i < e->indicator_count; i++) *found = *found || (e->z[i] > 0) != (e->z_before[i] > 0);
    }
    return 0;
}

static int runge_kutta(Exchange *e, double time, double end) {
    const int64_t n = e->states;
    const double h = end - time, parts[3] = {h / 2, h / 2, h}, weights[3] = {2.0, 2.0, 1.0};
    if (!n) {
        CHECKED(set_time(e, end));
        return inputs_at(e, end);
    }
    CHECKED(derive(e, e->dx));
    for (int64_t i = 0; i < n; i++) e->total[i] = e->dx[i];
    for (int k = 0; k < 3; k++) {
        for (int64_t i = 0; i < n; i++) e->stage[i] = e->dx[i] * parts[k] + e->x[i];
        CHECKED(set_time(e, time + parts[k]));
        CHECKED(inputs_at(e, time + parts[k]));
        CHECKED(set_states(e, e->stage));
        CHECKED(derive(e, e->dx));
        for (int64_t i = 0; i < n; i++) e->total[i] += e->dx[i] * weights[k];
    }
    for (int64_t i = 0; i < n; i++) e->x[i] = e->total[i] * (h / 6) + e->x[i];
    CHECKED(set_time(e, end));
    CHECKED(inputs_at(e, end));
    return set_states(e, e->x);
}

static int integrate_rk4(Exchange *e, double start, double target, double size, double *reached) {
    double wanted = (double)e->substeps * (target - start) / size - TIME_TOLERANCE;
    int64_t count = (int64_t)wanted + ((double)(int64_t)wanted < wanted);
    if (count < 1 || !(e->states || e->indicator_count)) count = 1;
    const double h = (target - start) / (double)count;
    for (int64_t i = 0; i < count; i++) {
        const double now = i + 1 == count ? target : start + (double)(i + 1) * h;
        bool event;
        CHECKED(runge_kutta(e, start + (double)i * h, now));
        int result = look_for_event(e, &event);
        if (result > 1 || result < 0) return result;
        if (event) {
            *reached = now;
            return 0;
        }
    }
    *reached = target;
    return 0;
}

static inline bool is_finite(double x) { return x - x == 0.0; }

static int noted(Exchange *e, int status) {
    if (status > e->worst) e->worst = status;
    return status > 2 ? -1 : status > 1; /* what is discarded may be tried by a shorter step */
}

static double *array_of(const Exchange *e, void *vector) { return ((double *(*)(void *))e->array_of)(vector); }

static int place(Exchange *e, double t, void *y) {
    int status = set_time(e, t), other = inputs_at(e, t);
    if (other > status) status = other;
    if (status <= 1 && (other = set_states(e, array_of(e, y))) > status) status = other;
    return noted(e, status);
}

/* The callbacks of CVode; data: the Exchange. */
EXPORT int exchange_rhs(double t, void *y, void *ydot, void *data) {
    Exchange *e = data;
    double *dx = array_of(e, ydot);
    int result = place(e, t, y);
    if (!result) result = noted(e, derive(e, dx));
    for (int64_t i = 0; !result && i < e->states; i++)
        if (!is_finite(dx[i])) result = 1;
    return result;
}

EXPORT int exchange_roots(double t, void *y, double *found, void *data) {
    Exchange *e = data;
    const int result = place(e, t, y);
    return result ? result : noted(e, indicators(e, found));
}

static int integrate_cvode(Exchange *e, double start, double target, double *reached) {
    double *y = array_of(e, e->vector), now = start;
    memcpy(y, e->x, (size_t)e->states * sizeof(double));
    e->worst = 0;
    int flag = ((int (*)(void *, double, void *))e->restart)(e->memory, start, e->vector);
    if (flag >= 0) flag = ((int (*)(void *, double))e->stop)(e->memory, target);
    if (flag >= 0) flag = ((int (*)(void *, double, void *, double *, int))e->advance)(e->memory, target, e->vector, &now, 1);
    if (flag < 0) return e->worst > 1 ? (int)e->worst : NOT_INTEGRATED;
    const bool root = flag == 2;
    if (now > target) now = target;
    memcpy(e->x, y, (size_t)e->states * sizeof(double));
    CHECKED(set_time(e, now));
    CHECKED(inputs_at(e, now));
    CHECKED(set_states(e, e->x));
    bool event;
    int result = look_for_event(e, &event);
    if (result > 1 || result < 0) return result;
    *reached = root || event ? now : target;
    return 0;
}

static int exchange_step(Exchange *e, double time, double size) {
    const double end = time + size, tolerance = TIME_TOLERANCE * size;
    double now = time;
    e->begin = time;
    if (e->slopes) memcpy(e->held, inputs_of(e->part), (size_t)input_count_of(e->part) * sizeof(double));
    int result = leave_event_mode(e);
    if (result > 1 || result < 0) return result;
    while (end - now > tolerance) {
        double target = end;
        if (e->has_next && e->next_event > now + tolerance && e->next_event < end - tolerance) target = e->next_event;
        result = e->solver == CVODE && e->states ? integrate_cvode(e, now, target, &now)
                                                 : integrate_rk4(e, now, target, size, &now);
        if (result > 1 || result < 0) return result;
        if (now < end - tolerance) {
            CHECKED(call(e, e->enter_event));
            result = leave_event_mode(e);
            if (result > 1 || result < 0) return result;
        }
    }
    if (e->has_next && e->next_event - end <= tolerance && end - e->next_event <= tolerance)
        CHECKED(set_time(e, e->next_event)); /* t0 + k h is not exactly the instant of the event */
    return call(e, e->enter_event);
}
