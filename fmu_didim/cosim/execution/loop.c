/* The loop over the ticks for components that are C code: the same order of operations as interpreted.py.
   Every floating-point operation is written as there, so that both give the same bits. */
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#ifdef _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

enum { FMI2 = 2, FMI3 = 3, LINEAR = 10, EXCHANGE2 = 12, EXCHANGE3 = 13 };
enum { DONE = 0, FAILED = 1, STOPPED = 2, OUT_OF_BOUNDS = 3 };
enum { CALL_SET = 0, CALL_GET = 1, CALL_STEP = 2 };
enum { MOST_PLAIN = 16 };

#include "exchange.h"

typedef int (*values2)(void *, const uint32_t *, size_t, double *);
typedef int (*step2)(void *, double, double, int);
typedef int (*values3)(void *, const uint32_t *, size_t, double *, size_t);
typedef int (*step3)(void *, double, double, bool, bool *, bool *, bool *, double *);

typedef struct {
    int64_t states, inputs, outputs;
    const double *a, *b, *c, *d;
    double *x, *held, *work; /* work: six vectors of the size of x */
    double period, start;
    int64_t count, substeps;
    int32_t live, padding;
} Linear;

/* values[input] = gain * values[signal], or += where several wires end at one input. */
typedef struct {
    int64_t input, signal;
    double gain;
} Wire;

/* The slope of an input that goes straight from one row of the table to the next: += gain * difference / step. */
typedef struct {
    int64_t input, column;
    double gain;
} Ramp;

struct Part {
    int32_t kind, after_step;
    void *self, *set, *get, *step;
    const uint32_t *input_references, *output_references;
    int64_t input_reference_count, output_reference_count; /* of FMI 3.0: an array is one variable with many values */
    int64_t input_count, output_count;
    double *inputs, *outputs, *own_inputs, *own_outputs;
    const double *input_factor, *input_offset, *output_factor, *output_offset;
    Linear *linear;
    int64_t wire_count;
    const Wire *wires;
    int64_t single;
    int64_t every, substeps, whole;
    double part;
    double *line;
    int64_t line_capacity, line_count;
    int64_t first_input, first_output, next_row;
    /* How many of its first outputs other parts read before its step, those who look at all there, and others after. */
    int64_t read_before, read_between, read_after;
    const double *instants; /* of all ticks, where they are not equally spaced and the part steps with them; else NULL */
    double longest;         /* step beyond which it does several equal ones */
    Exchange *exchange;
    const Ramp *ramps;
    int64_t ramp_count;
};

static double *inputs_of(Part *p) { return p->inputs; }
static int64_t input_count_of(const Part *p) { return p->input_count; }

typedef struct {
    Part *parts;
    int64_t part_count, jacobi, delayed;
    double *values; /* the signals, then the inputs of all parts */
    int64_t signal_count, value_count;
    const double *table;
    int64_t table_rows, table_columns;
    double start, step;
    const int64_t *recorded; /* the ticks to record, increasing; NULL: all from first_recorded on */
    int64_t first_recorded, recorded_count, next_row;
    double *applied, *sampled; /* rows of values; rows of signals */
    int64_t sound_rows, unsound; /* rows looked at already; whether one of them holds what is not finite */
    const double *lowest, *highest;
    int64_t check_interval, ticks, next_check;
    int64_t failed_part, failed_call, status, failed_tick, failed_signal;
    double failed_time;
    const double *instants; /* of all ticks; NULL: start + tick * step */
    double latest;          /* part of a period after which a delayed input acts at the latest */
    int64_t first_row;      /* that applied holds: 0, unless a recording is taken from it after each call */
} Loop;

/* For the few numbers of a component a call of memcpy would cost more than the copy. */
static inline void copy(double *to, const double *from, int64_t count) {
    switch (count) {
        case 6: to[5] = from[5]; /* fall through */
        case 5: to[4] = from[4]; /* fall through */
        case 4: to[3] = from[3]; /* fall through */
        case 3: to[2] = from[2]; /* fall through */
        case 2: to[1] = from[1]; /* fall through */
        case 1: to[0] = from[0]; /* fall through */
        case 0: return;
        default: memcpy(to, from, (size_t)count * sizeof(double));
    }
}

static void outputs_of(Linear *s, double *y) {
    for (int64_t i = 0; i < s->outputs; i++) {
        double value = 0.0;
        for (int64_t j = 0; j < s->states; j++) value += s->c[i * s->states + j] * s->x[j];
        double direct = 0.0;
        for (int64_t j = 0; j < s->inputs; j++) direct += s->d[i * s->inputs + j] * s->held[j];
        y[i] = value + direct;
    }
}

static void update_of(const Linear *s, const double *x, double *result) {
    for (int64_t i = 0; i < s->states; i++) {
        double value = 0.0;
        for (int64_t j = 0; j < s->states; j++) value += s->a[i * s->states + j] * x[j];
        double direct = 0.0;
        for (int64_t j = 0; j < s->inputs; j++) direct += s->b[i * s->inputs + j] * s->held[j];
        result[i] = value + direct;
    }
}

static void integrate(Linear *s, double size) {
    int64_t n = s->states;
    double *k1 = s->work, *k2 = k1 + n, *k3 = k2 + n, *k4 = k3 + n, *x = k4 + n, h = size / (double)s->substeps;
    for (int64_t i = 0; i < s->substeps; i++) {
        update_of(s, s->x, k1);
        for (int64_t j = 0; j < n; j++) x[j] = s->x[j] + h / 2 * k1[j];
        update_of(s, x, k2);
        for (int64_t j = 0; j < n; j++) x[j] = s->x[j] + h / 2 * k2[j];
        update_of(s, x, k3);
        for (int64_t j = 0; j < n; j++) x[j] = s->x[j] + h * k3[j];
        update_of(s, x, k4);
        for (int64_t j = 0; j < n; j++) s->x[j] = s->x[j] + h / 6 * (k1[j] + 2 * k2[j] + 2 * k3[j] + k4[j]);
    }
}

static bool is_due(const Linear *s, double time) {
    double ahead = time - (s->start + (double)s->count * s->period);
    return (ahead < 0 ? -ahead : ahead) <= 1e-6 * s->period;
}

static bool is_before(const Linear *s, double time) {
    return s->start + (double)s->count * s->period < time - 1e-6 * s->period;
}

static void sample(Linear *s, double time, double size, double *y) {
    while (is_due(s, time) || is_before(s, time + size)) {
        outputs_of(s, y);
        update_of(s, s->x, s->work);
        memcpy(s->x, s->work, (size_t)s->states * sizeof(double));
        s->count++;
    }
    s->live = is_due(s, time + size);
}

static int set_part(Part *p) {
    if (p->kind == LINEAR) {
        copy(p->linear->held, p->inputs, p->input_count);
        return 0;
    }
    if (!p->set) return 0;
    if (p->input_factor)
        for (int64_t i = 0; i < p->input_count; i++)
            p->own_inputs[i] = (p->inputs[i] - p->input_offset[i]) / p->input_factor[i];
    size_t n = (size_t)p->input_count, variables = (size_t)p->input_reference_count;
    if (p->kind == FMI2 || p->kind == EXCHANGE2) return ((values2)p->set)(p->self, p->input_references, n, p->own_inputs);
    return ((values3)p->set)(p->self, p->input_references, variables, p->own_inputs, n);
}

static inline int get_part(Part *p, int64_t count) {
    if (p->kind == LINEAR) {
        if (p->linear->live) outputs_of(p->linear, p->outputs);
        return 0;
    }
    if (!p->get) return 0;
    const int arrays = p->output_reference_count != p->output_count;
    if (arrays) count = p->output_count; /* the first elements may end within an array: all are read */
    size_t n = (size_t)count, variables = arrays ? (size_t)p->output_reference_count : n;
    int status = p->kind == FMI2 || p->kind == EXCHANGE2
                     ? ((values2)p->get)(p->self, p->output_references, n, p->own_outputs)
                     : ((values3)p->get)(p->self, p->output_references, variables, p->own_outputs, n);
    if (p->output_factor)
        for (int64_t i = 0; i < count; i++)
            p->outputs[i] = p->own_outputs[i] * p->output_factor[i] + p->output_offset[i];
    return status;
}

static inline int step_once(Part *p, double time, double size) {
    if (p->kind == LINEAR) {
        if (p->linear->period > 0)
            sample(p->linear, time, size, p->outputs);
        else
            integrate(p->linear, size);
        return 0;
    }
    if (p->exchange) return exchange_step(p->exchange, time, size);
    if (p->kind == FMI2) return ((step2)p->step)(p->self, time, size, 1);
    bool event = false, stop = false, early = false;
    double last = time;
    int status = ((step3)p->step)(p->self, time, size, true, &event, &stop, &early, &last);
    return status > 1 ? status : (stop || early) ? -1 : status;
}

static inline int64_t whole_above(double x) { return (int64_t)x + ((double)(int64_t)x < x); }

static inline int step_part(Part *p, double time, double size) {
    int64_t count = p->substeps;
    if (size > p->longest) count *= whole_above(size / p->longest);
    if (count == 1) return step_once(p, time, size);
    double piece = size / (double)count;
    for (int64_t i = 0; i < count; i++) {
        int status = step_once(p, time + (double)i * piece, piece);
        if (status > 1 || status < 0) return status;
    }
    return 0;
}

static inline void gather(const Part *p, double *values) {
    const Wire *wire = p->wires, *end = wire + p->wire_count;
    if (p->single) {
        for (; wire < end; wire++) values[wire->input] = wire->gain * values[wire->signal];
        return;
    }
    for (; wire < end; wire++) values[wire->input] = 0.0;
    for (wire = p->wires; wire < end; wire++) values[wire->input] += wire->gain * values[wire->signal];
}

static double *line_at(Part *p, int64_t back) {
    int64_t place = p->line_count - 1 - back;
    if (place < 0) place = 0;
    return p->line + (place % p->line_capacity) * p->input_count;
}

static int broken(Loop *l, int64_t part, int call, int status, int64_t tick, double time) {
    l->failed_part = part, l->failed_call = call, l->status = status, l->failed_tick = tick, l->failed_time = time;
    return status < 0 ? STOPPED : FAILED;
}

#define TRY(call, what)                                                                                   \
    do {                                                                                                  \
        int status_ = (call);                                                                             \
        if ((unsigned)status_ > 1) return broken(l, index, what, status_, tick, time);                    \
    } while (0)

/* The recording and the bounds look at all outputs, before the step; the bounds also after the last one. */
static inline bool all_are_read(const Loop *l, int64_t row, int64_t tick) {
    return row >= 0 || tick == l->next_check || tick + 1 == l->ticks;
}

static inline double time_of(const Loop *l, int64_t tick) {
    return l->instants ? l->instants[tick] : l->start + (double)tick * l->step;
}

/* Where the period of a part from a tick on begins, how much later its inputs act, and the rest of the period. */
typedef struct {
    double begin, late, rest;
} Period;

static inline Period period_of(const Loop *l, const Part *p, int64_t tick) {
    const double size = l->step * (double)p->every;
    if (!p->instants)
        return (Period){l->start + (double)tick * l->step, p->part * size, p->part > 0 ? (1 - p->part) * size : size};
    const double begin = p->instants[tick], end = p->instants[tick + p->every];
    double late = p->part * size;
    if (late > l->latest * (end - begin)) late = l->latest * (end - begin);
    return (Period){begin, late, end - begin - late};
}

static inline int apply_part(Loop *l, int64_t index, int64_t row, int64_t tick) {
    Part *p = &l->parts[index];
    const Period period = period_of(l, p, tick);
    const double time = period.begin;
    if (p->line) {
        size_t bytes = (size_t)p->input_count * sizeof(double);
        memcpy(p->line + (p->line_count % p->line_capacity) * p->input_count, p->inputs, bytes);
        p->line_count++;
        if (p->part > 0) {
            memcpy(p->inputs, line_at(p, p->whole + 1), bytes);
            TRY(set_part(p), CALL_SET);
            TRY(step_part(p, time, period.late), CALL_STEP);
            if (!p->read_between && p->output_count) TRY(get_part(p, p->output_count), CALL_GET);
        }
        memcpy(p->inputs, line_at(p, p->whole), bytes);
    }
    TRY(set_part(p), CALL_SET);
    if (p->after_step) TRY(step_part(p, time + period.late, period.rest), CALL_STEP);
    const int64_t read = all_are_read(l, row, tick) ? p->read_between : p->read_before;
    if (read) TRY(get_part(p, read), CALL_GET);
    return DONE;
}

/* Let the inputs of a part go straight to the next row of the table: by their slopes, or held halfway for components
   that hold them. Behind the last row they stay. */
static int lead_part(const Loop *l, Part *p, int64_t tick) {
    const bool last = tick + 1 >= l->table_rows;
    const double *now = l->table + tick * l->table_columns, *next = now + l->table_columns;
    const Ramp *const end = p->ramps + p->ramp_count;
    if (p->exchange) {
        const double size = last ? 1.0 : time_of(l, tick + 1) - time_of(l, tick);
        memset(p->exchange->slopes, 0, (size_t)p->input_count * sizeof(double));
        for (const Ramp *r = p->ramps; !last && r < end; r++)
            p->exchange->slopes[r->input] += r->gain * (next[r->column] - now[r->column]) / size;
        return 0;
    }
    if (last) return 0;
    for (const Ramp *r = p->ramps; r < end; r++) p->inputs[r->input] += r->gain * (next[r->column] - now[r->column]) / 2;
    return set_part(p);
}

static inline int advance_part(Loop *l, int64_t index, int64_t tick) {
    Part *p = &l->parts[index];
    if (p->after_step || (p->every > 1 && tick % p->every != p->every - 1)) return DONE;
    const Period period = period_of(l, p, tick - p->every + 1);
    const double time = period.begin;
    if (p->ramp_count) TRY(lead_part(l, p, tick), CALL_SET);
    TRY(step_part(p, time + period.late, period.rest), CALL_STEP);
    const int64_t read = tick + 1 == l->ticks ? p->output_count : p->read_after;
    if (read) TRY(get_part(p, read), CALL_GET);
    return DONE;
}

/* The row of a tick, -1 if it is not recorded; asked in the order of the ticks. */
static inline int64_t row_of(const Loop *l, int64_t *next, int64_t tick) {
    if (*next >= l->recorded_count) return -1;
    return tick == (l->recorded ? l->recorded[*next] : l->first_recorded + *next) ? (*next)++ : -1;
}

static inline double *applied_row(const Loop *l, int64_t row) {
    return l->applied + (row - l->first_row) * l->value_count;
}

static void record_delayed(Loop *l, int64_t row, int64_t tick) {
    const int64_t width = l->value_count;
    if (row >= 0) copy(l->applied + row * width, l->values, l->table_columns);
    for (int64_t i = 0; i < l->part_count; i++) {
        Part *p = &l->parts[i];
        const int64_t late = row_of(l, &p->next_row, tick - p->whole * p->every);
        const double *outputs = l->values + p->first_output;
        if (row >= 0 && !p->line)
            copy(l->sampled + row * l->signal_count + p->first_output, outputs, p->output_count);
        if (late < 0) continue;
        copy(l->applied + late * width + p->first_output, outputs, p->output_count);
        copy(l->applied + late * width + p->first_input, p->inputs, p->input_count);
    }
}

/* A division only where there is something to divide: it would cost as much as the rest of a cheap component. */
static bool is_own_tick(const Part *p, int64_t tick) { return p->every == 1 || tick % p->every == 0; }

static int outside(Loop *l, int64_t tick, double time) {
    for (int64_t i = 0; i < l->signal_count; i++)
        if (!(l->values[i] >= l->lowest[i] && l->values[i] <= l->highest[i])) {
            l->failed_signal = i, l->failed_tick = tick, l->failed_time = time;
            return OUT_OF_BOUNDS;
        }
    return DONE;
}

static int look(Loop *l, int64_t tick, double time) {
    l->next_check += l->check_interval; /* counted, as a division a tick would be felt */
    return outside(l, tick, time);
}

/* While the rows are still near: x - x is 0 but for what is not finite. Four sums, as one would wait for itself. */
static void look_at_rows(Loop *l, int64_t end) {
    const double *x = applied_row(l, l->sound_rows);
    const int64_t count = (end - l->sound_rows) * l->value_count;
    double sum[4] = {0};
    int64_t i = 0;
    for (; i + 4 <= count; i += 4)
        for (int j = 0; j < 4; j++) sum[j] += x[i + j] - x[i + j];
    for (; i < count; i++) sum[0] += x[i] - x[i];
    l->unsound |= sum[0] + sum[1] + sum[2] + sum[3] != 0.0, l->sound_rows = end;
}

static int apply_all(Loop *l, int64_t row, int64_t tick) {
    for (int64_t i = 0; l->jacobi && i < l->part_count; i++)
        if (is_own_tick(&l->parts[i], tick)) gather(&l->parts[i], l->values);
    for (int64_t i = 0; i < l->part_count; i++) {
        if (!is_own_tick(&l->parts[i], tick)) continue;
        if (!l->jacobi) gather(&l->parts[i], l->values);
        int result = apply_part(l, i, row, tick);
        if (result) return result;
    }
    return DONE;
}

static int run_any(Loop *l, int64_t first, int64_t last) {
    const int64_t columns = l->table_columns, signals = l->signal_count;
    for (int64_t tick = first; tick < last; tick++) {
        const double time = time_of(l, tick);
        const int64_t row = row_of(l, &l->next_row, tick);
        copy(l->values, l->table + (tick < l->table_rows ? tick : l->table_rows - 1) * columns, columns);
        if (l->delayed && row >= 0) copy(l->sampled + row * signals, l->values, signals);
        int result = apply_all(l, row, tick);
        if (result) return result;
        if (l->delayed)
            record_delayed(l, row, tick);
        else if (row >= 0)
            copy(applied_row(l, row), l->values, l->value_count);
        if (tick == l->next_check && look(l, tick, time)) return OUT_OF_BOUNDS;
        for (int64_t i = 0; i < l->part_count; i++)
            if ((result = advance_part(l, i, tick))) return result;
    }
    return DONE;
}

/* Whether the parts only have to be called: FMI 2.0 in its own units, one step a tick, no delay. */
static bool is_plain(const Loop *l) {
    if (l->jacobi || l->delayed || l->instants || l->part_count > MOST_PLAIN) return false;
    for (int64_t i = 0; i < l->part_count; i++) {
        const Part *p = &l->parts[i];
        if (p->kind != FMI2 || !p->single || p->after_step || p->every > 1 || p->substeps > 1 || p->line || p->ramp_count || p->part > 0 ||
            p->input_factor || p->output_factor || p->own_inputs != p->inputs || p->own_outputs != p->outputs)
            return false;
    }
    return true;
}

/* A part that only has to be called, near together. */
typedef struct {
    const Wire *wires, *wires_end;
    void *self;
    values2 set, get;
    step2 step;
    const uint32_t *input_references, *output_references;
    size_t input_count, output_count, read_before, read_between, read_after;
    double *inputs, *outputs;
} Plain;

static Plain plain_of(const Part *p) {
    const size_t none = p->get ? 1 : 0;
    return (Plain){p->wires, p->wires + p->wire_count, p->self, (values2)p->set, (values2)p->get, (step2)p->step,
                   p->input_references, p->output_references, (size_t)p->input_count, none * (size_t)p->output_count,
                   none * (size_t)p->read_before, none * (size_t)p->read_between, none * (size_t)p->read_after,
                   p->inputs, p->outputs};
}

/* The same as run_any without asking at each tick what is known before. */
static int run_plain(Loop *l, int64_t first, int64_t last) {
    const int64_t columns = l->table_columns, width = l->value_count, count = l->part_count;
    const int64_t *const recorded = l->recorded;
    const double start = l->start, step = l->step, *given = l->table + first * columns;
    double *const values = l->values;
    Plain plain[MOST_PLAIN];
    for (int64_t i = 0; i < count; i++) plain[i] = plain_of(&l->parts[i]);
    /* Known here, as what a called FMU might change must be read again after each call. */
    const int64_t first_recorded = l->first_recorded, ticks = l->ticks;
    int64_t next_check = l->next_check, index = 0;
    double *row = applied_row(l, l->next_row);
    for (int64_t tick = first; tick < last; tick++, given += columns) {
        const double time = start + (double)tick * step;
        const bool due = recorded ? recorded[l->next_row] == tick : tick >= first_recorded;
        const bool checked = tick == next_check, ends = tick + 1 == ticks;
        const bool all = due || checked || ends;
        copy(values, given, columns);
        for (index = 0; index < count; index++) {
            const Plain *p = &plain[index];
            for (const Wire *w = p->wires; w < p->wires_end; w++) values[w->input] = w->gain * values[w->signal];
            const size_t read = all ? p->read_between : p->read_before;
            if (p->set) TRY(p->set(p->self, p->input_references, p->input_count, p->inputs), CALL_SET);
            if (read) TRY(p->get(p->self, p->output_references, read, p->outputs), CALL_GET);
        }
        if (due) copy(row, values, width), row += width, l->next_row++;
        if (checked) {
            if (look(l, tick, time)) return OUT_OF_BOUNDS;
            look_at_rows(l, l->next_row), next_check = l->next_check;
        }
        for (index = 0; index < count; index++) {
            const Plain *p = &plain[index];
            const size_t read = ends ? p->output_count : p->read_after;
            TRY(p->step(p->self, time, step, 1), CALL_STEP);
            if (read) TRY(p->get(p->self, p->output_references, read, p->outputs), CALL_GET);
        }
    }
    return DONE;
}

/* In initialisation values pass around the loop until each part has received those of all others, or none changes any
   more; `before` has room for the signals. The first row of the table is among them already. */
EXPORT int pass_values(Loop *l, double *before) {
    const int64_t tick = 0, count = l->part_count;
    const double time = l->start;
    for (int64_t round = 0; round <= count; round++) {
        bool same = true;
        memcpy(before, l->values, (size_t)l->signal_count * sizeof(double));
        for (int64_t index = 0; index < count; index++) {
            Part *p = &l->parts[index];
            gather(p, l->values);
            TRY(set_part(p), CALL_SET);
            if (p->output_count) TRY(get_part(p, p->output_count), CALL_GET);
        }
        for (int64_t i = 0; i < l->signal_count; i++) same = same && before[i] == l->values[i];
        if (same) break;
    }
    return DONE;
}

/* Ticks first to last - 1; the bounds are looked at as well after the last one of all if `finish` is set. */
EXPORT int run_loop(Loop *l, int64_t first, int64_t last, int64_t finish) {
    int result = is_plain(l) ? run_plain(l, first, last) : run_any(l, first, last);
    if (!result && !l->delayed) look_at_rows(l, l->next_row);
    if (result || !finish) return result;
    look_at_rows(l, l->recorded_count);
    return outside(l, last - 1, time_of(l, last - 1));
}
