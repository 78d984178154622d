/* What acts in one joint: f are its fields, see fields.h. Every function gives a torque of the inverse model. */
#include <math.h>

#define EPS 1e-4 /* rad/s over which the sign of dry friction is rounded */

static double soft_sign(double v) { return tanh(v / EPS); }
static double power(double x, double e) { return x <= 0.0 ? 0.0 : pow(x, e); }

/* A window with edges of a twentieth of its width. */
static double window(double t, double start, double width) {
    double edge = width / 20.0;
    return 0.5 * (tanh((t - start) / edge) - tanh((t - start - width) / edge));
}

static double heat_factor(const double *f, double t) {
    double k = 1.0 - f[CLUTTER_DRIFT] * t;
    if (f[HEAT_SHARE] != 0.0) k -= f[HEAT_SHARE] * t / (t + f[HEAT_TIME]);
    return k;
}

/* Friction of a joint; z are its states, dz their rates; load is the transmitted torque. */
static double friction(const double *f, double t, double q, double v, const double *z, double *dz, double load) {
    double s = soft_sign(v), a = fabs(v), dry = f[FC], sum;
    if (f[POSITION_SHARE] != 0.0)
        dry *= 1.0 + f[POSITION_SHARE] * (cos(q - f[POSITION_PHASE]) + 0.3 * cos(2.0 * (q - f[POSITION_PHASE])));
    sum = dry * s * (1.0 - f[PRESLIDING_SHARE]);
    dz[0] = dz[1] = dz[2] = 0.0;
    if (f[PRESLIDING_SHARE] != 0.0) {
        /* Two Maxwell elements: z is the fraction of the element's limit; it grows only while |z| < 1. */
        const double width[2] = {f[PRESLIDING_LENGTH] * 0.5, f[PRESLIDING_LENGTH] * 2.0}, weight[2] = {0.6, 0.4};
        for (int i = 0; i < 2; i++) {
            double inward = z[i] * v <= 0.0 ? 1.0 : 1.0 - pow(fabs(z[i]), f[PRESLIDING_SHARPNESS]);
            dz[i] = v / width[i] * inward;
            sum += dry * f[PRESLIDING_SHARE] * weight[i] * z[i];
        }
    }
    if (f[LUGRE_LENGTH] > 0.0) {
        double stiffness = dry / f[LUGRE_LENGTH];
        double limit = dry + f[LUGRE_STICTION] * exp(-a / f[LUGRE_VELOCITY]);
        dz[2] = v - stiffness * a / limit * z[2];
        sum += stiffness * z[2] + f[LUGRE_DAMPING] * dz[2] - dry * s;
    }
    sum += f[FV] * v;
    sum *= heat_factor(f, t);
    sum += f[OFFSET] + f[ASYMMETRIC_DRY] * s * s + f[ASYMMETRIC_VISCOUS] * (v > 0.0 ? 2.0 * v : 0.0);
    if (f[POWER_GAIN] != 0.0) sum += f[POWER_GAIN] * s * power(a, f[POWER_EXPONENT]);
    if (f[STRIBECK] != 0.0) sum += f[STRIBECK] * s * exp(-power(a / f[STRIBECK_VELOCITY], f[STRIBECK_EXPONENT]));
    if (f[CLUTTER_STRIBECK] != 0.0) sum += f[CLUTTER_STRIBECK] * s * exp(-(v / 0.1) * (v / 0.1));
    if (f[LOAD_SHARE] != 0.0) sum += f[LOAD_SHARE] * fabs(load) * s;
    return sum;
}

/* A function of one variable that no effect of the catalogue is; CURVE_KIND says of which; moved: since a reversal. */
static double curve(const double *f, double t, double q, double v, double other, double moved) {
    int kind = (int)f[CURVE_KIND];
    if (kind == 6) return soft_sign(v) * moved / f[CURVE_WIDTH] * exp(-moved / f[CURVE_WIDTH]);
    double x = kind == 2 ? v : kind == 3 ? t : kind == 4 ? other : q;
    double u = (x - f[CURVE_PLACE]) / f[CURVE_WIDTH];
    if (kind == 5) return u / (1.0 + u * u); /* a detent: it pulls towards one position, less the farther away */
    return kind == 4 ? u * u * exp(-u * u) : exp(-u * u);
}

/* Torque that depends on position and time only. */
static double position_torque(const double *f, double t, double q, double v, double other, double moved) {
    double sum = 0.0;
    sum += f[RIPPLE_SINE] * sin(f[RIPPLE_NUMBER] * q) + f[RIPPLE_COSINE] * cos(f[RIPPLE_NUMBER] * q);
    sum += f[CLUTTER_RIPPLE] * sin(f[CLUTTER_NUMBER] * q);
    if (f[SPRING] != 0.0) {
        double x = q - f[SPRING_REST];
        sum += f[SPRING] * x * (1.0 + f[SPRING_CUBIC] * x * x);
    }
    if (f[STOP] != 0.0 && q > f[STOP_POSITION]) {
        double depth = q - f[STOP_POSITION];
        sum += f[STOP] * depth * depth + f[STOP_DAMPING] * depth * v;
    }
    if (f[DRIFT] != 0.0) sum += f[DRIFT] * (1.0 - exp(-t / f[DRIFT_TIME]));
    if (f[PUSH] != 0.0) {
        double at = f[PUSH_PERIOD] > 0.0 ? fmod(t, f[PUSH_PERIOD]) : t;
        sum += f[PUSH] * window(at, f[PUSH_START], f[PUSH_WIDTH]);
    }
    if (f[CHIRP] != 0.0) sum += f[CHIRP] * sin(2.0 * 3.14159265358979323846 * (f[CHIRP_START] + 0.5 * f[CHIRP_RATE] * t) * t);
    if (f[COUPLING] != 0.0) sum += f[COUPLING] * sin(2.0 * q - 3.0 * other) * (1.0 + 0.5 * cos(5.0 * other));
    return sum + f[CURVE] * curve(f, t, q, v, other, moved);
}

/* A spring that may harden: K x (1 + c (K x)^2), or in steps, as makers state it: K up to a torque, then halfway to and
 * from 2.5 times that torque on (1 + growth) K. */
static double hardening(const double *f, double x) {
    double linear = f[GEAR_STIFFNESS] * x, growth = f[GEAR_GROWTH], first = f[GEAR_STEP], second = 2.5 * f[GEAR_STEP];
    if (growth != 0.0 && fabs(linear) > first) {
        double more = (fabs(linear) - first) * (1.0 + 0.5 * growth), torque = first + more;
        if (torque > second) torque = second + (torque - second) * (1.0 + growth) / (1.0 + 0.5 * growth);
        linear = linear > 0.0 ? torque : -torque;
    }
    return linear * (1.0 + f[GEAR_CUBIC] * linear * linear);
}

/* Torque of a gear with play: a spring outside the gap. Teeth that are not even
 * turn the link by a little more or less than the motor: a harmonic drive does so twice a turn of it. */
static double gear(const double *f, double motor, double speed, double link, double slope) {
    double twist = motor - link, rate = speed - slope;
    if (f[TRANSMISSION] != 0.0) {
        double angle = f[TRANSMISSION_NUMBER] * motor + f[TRANSMISSION_PHASE];
        twist += f[TRANSMISSION] * sin(angle);
        rate += f[TRANSMISSION] * f[TRANSMISSION_NUMBER] * cos(angle) * speed;
    }
    double half = 0.5 * f[GEAR_GAP], x = 0.0;
    if (twist > half) x = twist - half;
    else if (twist < -half) x = twist + half;
    else if (half > 0.0) return 0.0;
    return hardening(f, x) + f[GEAR_DAMPING] * rate;
}

/* What the encoder shows of a position. */
static double measured(const double *f, double q) {
    double x = q;
    if (f[ECCENTRICITY] != 0.0)
        x += f[ECCENTRICITY] * (sin(f[ECCENTRICITY_NUMBER] * q + f[ECCENTRICITY_PHASE])
                                + 0.2 * sin(2.0 * f[ECCENTRICITY_NUMBER] * q));
    return x;
}

/* What the drive makes of a command. */
static double drive(const double *f, double u) {
    if (f[DEAD_ZONE] != 0.0) u -= f[DEAD_ZONE] * tanh(1.5 * u / f[DEAD_ZONE]);
    return f[DRIVE_GAIN] * u;
}

