/* The plant of amb_core.plant.kernel in plain C: the same equations and algorithm on the same arrays, as far as the
 * paper's table goes: one bearing, linear iron, point mass, common carriers; without trace.
 *
 * Kept for comparison only: c_kernel.py compiles it, compares the states and measures both in one run. Where what lies
 * in the arrays (STEP, FLUX and so on) comes as macros from amb_core.plant.layout.
 */
#include <math.h>
#include <stddef.h>
#include <string.h>

enum { SOLVED = POLES + COILS };

/* Head of the state, and the block of the one bearing behind it. */
typedef struct {
    double phase, started, steps;
    double position[4], velocity[4], acceleration[2];
    double others[HEAD_SIZE - SENSED];
    double flux[POLES], mmf[POLES];
    double integral[COILS], current_sum[COILS], duty[COILS], current_start[COILS];
} State;

_Static_assert(offsetof(State, position) == POSITION * sizeof(double), "position is elsewhere");
_Static_assert(offsetof(State, acceleration) == ACCELERATION * sizeof(double), "acceleration is elsewhere");
_Static_assert(offsetof(State, flux) == (HEAD_SIZE + FLUX) * sizeof(double), "flux is elsewhere");
_Static_assert(offsetof(State, current_start) == (HEAD_SIZE + CURRENT_START) * sizeof(double), "currents are elsewhere");

typedef struct {
    double reluctance[POLES][SOLVED]; /* columns beyond the poles are zero */
    double solution[SOLVED][SOLVED];  /* row: h or V; column: dphi/dt or i */
    double cosine[SOLVED], sine[SOLVED];
} Matrices;

_Static_assert(offsetof(Matrices, solution) == SOLUTION * SOLVED * sizeof(double), "solution is elsewhere");
_Static_assert(offsetof(Matrices, sine) == SINE * SOLVED * sizeof(double), "sine is elsewhere");

static double clamp(double value, double low, double high)
{
    value = value > low ? value : low;
    return value < high ? value : high;
}

/* Add a matrix-vector product to a result, by columns; four running sums at a time become one vector register. */
static inline __attribute__((always_inline)) void accumulate(int rows, int columns, const double *restrict matrix,
                                                             const double *restrict vector, double *restrict result)
{
    for (int j = 0; j < columns; j += 4) {
        double sum[4] = {result[j], result[j + 1], result[j + 2], result[j + 3]};
        for (int k = 0; k < rows; k++)
            for (int n = 0; n < 4; n++)
                sum[n] += matrix[k * SOLVED + j + n] * vector[k];
        for (int n = 0; n < 4; n++)
            result[j + n] = sum[n];
    }
}

/* PI on the mean current of the past switching period; the integral part holds while the duty is at its limit. */
static void update_duties(State *s, const double *c, const double *reference, const double *current)
{
    for (int coil = 0; coil < COILS; coil++) {
        double missing = 0.5 * (current[coil] - s->current_start[coil]);
        double error = reference[coil] - (s->current_sum[coil] + missing) / c[PERIOD];
        double integral = s->integral[coil] + c[KI] * error * c[PERIOD] * c[STEP];
        double duty = 0.5 + c[KP] * error + integral;
        if (c[DUTY_MIN] <= duty && duty <= c[DUTY_MAX])
            s->integral[coil] = integral;
        s->duty[coil] = clamp(duty, c[DUTY_MIN], c[DUTY_MAX]);
        s->current_sum[coil] = 0.0;
        s->current_start[coil] = current[coil];
    }
}

/* Diodes: where the current would be negative the coil voltage rises until it is zero (projected Gauss-Seidel). */
static void block_negative_currents(const Matrices *m, double *voltage, double *solved)
{
    double applied[COILS];
    memcpy(applied, voltage, sizeof applied);
    for (int sweep = 0; sweep < 20; sweep++) {
        double largest = 0.0;
        for (int coil = 0; coil < COILS; coil++) {
            const double *column = m->solution[POLES + coil];
            double wanted = voltage[coil] - solved[POLES + coil] / column[POLES + coil];
            double change = (wanted > applied[coil] ? wanted : applied[coil]) - voltage[coil];
            if (change != 0.0) {
                voltage[coil] += change;
                for (int j = 0; j < SOLVED; j++)
                    solved[j] += column[j] * change;
                if (fabs(change) > largest)
                    largest = fabs(change);
            }
        }
        if (largest < 1e-9)
            return;
    }
}

int advance(State *restrict s, const double *restrict c, const Matrices *restrict m, const double *restrict control,
            long steps)
{
    const double h = c[STEP];
    const int period = (int)c[PERIOD];
    int phase = (int)s->phase;
    double reference[COILS];
    for (int coil = 0; coil < COILS; coil++) {
        double along = coil < 2 ? control[coil] : -control[coil - 2];
        reference[coil] = clamp(c[BIAS] + along, c[CURRENT_MIN], c[CURRENT_MAX]);
    }

    for (long n = 0; n < steps; n++) {
        double drop[POLES], extrapolated[POLES], voltage[COILS], current[COILS] = {0.0}, solved[SOLVED] = {0.0};

        for (int j = 0; j < POLES; j++) {
            double gap = c[GAP] - s->position[0] * m->cosine[j] - s->position[1] * m->sine[j];
            drop[j] = gap * c[GAP_RELUCTANCE] * s->flux[j];
        }
        accumulate(POLES, POLES, m->reluctance[0], s->flux, drop);
        if (s->started == 0.0)
            memcpy(s->mmf, drop, sizeof drop);
        for (int j = 0; j < POLES; j++) {
            extrapolated[j] = 1.5 * drop[j] - 0.5 * s->mmf[j];
            s->mmf[j] = drop[j];
        }
        accumulate(POLES, COILS, m->solution[0] + POLES, drop, current);

        if (phase == 0)
            update_duties(s, c, reference, current);
        for (int coil = 0; coil < COILS; coil++) {
            double half = 0.5 * c[PERIOD] * s->duty[coil];
            double end = phase + 1.0 < 0.5 * c[PERIOD] + half ? phase + 1.0 : 0.5 * c[PERIOD] + half;
            double start = phase > 0.5 * c[PERIOD] - half ? phase : 0.5 * c[PERIOD] - half;
            voltage[coil] = c[SUPPLY] * (2.0 * clamp(end - start, 0.0, 1.0) - 1.0);
        }

        accumulate(POLES, POLES, m->solution[0], extrapolated, solved);
        memcpy(solved + POLES, current, sizeof current);
        accumulate(COILS, SOLVED, m->solution[POLES], voltage, solved);
        const double *i = solved + POLES;
        if (c[UNIPOLAR] != 0.0 && (i[0] < 0.0 || i[1] < 0.0 || i[2] < 0.0 || i[3] < 0.0))
            block_negative_currents(m, voltage, solved);

        double force[2] = {0.0, 0.0};
        for (int j = 0; j < POLES; j++) {
            double pull = c[FORCE] * s->flux[j] * s->flux[j];
            force[0] += pull * m->cosine[j];
            force[1] += pull * m->sine[j];
        }

        for (int j = 0; j < POLES; j++)
            s->flux[j] += h * solved[j];
        for (int coil = 0; coil < COILS; coil++)
            s->current_sum[coil] += solved[POLES + coil];
        for (int axis = 0; axis < 2; axis++) {
            double acceleration = force[axis] / c[MASS] - (axis == 1 ? c[GRAVITY] : 0.0);
            if (s->started == 0.0)
                s->acceleration[axis] = acceleration;
            double before = s->velocity[axis];
            s->velocity[axis] += h * (1.5 * acceleration - 0.5 * s->acceleration[axis]);
            s->position[axis] += 0.5 * h * (before + s->velocity[axis]);
            s->acceleration[axis] = acceleration;
        }
        s->started = 1.0;
        s->steps += 1.0;
        if (++phase == period)
            phase = 0;
    }
    s->phase = phase;
    double square = s->position[0] * s->position[0] + s->position[1] * s->position[1];
    if (!isfinite(square))
        return NOT_FINITE;
    return square >= c[RADIUS] * c[RADIUS] ? DELEVITATED : OK;
}
