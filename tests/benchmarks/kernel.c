/* The plant of amb_core.plant.kernel in plain C: the same equations and algorithm on the same arrays, without trace.
 *
 * Kept for comparison only: c_kernel.py compiles it, compares the states and measures both in one run.
 */
#include <math.h>
#include <string.h>

enum { POLES = 8, COILS = 4, SOLVED = POLES + COILS };
enum { OK, DELEVITATED, NOT_FINITE, INPUT_NOT_FINITE };

typedef struct {
    double flux[POLES], mmf[POLES];
    double position[2], velocity[2], acceleration[2];
    double integral[COILS], current_sum[COILS], duty[COILS], current_start[COILS];
    double phase, started;
} State;

typedef struct {
    double step, gap, gap_reluctance, force, mass, gravity, radius;
    double supply, duty_min, duty_max, kp, ki, bias, current_max, period, unipolar;
} Constants;

typedef struct {
    double reluctance[POLES][SOLVED];  /* columns beyond the poles are zero */
    double solution[SOLVED][SOLVED];   /* row: h or V; column: dphi/dt or i */
    double cosine[SOLVED], sine[SOLVED];
} Matrices;

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
static void update_duties(State *s, const Constants *c, const double *reference, const double *current)
{
    for (int coil = 0; coil < COILS; coil++) {
        double missing = 0.5 * (current[coil] - s->current_start[coil]);
        double error = reference[coil] - (s->current_sum[coil] + missing) / c->period;
        double integral = s->integral[coil] + c->ki * error * c->period * c->step;
        double duty = 0.5 + c->kp * error + integral;
        if (c->duty_min <= duty && duty <= c->duty_max)
            s->integral[coil] = integral;
        s->duty[coil] = clamp(duty, c->duty_min, c->duty_max);
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

int advance(State *restrict s, const Constants *restrict c, const Matrices *restrict m, double current_x,
            double current_y, long steps)
{
    if (!isfinite(current_x + current_y))
        return INPUT_NOT_FINITE;
    const double control[COILS] = {current_x, current_y, -current_x, -current_y};
    const double h = c->step;
    const int period = (int)c->period;
    int phase = (int)s->phase;
    double reference[COILS];
    for (int coil = 0; coil < COILS; coil++)
        reference[coil] = clamp(c->bias + control[coil], 0.0, c->current_max);

    for (long n = 0; n < steps; n++) {
        double drop[POLES], extrapolated[POLES], voltage[COILS], current[COILS] = {0.0}, solved[SOLVED] = {0.0};

        for (int j = 0; j < POLES; j++) {
            double gap = c->gap - s->position[0] * m->cosine[j] - s->position[1] * m->sine[j];
            drop[j] = gap * c->gap_reluctance * s->flux[j];
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
            double half = 0.5 * c->period * s->duty[coil];
            double end = phase + 1.0 < 0.5 * c->period + half ? phase + 1.0 : 0.5 * c->period + half;
            double start = phase > 0.5 * c->period - half ? phase : 0.5 * c->period - half;
            voltage[coil] = c->supply * (2.0 * clamp(end - start, 0.0, 1.0) - 1.0);
        }

        accumulate(POLES, POLES, m->solution[0], extrapolated, solved);
        memcpy(solved + POLES, current, sizeof current);
        accumulate(COILS, SOLVED, m->solution[POLES], voltage, solved);
        const double *i = solved + POLES;
        if (c->unipolar != 0.0 && (i[0] < 0.0 || i[1] < 0.0 || i[2] < 0.0 || i[3] < 0.0))
            block_negative_currents(m, voltage, solved);

        double force[2] = {0.0, 0.0};
        for (int j = 0; j < POLES; j++) {
            double pull = c->force * s->flux[j] * s->flux[j];
            force[0] += pull * m->cosine[j];
            force[1] += pull * m->sine[j];
        }

        for (int j = 0; j < POLES; j++)
            s->flux[j] += h * solved[j];
        for (int coil = 0; coil < COILS; coil++)
            s->current_sum[coil] += solved[POLES + coil];
        for (int axis = 0; axis < 2; axis++) {
            double acceleration = force[axis] / c->mass - (axis == 1 ? c->gravity : 0.0);
            if (s->started == 0.0)
                s->acceleration[axis] = acceleration;
            double velocity = s->velocity[axis];
            s->velocity[axis] += h * (1.5 * acceleration - 0.5 * s->acceleration[axis]);
            s->position[axis] += 0.5 * h * (velocity + s->velocity[axis]);
            s->acceleration[axis] = acceleration;
        }
        s->started = 1.0;
        if (++phase == period)
            phase = 0;
    }
    s->phase = phase;
    double square = s->position[0] * s->position[0] + s->position[1] * s->position[1];
    if (!isfinite(square))
        return NOT_FINITE;
    return square >= c->radius * c->radius ? DELEVITATED : OK;
}
