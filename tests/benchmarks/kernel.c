/* The plant of amb_core.plant.kernel in plain C: the same equations and algorithm on the same records, as far as the
 * paper's table goes: one bearing, linear iron, point mass, common carriers; without trace.
 *
 * Kept for comparison only: c_kernel.py writes records.h from amb_core.plant.kernel.records, compiles this, compares the
 * states and measures both in one run.
 */
#include <math.h>
#include <string.h>

#include "records.h"

static double clamp(double value, double low, double high)
{
    value = value > low ? value : low;
    return value < high ? value : high;
}

/* Add a matrix-vector product, by columns; four running sums at a time become one vector register. */
static inline __attribute__((always_inline)) void add_product(int rows, int columns, const double *restrict matrix,
                                                              const double *restrict vector, double *restrict result)
{
    for (int j = 0; j < columns; j += 4) {
        double sum[4] = {result[j], result[j + 1], result[j + 2], result[j + 3]};
        for (int k = 0; k < rows; k++)
            for (int n = 0; n < 4; n++)
                sum[n] += matrix[k * columns + j + n] * vector[k];
        for (int n = 0; n < 4; n++)
            result[j + n] = sum[n];
    }
}

/* PI on the mean current of the past switching period; the integral part holds while the duty is at its limit. */
static void update_duties(Bearing *b, const Constants *c, const double *reference, const double *current)
{
    const double period = (double)c->amplifier.period;
    for (int coil = 0; coil < COILS; coil++) {
        double missing = 0.5 * (current[coil] - b->current_start[coil]);
        double error = reference[coil] - (b->current_sum[coil] + missing) / period;
        double integral = b->integral[coil] + c->amplifier.integral_gain * error * period * c->step;
        double duty = 0.5 + c->amplifier.proportional_gain * error + integral;
        if (c->amplifier.duty_min <= duty && duty <= c->amplifier.duty_max)
            b->integral[coil] = integral;
        b->duty[coil] = clamp(duty, c->amplifier.duty_min, c->amplifier.duty_max);
        b->current_sum[coil] = 0.0;
        b->current_start[coil] = current[coil];
    }
}

/* Diodes: where the current would be negative the coil voltage rises until it is zero (projected Gauss-Seidel). */
static void block_negative_currents(const Constants *c, double *voltage, double *rate, double *current)
{
    double applied[COILS];
    memcpy(applied, voltage, sizeof applied);
    for (int sweep = 0; sweep < 20; sweep++) {
        double largest = 0.0;
        for (int coil = 0; coil < COILS; coil++) {
            double wanted = voltage[coil] - current[coil] / c->current_by_voltage[coil][coil];
            double change = (wanted > applied[coil] ? wanted : applied[coil]) - voltage[coil];
            if (change != 0.0) {
                voltage[coil] += change;
                for (int j = 0; j < POLES; j++)
                    rate[j] += c->rate_by_voltage[coil][j] * change;
                for (int j = 0; j < COILS; j++)
                    current[j] += c->current_by_voltage[coil][j] * change;
                if (fabs(change) > largest)
                    largest = fabs(change);
            }
        }
        if (largest < 1e-9)
            return;
    }
}

int advance(State *restrict s, Bearing *restrict b, const Constants *restrict c, const double *restrict control,
            long steps)
{
    const double h = c->step, period = (double)c->amplifier.period;
    int phase = (int)s->phase;
    double reference[COILS];
    for (int coil = 0; coil < COILS; coil++) {
        double along = coil < 2 ? control[coil] : -control[coil - 2];
        reference[coil] = clamp(c->amplifier.bias + along, c->amplifier.current_min, c->amplifier.current_max);
    }

    for (long n = 0; n < steps; n++) {
        double drop[POLES], middle[POLES], voltage[COILS], owed[COILS] = {0.0}, current[COILS], rate[POLES] = {0.0};

        for (int j = 0; j < POLES; j++) {
            double gap = c->gap - b->position[0] * c->cosine[j] - b->position[1] * c->sine[j];
            drop[j] = gap * c->gap_reluctance * b->flux[j];
        }
        add_product(POLES, POLES, c->reluctance[0], b->flux, drop);
        if (!s->started)
            memcpy(b->previous_drop, drop, sizeof drop);
        for (int j = 0; j < POLES; j++) {
            middle[j] = 1.5 * drop[j] - 0.5 * b->previous_drop[j];
            b->previous_drop[j] = drop[j];
        }
        add_product(POLES, COILS, c->current_by_drop[0], drop, owed);

        if (phase == 0)
            update_duties(b, c, reference, owed);
        for (int coil = 0; coil < COILS; coil++) {
            double half = 0.5 * period * b->duty[coil];
            double end = phase + 1.0 < 0.5 * period + half ? phase + 1.0 : 0.5 * period + half;
            double start = phase > 0.5 * period - half ? phase : 0.5 * period - half;
            voltage[coil] = c->amplifier.supply * (2.0 * clamp(end - start, 0.0, 1.0) - 1.0);
        }

        add_product(POLES, POLES, c->rate_by_drop[0], middle, rate);
        add_product(COILS, POLES, c->rate_by_voltage[0], voltage, rate);
        memcpy(current, owed, sizeof current);
        add_product(COILS, COILS, c->current_by_voltage[0], voltage, current);
        if (c->amplifier.unipolar && (current[0] < 0.0 || current[1] < 0.0 || current[2] < 0.0 || current[3] < 0.0))
            block_negative_currents(c, voltage, rate, current);

        double force[2] = {0.0, 0.0};
        for (int j = 0; j < POLES; j++) {
            double pull = c->pull * b->flux[j] * b->flux[j];
            force[0] += pull * c->cosine[j];
            force[1] += pull * c->sine[j];
        }

        for (int j = 0; j < POLES; j++)
            b->flux[j] += h * rate[j];
        for (int coil = 0; coil < COILS; coil++)
            b->current_sum[coil] += current[coil];
        for (int axis = 0; axis < 2; axis++) {
            double acceleration = force[axis] / c->rotor.mass - (axis == 1 ? c->rotor.gravity : 0.0);
            if (!s->started)
                b->acceleration[axis] = acceleration;
            double before = b->velocity[axis];
            b->velocity[axis] += h * (1.5 * acceleration - 0.5 * b->acceleration[axis]);
            b->position[axis] += 0.5 * h * (before + b->velocity[axis]);
            b->acceleration[axis] = acceleration;
        }
        s->started = true;
        s->steps += 1;
        if (++phase == period)
            phase = 0;
    }
    s->phase = phase;
    double square = b->position[0] * b->position[0] + b->position[1] * b->position[1];
    if (!isfinite(square))
        return NOT_FINITE;
    return square >= c->rotor.backup_radius * c->rotor.backup_radius ? DELEVITATED : OK;
}
