/* The control laws of amb_core.loop.control and amb_core.loop.linear_control: the same operations in the same order, so
 * that currents are equal bit for bit. Compile without contraction to fused operations: -ffp-contract=off. */
#include "parts.h"

static double limited(double value, double limit) {
    value = -limit > value ? -limit : value;
    return limit < value ? limit : value;
}

void amb_tune(struct amb_target *t) {
    if (!t->gain_left) return;
    t->gain_left = amb_levitating(t) ? t->gain_left - 1 : 0;
    double share = (double)t->gain_left / (double)t->gain_ramp;
    for (size_t a = 0; a < t->config->axes; a++)
        for (size_t i = 0; i < 2; i++) t->gains[a][i] = t->wanted[a][i] + (t->former[a][i] - t->wanted[a][i]) * share;
}

static void pd(struct amb_target *t) {
    for (size_t a = 0; a < t->config->axes; a++) {
        const double *gains = t->gains[a];
        double error = t->reference[a] - t->sensors.position[a], before = t->differentiated[a];
        t->differentiated[a] = gains[AMB_ON_ERROR] * t->reference[a] - t->sensors.position[a];
        if (!t->begun) t->derivative[a] = 0.0, before = t->differentiated[a];
        t->derivative[a] = gains[AMB_KEEP] * t->derivative[a] + gains[AMB_WEIGHT] * (t->differentiated[a] - before);
        t->current[a] = limited(gains[AMB_PROPORTIONAL] * error + gains[AMB_DERIVATIVE] * t->derivative[a],
                                t->limits[AMB_CURRENT_LIMIT]);
    }
}

/* Numbers of A, B, C, D, K, state at rest per input, input offset and output offset, in this order, by rows. */
size_t amb_matrix_count(size_t axes, size_t order, size_t inputs) {
    return order * order + 2 * order * inputs + 2 * axes * order + axes * inputs + inputs + axes;
}

static double add_product(double total, const double *row, const double *column, size_t count) {
    for (size_t i = 0; i < count; i++) total += row[i] * column[i];
    return total;
}

static void state_space(struct amb_target *t) {
    size_t n = t->order, m = t->inputs, axes = t->config->axes;
    const double *a = t->matrices, *b = a + n * n, *c = b + n * m, *d = c + axes * n, *k = d + axes * m;
    const double *at_rest = k + n * axes, *input_offset = at_rest + n * m, *output_offset = input_offset + m;
    for (size_t i = 0; i < axes; i++) {
        t->input[axes + i] = t->sensors.position[i];
        t->input[i] = m == axes ? t->reference[i] - t->sensors.position[i] : t->reference[i];
    }
    for (size_t i = 0; i < m; i++) t->input[i] -= input_offset[i];
    for (size_t i = 0; i < n && !t->begun; i++) t->x[i] = add_product(0.0, at_rest + i * m, t->input, m);
    for (size_t i = 0; i < n; i++)
        t->after[i] = add_product(add_product(0.0, a + i * n, t->x, n), b + i * m, t->input, m);
    for (size_t i = 0; i < axes; i++) {
        double wanted = add_product(add_product(output_offset[i], c + i * n, t->x, n), d + i * m, t->input, m);
        t->current[i] = limited(wanted, t->limits[AMB_CURRENT_LIMIT]);
        double excess = t->current[i] - wanted;
        for (size_t row = 0; row < n && excess != 0.0; row++) t->after[row] += k[row * axes + i] * excess;
    }
    memcpy(t->x, t->after, n * sizeof *t->x);
}

bool amb_by_host(const struct amb_target *t) {
    return t->law >= AMB_HOST && (t->state == AMB_LEVITATING || t->state == AMB_LEVITATED);
}

/* The current of a host holds. Beside it the PD goes on, so that it can land without a jump. */
void amb_law(struct amb_target *t) {
    double held[AMB_AXES];
    memcpy(held, t->current, sizeof held);
    if (t->law == AMB_STATE_SPACE) state_space(t);
    else pd(t);
    t->begun = true;
    if (amb_by_host(t)) memcpy(t->current, held, sizeof held);
}

/* The current of the host for a step that has been measured flows at once. One that was refused is spent, too. */
bool amb_take_current(struct amb_target *t, uint64_t step, const uint8_t *values, size_t length) {
    /* No host sends it so early; the target must not be deaf until then. */
    if ((double)step > (double)t->step + 20.0 * t->config->sample_rate) return false;
    t->spent = step;
    if (!amb_by_host(t) || step <= t->answered || step >= t->step || length != 8u * t->config->axes) return false;
    t->answered = step;
    for (size_t a = 0; a < t->config->axes; a++)
        t->current[a] = limited(amb_get_double(values + 8 * a), t->limits[AMB_CURRENT_LIMIT]);
    amb_apply(t);
    return true;
}
