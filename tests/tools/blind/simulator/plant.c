/* One robot of one or two revolute joints in a plane, with its controller and the effects that may be hidden in it.
 *
 * Integrated by the pair of Dormand and Prince (1980), steps chosen from its error estimate, and restarted wherever an
 * input jumps; dry friction is a sign rounded over EPS rad/s (effects.h). The equations are written by hand. Inside, both joints
 * turn counter-clockwise; sign[j] turns a joint of the case into that.
 */
#include <math.h>
#include <string.h>
#include "fields.h"
#include "effects.h"

#if defined(_WIN32)
#define VISIBLE __declspec(dllexport)
#else
#define VISIBLE __attribute__((visibility("default")))
#endif

#define JOINTS 2
#define PER_JOINT 10 /* q, v, motor q, motor v, lag, second lag, three friction states, heat */
#define STATES (JOINTS * PER_JOINT)
#define HISTORY 64
#define TINY 1e-9
#define FARTHEST 100.0 /* rad: beyond it the loop has diverged */
#define MOST_STEPS 100000 /* in one piece of a control period */

typedef struct {
    int n;
    const double *g;    /* GLOBAL_COUNT values of the robot and its environment */
    const double *f[JOINTS];
    double tau[JOINTS]; /* torque of the motor at this instant, without the lag */
    double t;
    int fresh;
    double load[JOINTS];
    double a[JOINTS];   /* accelerations of the links at the last evaluation */
    double turned[JOINTS]; /* positions of the last reversals, as seen at the ticks of the control */
} Plant;

/* Rates of all states; y in the counter-clockwise convention. */
static void rates(Plant *p, double t, const double *y, double *dy) {
    const double *g = p->g;
    int n = p->n;
    double q1 = y[0], v1 = y[1], q2 = n > 1 ? y[PER_JOINT] : 0.0, v2 = n > 1 ? y[PER_JOINT + 1] : 0.0;
    double zz1 = g[ZZ1R], mx1 = g[MX1], my1 = g[MY1], zz2 = n > 1 ? g[ZZ2] : 0.0, mx2 = n > 1 ? g[MX2] : 0.0;
    double my2 = n > 1 ? g[MY2] : 0.0, l1 = g[LENGTH], gx = g[GRAVITY_X], gy = g[GRAVITY_Y];
    if (g[PAYLOAD] != 0.0) {
        double m = g[PAYLOAD] * 0.5 * (1.0 + tanh((t - g[PAYLOAD_TIME]) / 0.05)), r = g[PAYLOAD_LENGTH];
        if (n > 1) zz2 += m * r * r, mx2 += m * r, zz1 += m * l1 * l1, mx1 += m * l1;
        else zz1 += m * r * r, mx1 += m * r;
    }
    double c = cos(q2), s = sin(q2), A = l1 * (mx2 * c - my2 * s), B = l1 * (mx2 * s + my2 * c);
    double M11 = zz1 + (n > 1 ? zz2 + 2.0 * A : 0.0), M12 = zz2 + A, M22 = zz2;
    double c1 = cos(q1), s1 = sin(q1), c12 = cos(q1 + q2), s12 = sin(q1 + q2);
    /* Minus the derivative of g . (first moments): gravity's torque on the inverse side. */
    double g2 = gx * (mx2 * s12 + my2 * c12) - gy * (mx2 * c12 - my2 * s12);
    double g1 = gx * (mx1 * s1 + my1 * c1) - gy * (mx1 * c1 - my1 * s1) + g2;
    double bias[JOINTS] = {g1 - B * (2.0 * v1 * v2 + v2 * v2), g2 + B * v1 * v1};
    double applied[JOINTS], push[JOINTS], rotor[JOINTS] = {0.0, 0.0};
    int flexible[JOINTS] = {0, 0};
    memset(dy, 0, sizeof(double) * STATES);
    for (int j = 0; j < n; j++) {
        const double *f = p->f[j];
        const double *x = y + j * PER_JOINT;
        double *dx = dy + j * PER_JOINT;
        flexible[j] = f[GEAR_STIFFNESS] > 0.0;
        rotor[j] = f[ROTOR];
        if (flexible[j] && j == 0) M11 -= rotor[0]; /* ZZ1R holds the rotor */
        if (!flexible[j] && j == 1) M22 += rotor[1];
        applied[j] = p->tau[j];
        if (f[LAG] > 0.0) {
            double T = f[LAG] * f[LAG_SPLIT], T2 = f[LAG] - T;
            dx[4] = (p->tau[j] - x[4]) / T;
            applied[j] = x[4];
            if (T2 > 1e-6) {
                dx[5] = (x[4] - x[5]) / T2;
                applied[j] = x[5];
            }
        }
        push[j] = position_torque(f, t, x[0], x[1], y[n > 1 ? (1 - j) * PER_JOINT : 0],
                                  fabs(x[0] - p->turned[j]));
    }
    double a[JOINTS] = {p->a[0], p->a[1]}, load[JOINTS] = {0.0, 0.0}, right[JOINTS];
    int loaded = 0;
    for (int j = 0; j < n; j++) loaded |= p->f[j][LOAD_SHARE] != 0.0;
    /* Load friction depends on the acceleration: a contraction, as its share is far below 1. */
    for (int round = 0; round < (loaded ? 12 : 1); round++) {
        double before0 = a[0], before1 = a[1];
        if (loaded) {
            load[0] = (zz1 + (n > 1 ? zz2 + 2.0 * A : 0.0) - (flexible[0] ? rotor[0] : 0.0)) * a[0] + M12 * (n > 1) * a[1] + bias[0];
            if (n > 1) load[1] = M12 * a[0] + zz2 * a[1] + bias[1];
        }
        for (int j = 0; j < n; j++) {
            const double *f = p->f[j];
            const double *x = y + j * PER_JOINT;
            double *dx = dy + j * PER_JOINT;
            int m = flexible[j] ? 2 : 0;
            double fr = friction(f, t, x[m], x[m + 1], x + 6, dx + 6, load[j]);
            if (flexible[j]) {
                double through = gear(f, x[2], x[3], x[0], x[1]), turn = 1.0;
                if (f[TRANSMISSION] != 0.0) /* no power is lost: the motor feels the torque by how far the link turns */
                    turn += f[TRANSMISSION] * f[TRANSMISSION_NUMBER] *
                            cos(f[TRANSMISSION_NUMBER] * x[2] + f[TRANSMISSION_PHASE]);
                right[j] = through - bias[j] - push[j];
                dx[2] = x[3];
                dx[3] = (applied[j] - fr - turn * through) / rotor[j];
            } else
                right[j] = applied[j] - fr - bias[j] - push[j];
        }
        if (n > 1) {
            double d = M11 * M22 - M12 * M12;
            a[0] = (M22 * right[0] - M12 * right[1]) / d;
            a[1] = (M11 * right[1] - M12 * right[0]) / d;
        } else
            a[0] = right[0] / M11;
        if (fabs(a[0] - before0) + fabs(a[1] - before1) < 1e-10) break;
    }
    for (int j = 0; j < n; j++) {
        dy[j * PER_JOINT] = y[j * PER_JOINT + 1];
        dy[j * PER_JOINT + 1] = a[j];
        p->a[j] = a[j];
    }
}

/* From t to end with a constant command; h is the step to try first and on return that to try next. */
static int advance(Plant *p, double *y, double t, double end, double *h, double tolerance, long *count) {
    static const double C[7] = {0, 0.2, 0.3, 0.8, 8.0 / 9.0, 1, 1};
    static const double B[7][6] = {
        {0},
        {1.0 / 5},
        {3.0 / 40, 9.0 / 40},
        {44.0 / 45, -56.0 / 15, 32.0 / 9},
        {19372.0 / 6561, -25360.0 / 2187, 64448.0 / 6561, -212.0 / 729},
        {9017.0 / 3168, -355.0 / 33, 46732.0 / 5247, 49.0 / 176, -5103.0 / 18656},
        {35.0 / 384, 0, 500.0 / 1113, 125.0 / 192, -2187.0 / 6784, 11.0 / 84}};
    static const double E[7] = {71.0 / 57600, 0, -71.0 / 16695, 71.0 / 1920, -17253.0 / 339200, 22.0 / 525, -1.0 / 40};
    double k[7][STATES], x[STATES];
    int size = p->n * PER_JOINT, first = 1;
    long least = *count;
    while (end - t > 1e-12) {
        double step = *h < end - t ? *h : end - t, worst = 0.0;
        if (first) rates(p, t, y, k[0]);
        for (int i = 1; i < 7; i++) {
            for (int m = 0; m < size; m++) {
                double sum = 0.0;
                for (int l = 0; l < i; l++) sum += B[i][l] * k[l][m];
                x[m] = y[m] + step * sum;
            }
            rates(p, t + C[i] * step, x, k[i]);
        }
        for (int m = 0; m < size; m++) {
            double e = 0.0;
            for (int l = 0; l < 7; l++) e += E[l] * k[l][m];
            double scale = tolerance * (1.0 + fabs(y[m]));
            e = fabs(step * e) / scale;
            if (!(e <= worst)) worst = e; /* also when e is not a number */
        }
        if (!(worst < 1e12) || ++*count - least > MOST_STEPS) return 1;
        if (worst <= 1.0 || step < TINY) {
            t += step;
            memcpy(y, x, sizeof(double) * size);
            memcpy(k[0], k[6], sizeof(k[0]));
            first = 0;
        } else
            first = 0;
        double factor = worst > 0.0 ? 0.9 * pow(worst, -0.2) : 5.0;
        factor = factor > 5.0 ? 5.0 : factor < 0.1 ? 0.1 : factor;
        double next = step * factor;
        /* A step cut short by the end of the interval says nothing against the longer one. */
        if (worst > 1.0 || next > *h || step >= *h) *h = next < TINY ? TINY : next;
    }
    return 0;
}

/* The run: reference qr, vr (N, n) every Ts from time start; outputs (N, n) at the same instants.
 *
 * command: what is logged; q, v, a: motion of the links, a just after the command was applied.
 */
VISIBLE int run(int n, int N, double Ts, double start, const double *qr, const double *vr, const double *gains,
                const double *sign, const double *global, const double *fields, double tolerance, double *command,
                double *q, double *v, double *a, long *count) {
    Plant p = {.n = n, .g = global};
    double y[STATES] = {0}, past[HISTORY][JOINTS] = {{0}}, previous[JOINTS] = {0}, moving[JOINTS] = {0}, h = Ts / 4.0;
    *count = 0;
    for (int j = 0; j < n; j++) {
        p.f[j] = fields + j * FIELD_COUNT;
        double *x = y + j * PER_JOINT;
        x[0] = x[2] = sign[j] * qr[j];
        x[1] = x[3] = sign[j] * vr[j];
        p.turned[j] = x[0];
    }
    for (int k = 0; k < N; k++) {
        double t = start + k * Ts, cut[JOINTS + 1], delayed[JOINTS];
        for (int j = 0; j < n; j++) {
            const double *f = p.f[j], *gain = gains + 3 * j;
            int m = f[GEAR_STIFFNESS] > 0.0 && f[ENCODER_AT_LINK] == 0.0 ? 2 : 0;
            if (!(fabs(y[j * PER_JOINT + m]) < FARTHEST)) return 1;
            double seen = sign[j] * measured(f, y[j * PER_JOINT + m]), step = gain[2];
            if (step > 0.0) seen = step * floor(seen / step + 0.5);
            double rate = k == 0 ? vr[j] : (seen - previous[j]) / Ts;
            previous[j] = seen;
            double u = f[KP_FACTOR] * gain[0] * (qr[k * n + j] - seen) + f[KD_FACTOR] * gain[1] * (vr[k * n + j] - rate);
            if (f[LIMIT] > 0.0 && fabs(u) > f[LIMIT]) u = u > 0.0 ? f[LIMIT] : -f[LIMIT];
            if (f[STALL] > 0.0) { /* what the voltage leaves beside the back electromotive force of the motor */
                double left = sign[j] * y[j * PER_JOINT + (f[GEAR_STIFFNESS] > 0.0 ? 3 : 1)] / f[NO_LOAD_SPEED];
                double high = f[STALL] * (1.0 - left), low = -f[STALL] * (1.0 + left);
                u = u > high ? high : u < low ? low : u;
            }
            command[k * n + j] = u;
            if (k == 0) for (int i = 0; i < HISTORY; i++) past[i][j] = u;
            past[k % HISTORY][j] = u;
            int whole = (int)floor(f[DELAY] / Ts + 1e-9);
            if (whole > HISTORY - 2) return 2;
            cut[j] = f[DELAY] / Ts - whole;
            cut[j] = cut[j] < 1e-9 ? 0.0 : cut[j] * Ts;
            delayed[j] = past[(k - whole + HISTORY) % HISTORY][j];
            double earlier = past[(k - whole - 1 + 2 * HISTORY) % HISTORY][j];
            if (k - whole < 0) delayed[j] = past[0][j];
            if (k - whole - 1 < 0) earlier = past[0][j];
            p.tau[j] = sign[j] * drive(f, cut[j] > 0.0 ? earlier : delayed[j]);
            if (k == 0) y[j * PER_JOINT + 4] = y[j * PER_JOINT + 5] = p.tau[j];
        }
        double dy[STATES];
        for (int j = 0; j < n; j++) {
            const double *x = y + j * PER_JOINT;
            if (x[1] * moving[j] < 0.0) p.turned[j] = x[0];
            if (x[1] != 0.0) moving[j] = x[1];
        }
        rates(&p, t, y, dy);
        for (int j = 0; j < n; j++) {
            q[k * n + j] = sign[j] * y[j * PER_JOINT];
            v[k * n + j] = sign[j] * y[j * PER_JOINT + 1];
            a[k * n + j] = sign[j] * dy[j * PER_JOINT + 1];
        }
        /* Pieces of the period between the instants at which a delayed command changes. */
        double now = 0.0;
        while (now < Ts - 1e-12) {
            double stop = Ts;
            for (int j = 0; j < n; j++)
                if (cut[j] > now + 1e-12 && cut[j] < stop) stop = cut[j];
            if (h < 1e-6) h = 1e-6;
            if (advance(&p, y, t + now, t + stop, &h, tolerance, count)) return 1;
            for (int j = 0; j < n; j++)
                if (cut[j] > 0.0 && fabs(cut[j] - stop) < 1e-12) p.tau[j] = sign[j] * drive(p.f[j], delayed[j]);
            now = stop;
        }
    }
    return 0;
}
