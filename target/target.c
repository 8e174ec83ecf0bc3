/* One control step, and the exchange of frames between the steps. */
#include "parts.h"

enum { ROWS = AMB_HEADER + 8, FLOAT64 = 1, COILS = 2, STATUS = 4 };

static bool usable(double value) { return value > 0.0 && isfinite(value); }

/* Whether axes of one bearing agree about it, and all numbers are such that every comparison with them means something.
 * A limit but that of the current may be infinite: never. Axial positions may be unknown (NaN). */
static bool sound(const struct amb_config *config) {
    if (!config->axes || config->axes > AMB_AXES || config->coils > 2 * AMB_AXES) return false;
    if (config->key_length > AMB_KEY || (config->key_length && config->key_length < AMB_SHORTEST_KEY)) return false;
    if (!usable(config->sample_rate) || !usable(config->limits[AMB_CURRENT_LIMIT])) return false;
    if ((config->waveform_size && !config->waveform) || (config->record_words && !config->record)) return false;
    for (size_t i = 0; i < AMB_LIMITS; i++)
        if (!(config->limits[i] > 0.0)) return false;
    for (const struct amb_axis *axis = config->axis; axis < config->axis + config->axes; axis++) {
        const double *gains = config->gains[axis - config->axis];
        double clearance = axis->number[AMB_CLEARANCE];
        if (!usable(clearance) || clearance > 30.0 * config->limits[AMB_REFERENCE_SLEW]) return false;
        for (size_t i = AMB_DIRECTION; i < AMB_CLEARANCE; i++)
            if (!isfinite(axis->number[i])) return false;
        for (size_t i = 0; i < AMB_GAINS; i++)
            if (!(gains[i] >= 0.0) || !isfinite(gains[i])) return false;
        for (const struct amb_axis *other = config->axis; other < axis; other++)
            if (!memcmp(other->bearing, axis->bearing, 16) &&
                other->number[AMB_CLEARANCE] != axis->number[AMB_CLEARANCE]) return false;
    }
    return true;
}

bool amb_init(struct amb_target *t, const struct amb_config *config, void *board) {
    if (!sound(config)) return false;
    memset(t, 0, sizeof *t);
    t->config = config, t->board = board;
    t->period = (uint64_t)(1e9 / config->sample_rate + 0.5);
    memcpy(t->limits, config->limits, sizeof t->limits);
    memcpy(t->gains, config->gains, sizeof t->gains);
    for (uint8_t a = 0; a < config->axes; a++)
        for (t->group[a] = 0; memcmp(config->axis[t->group[a]].bearing, config->axis[a].bearing, 16); t->group[a]++) ;
    do board_random(board, t->nonce, AMB_NONCE);
    while (amb_get32(t->nonce) == 0);
    t->session = amb_get32(t->nonce);
    return true;
}

void amb_move(struct amb_target *t, const double *to, double seconds) {
    double steps = amb_steps(t, seconds);
    for (size_t a = 0; a < t->config->axes; a++)
        steps = fmax(steps, ceil(fabs(to[a] - t->from[a]) * t->config->sample_rate / t->limits[AMB_REFERENCE_SLEW]));
    t->ramp = t->ramp_left = steps < AMB_FOREVER ? (uint32_t)steps : AMB_FOREVER;
}

void amb_ramp(struct amb_target *t, enum amb_state state, double seconds) {
    bool up = state == AMB_LEVITATING;
    for (size_t a = 0; a < t->config->axes; a++)
        t->from[a] = up ? t->sensors.position[a] : t->reference[a] - t->value[a];
    amb_disarm(t);
    t->answered = t->step - 1;
    t->state = state;
    if (up) t->debt = t->own_debt = 0.0;
    if (up && seconds == 0.0) t->ramp_left = 0; /* nothing moves yet: the reference begins as the nominal one */
    else amb_move(t, up ? t->nominal : t->landing, seconds);
    t->settle_left = amb_steps(t, t->limits[AMB_SETTLE_TIME]);
}

/* Reference of this step: nominal, or on the way to it from where the rotor lies, or on the way to where it lands. */
static void set_reference(struct amb_target *t) {
    const double *to = t->state == AMB_LANDING ? t->landing : t->nominal;
    if (!amb_levitating(t)) t->ramp_left = 0;
    for (size_t a = 0; a < t->config->axes; a++) {
        t->reference[a] = to[a];
        if (t->ramp_left) t->reference[a] += (t->from[a] - to[a]) * ((double)t->ramp_left / (double)t->ramp);
        if (t->excitation != AMB_NONE && t->excitation != AMB_ARMED) t->reference[a] += t->value[a];
    }
    if (t->ramp_left) t->ramp_left--;
    else if (t->state == AMB_LEVITATING) t->state = AMB_LEVITATED;
    else if (t->state == AMB_LANDING) t->state = AMB_OFF;
    if (t->state == AMB_LEVITATED && t->settle_left) t->settle_left--;
}

void amb_apply(struct amb_target *t) {
    for (size_t a = 0; a < t->config->axes && amb_levitating(t); a++)
        if (!(fabs(t->current[a]) <= t->limits[AMB_CURRENT_LIMIT])) amb_trip(t, AMB_LAW, a, t->current[a]);
    if (!amb_levitating(t)) {
        memset(t->current, 0, sizeof t->current);
        memset(t->value, 0, sizeof t->value);
        t->begun = false; /* the law forgets the past */
        t->excitation = AMB_NONE;
    }
    board_enable(t->board, amb_levitating(t));
    board_write_currents(t->board, t->current, amb_levitating(t));
}

static uint8_t *put_values(uint8_t *p, const double *values, size_t count, bool wide) {
    for (size_t i = 0; i < count; i++) p = wide ? amb_put_double(p, values[i]) : amb_put_float(p, values[i]);
    return p;
}

static void record(struct amb_target *t) {
    size_t axes = t->config->axes;
    bool wide = t->options & FLOAT64;
    uint32_t status = (uint32_t)t->state | (uint32_t)t->alarm << 3 | (uint32_t)t->excitation << 4 | (uint32_t)t->trips << 8;
    amb_remember(t, status);
    if (!t->per_frame) return;
    if (!t->filled) t->first[t->filling] = t->step;
    uint8_t *p = t->block[t->filling] + ROWS + (size_t)t->filled * t->row;
    p = put_values(put_values(p, t->reference, axes, wide), t->sensors.position, axes, wide);
    p = put_values(p, t->current, axes, wide);
    if (t->options & COILS) p = put_values(p, t->sensors.coil, t->config->coils, wide);
    if (t->options & STATUS) amb_put(p, status, wide ? 8 : 4);
    if (++t->filled < t->per_frame) return;
    t->filled = 0;
    t->count[AMB_UNSENT] += t->pending; /* the background was too slow: a gap in the steps */
    if (!t->pending) t->filling ^= 1;
    t->pending = true;
}

void amb_control_step(struct amb_target *t) {
    amb_watch(t);
    board_read_sensors(t->board, &t->sensors);
    amb_protect(t);
    amb_excite(t);
    set_reference(t);
    amb_tune(t);
    if (amb_levitating(t)) amb_law(t);
    amb_apply(t);
    record(t);
    t->step++;
}

enum amb_code amb_stream(struct amb_target *t, const uint8_t *body, const struct amb_peer *to) {
    uint32_t rows = amb_get16(body + 2), options = body[0], width = options & FLOAT64 ? 8 : 4;
    uint32_t coils = options & COILS ? t->config->coils : 0u, status = options & STATUS ? 1u : 0u;
    uint32_t row = width * (3u * t->config->axes + coils + status);
    if (options > 7 || body[1] || amb_get32(body + 4)) return AMB_BAD_VALUE;
    if (ROWS + rows * row + AMB_CRC > AMB_FRAME) return AMB_TOO_LARGE;
    t->options = body[0], t->per_frame = (uint16_t)rows, t->row = (uint16_t)row;
    t->filled = 0, t->pending = false;
    t->peer = *to;
    return AMB_DONE;
}

void amb_send(struct amb_target *t, uint8_t *frame, const uint8_t *end, uint8_t type, uint64_t step,
              const struct amb_peer *to) {
    size_t length = amb_close(t, frame, end, type, step);
    t->sequence++;
    if (board_send(t->board, frame, length, to)) return;
    board_lock(t->board);
    t->count[AMB_UNSENT]++;
    board_unlock(t->board);
}

/* The sample interrupt leaves a block alone as long as it is pending. */
static void send_telemetry(struct amb_target *t) {
    board_lock(t->board);
    bool pending = t->pending;
    size_t full = t->filling ^ 1;
    uint64_t first = t->first[full];
    board_unlock(t->board);
    if (!pending) return;
    uint8_t *block = t->block[full], *p = block + AMB_HEADER;
    uint32_t coils = t->options & COILS ? t->config->coils : 0u;
    p = amb_put(p, t->options | (uint32_t)t->config->axes << 8 | coils << 16, 4);
    p = amb_put(p, t->per_frame | (uint32_t)t->row << 16, 4) + (size_t)t->per_frame * t->row;
    amb_send(t, block, p, AMB_TELEMETRY, first, &t->peer);
    board_lock(t->board);
    t->pending = false;
    board_unlock(t->board);
}

void amb_poll(struct amb_target *t) {
    struct amb_peer from;
    size_t length = 1;
    for (int frames = 0; frames < 8 && length; frames++) {
        send_telemetry(t);
        length = board_receive(t->board, t->io, sizeof t->io, &from);
        if (length) amb_receive(t, length, &from);
        amb_digest(t);
    }
    uint64_t step;
    board_lock(t->board);
    bool report = t->report; /* taken back before the status is read, so that no trip is missed in between */
    t->report = false;
    amb_renew(t);
    board_unlock(t->board);
    uint8_t *end = amb_put_status(t, t->io + AMB_HEADER, &step);
    if (!t->per_frame || (!report && step - t->last_status < amb_steps(t, 0.1))) return;
    t->last_status = step;
    amb_send(t, t->io, end, AMB_STATUS, step, &t->peer);
}
