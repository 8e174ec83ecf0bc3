/* Frames of the host: what is genuine is done, and answered; everything else is counted and nothing more. */
#include "parts.h"

uint8_t *amb_put_status(struct amb_target *t, uint8_t *p, uint64_t *step) {
    board_lock(t->board);
    *step = t->step;
    unsigned flags = (unsigned)t->alarm | (unsigned)t->excitation << 1 | (t->per_frame ? 16u : 0u) |
                     (t->upload.complete ? 32u : 0u) | (t->lock_left ? 8u : 0u) | (t->matrices_ready ? 64u : 0u);
    p = amb_put(p, (unsigned)t->state | (unsigned)t->law << 8 | (unsigned)t->trips << 16 | flags << 24, 4);
    for (size_t i = 0; i < AMB_COUNTS; i++) p = amb_put(p, t->count[i], 4);
    p = amb_put(p, t->counter, 8);
    for (size_t i = 0; i < t->trips; i++) {
        p = amb_put(p, t->trip[i].reason | (uint64_t)t->trip[i].axis << 8, 8);
        p = amb_put(p, t->trip[i].step, 8);
        p = amb_put_double(p, t->trip[i].value);
    }
    board_unlock(t->board);
    return p;
}

static void describe(struct amb_target *t, const struct amb_peer *to) {
    const struct amb_config *config = t->config;
    size_t axes = config->axes, first = t->io[AMB_HEADER] < axes ? t->io[AMB_HEADER] : 0;
    size_t count = axes - first < 8 ? axes - first : 8;
    uint8_t *p = t->io + AMB_HEADER;
    memmove(p, p + 8, AMB_CHALLENGE); /* of the hello, so that nobody can answer it with what was true before */
    p = amb_put(amb_put_bytes(p + AMB_CHALLENGE, t->nonce, AMB_NONCE), t->counter, 8);
    p = amb_put_bytes(amb_put_bytes(p, config->machine, 32), config->firmware, 32);
    p = amb_put_double(p, config->sample_rate);
    p = amb_put(amb_put(p, config->firmware_version, 4), config->waveform_size, 4);
    p = amb_put(p, (uint64_t)AMB_CHUNKS << 32 | AMB_ORDER << 16 | AMB_MATRICES, 8);
    p = amb_put(p, axes | first << 8 | count << 16 | (size_t)config->coils << 24, 4);
    p = amb_put(p, config->key_length > 0, 4);
    for (size_t i = 0; i < AMB_LIMITS; i++) p = amb_put_double(p, config->limits[i]);
    for (const struct amb_axis *axis = config->axis + first; axis < config->axis + first + count; axis++) {
        p = amb_put_bytes(amb_put_bytes(p, axis->name, 16), axis->bearing, 16);
        for (size_t i = 0; i < AMB_NUMBERS; i++) p = amb_put_double(p, axis->number[i]);
    }
    amb_close(t, t->io, p + AMB_TAG, AMB_DESCRIPTION, 0); /* the tag protects the header, too */
    amb_tag(t, t->io, (size_t)(p - t->io), p);
    amb_send(t, t->io, p + AMB_TAG, AMB_DESCRIPTION, 0, to);
}

static bool within(double value, double low, double high) { return value >= low && value <= high; /* not NaN */ }

static enum amb_code levitate(struct amb_target *t, double seconds) {
    if (t->trips) return AMB_LATCHED;
    if (t->state != AMB_OFF || !t->measured) return AMB_WRONG_STATE;
    bool lies = true, held = true; /* within its bearings; by a law with stiffness */
    for (size_t a = 0; a < t->config->axes; a++) {
        lies = lies && t->share[t->group[a]] <= t->limits[AMB_CONTACT_SHARE];
        held = held && (t->law == AMB_STATE_SPACE || t->gains[a][AMB_PROPORTIONAL] > 0.0);
    }
    if (!held) return AMB_BAD_VALUE;
    if (!lies || !amb_keeps_distance(t, t->nominal, t->limits, false)) return AMB_BEYOND_LIMIT;
    amb_ramp(t, AMB_LEVITATING, seconds);
    return AMB_DONE;
}

/* In no time: off, at once, whatever goes on. A landing can be shortened, but not drawn out: every step moves it on. */
static enum amb_code land(struct amb_target *t, double seconds) {
    bool landing = t->state == AMB_LANDING;
    if (seconds > 0.0 && !amb_levitating(t)) return AMB_WRONG_STATE;
    if (seconds == 0.0) {
        if (amb_levitating(t)) t->state = AMB_OFF;
        amb_apply(t);
    } else if (!landing || amb_steps(t, seconds) < t->ramp_left)
        amb_ramp(t, AMB_LANDING, seconds), t->ramp_left -= landing && t->ramp_left;
    return AMB_DONE;
}

/* Gains of a levitated rotor stay within half and twice what they are; the filter of the derivative stays. */
static enum amb_code new_gains(const struct amb_target *t, const double *value) {
    static const double most[AMB_GAINS] = {1e6, 1e4, 1.0, 1e7, 1.0};
    for (size_t i = 0; i < t->config->axes * AMB_GAINS; i++) {
        size_t gain = i % AMB_GAINS;
        double now = t->gains[i / AMB_GAINS][gain];
        if (!within(value[i], 0.0, most[gain]) || (gain == AMB_ON_ERROR && value[i] != 0.0 && value[i] != 1.0))
            return AMB_BAD_VALUE;
        if (!amb_levitating(t)) continue;
        if (gain > AMB_DERIVATIVE && value[i] != now) return AMB_WRONG_STATE;
        if (gain <= AMB_DERIVATIVE && !within(value[i], 0.5 * now, 2.0 * now)) return AMB_BEYOND_LIMIT;
    }
    return AMB_DONE;
}

/* While the rotor is levitated only those limits change with which nothing can move it. */
static enum amb_code new_limits(const struct amb_target *t, const double *value) {
    static const uint32_t passive = 1u << AMB_ALARM_SHARE | 1u << AMB_TRIP_SHARE | 1u << AMB_AMPLITUDE_LIMIT |
                                    1u << AMB_SLEW_LIMIT | 1u << AMB_HOST_TIME | 1u << AMB_LAND_TIME |
                                    1u << AMB_FADE_TIME;
    bool settled = t->state == AMB_LEVITATED && !t->settle_left, excited = t->excitation != AMB_NONE;
    for (size_t i = 0; i < AMB_LIMITS; i++)
        if (!(value[i] > 0.0 && value[i] <= t->config->limits[i])) return AMB_BAD_VALUE;
    if (value[AMB_LOCK_TIME] != t->config->limits[AMB_LOCK_TIME]) return AMB_BAD_VALUE; /* less of it protects less */
    for (size_t a = 0; a < t->config->axes; a++) /* through the whole clearance within a minute: every landing ends */
        if (t->config->axis[a].number[AMB_CLEARANCE] > 30.0 * value[AMB_REFERENCE_SLEW]) return AMB_BAD_VALUE;
    if (!amb_levitating(t)) return AMB_DONE;
    for (size_t i = 0; i < AMB_LIMITS; i++)
        if (value[i] != t->limits[i] && !(passive >> i & 1)) return AMB_WRONG_STATE;
    for (size_t a = 0; a < t->config->axes; a++)
        if (settled && t->group[a] == a && !(t->share[a] <= value[AMB_TRIP_SHARE])) return AMB_BEYOND_LIMIT;
    if (excited && t->upload.amplitude > 60.0 * value[AMB_SLEW_LIMIT]) return AMB_BEYOND_LIMIT; /* it could not fade */
    return amb_keeps_distance(t, t->nominal, value, excited) ? AMB_DONE : AMB_BEYOND_LIMIT;
}

static enum amb_code new_reference(const struct amb_target *t, bool landing, const double *value) {
    double whole[AMB_LIMITS] = {[AMB_ALARM_SHARE] = 1.0, [AMB_TRIP_SHARE] = 1.0};
    bool excited = !landing && t->excitation != AMB_NONE;
    if (!amb_keeps_distance(t, value, landing ? whole : t->limits, false)) return AMB_BAD_VALUE;
    if (amb_levitating(t) && t->state != AMB_LEVITATED) return AMB_WRONG_STATE;
    return amb_keeps_distance(t, value, landing ? whole : t->limits, excited) ? AMB_DONE : AMB_BEYOND_LIMIT;
}

static void use_gains(struct amb_target *t, const double *value) {
    if (!amb_levitating(t)) {
        memcpy(t->gains, value, t->config->axes * sizeof *t->gains);
        t->gain_left = 0;
        return;
    }
    for (size_t a = 0; a < t->config->axes; a++) {
        memcpy(t->former[a], t->gains[a], sizeof t->former[a]);
        memcpy(t->wanted[a], value + a * AMB_GAINS, sizeof t->wanted[a]);
    }
    t->gain_ramp = t->gain_left = amb_steps(t, t->limits[AMB_SETTLE_TIME]) + 1;
}

/* All values are checked before the first is used. */
static enum amb_code set_parameters(struct amb_target *t, const uint8_t *body, size_t length) {
    double value[AMB_AXES * AMB_GAINS > AMB_LIMITS ? AMB_AXES * AMB_GAINS : AMB_LIMITS];
    uint64_t kind = amb_get64(body);
    size_t axes = t->config->axes, count = kind == 1 ? axes * AMB_GAINS : kind == 4 ? AMB_LIMITS : axes;
    if (kind < 1 || kind > 4) return AMB_UNKNOWN;
    if (length != 8 + 8 * count) return AMB_BAD_LENGTH;
    for (size_t i = 0; i < count; i++) value[i] = amb_get_double(body + 8 + 8 * i);
    enum amb_code code = kind == 1 ? new_gains(t, value) : kind == 4 ? new_limits(t, value)
                                                                     : new_reference(t, kind == 3, value);
    if (code != AMB_DONE) return code;
    if (kind == 1) use_gains(t, value);
    else if (kind == 2 && amb_levitating(t)) {
        for (size_t a = 0; a < axes; a++) t->from[a] = t->reference[a] - t->value[a];
        amb_move(t, value, 0.0);
    }
    double *into = kind == 2 ? t->nominal : kind == 3 ? t->landing : t->limits;
    if (kind > 1) memcpy(into, value, count * sizeof *value);
    return AMB_DONE;
}

static enum amb_code choose_controller(struct amb_target *t, const uint8_t *body) {
    if (amb_get64(body) > AMB_HOST_OR_LAND) return AMB_BAD_VALUE;
    if (amb_levitating(t) || (body[0] == AMB_STATE_SPACE && !t->matrices_ready)) return AMB_WRONG_STATE;
    t->law = body[0];
    return AMB_DONE;
}

/* What is still so in the next measurement is latched again, and before it there is no levitation. */
static enum amb_code fault_reset(struct amb_target *t) {
    if (t->lock_left) return AMB_LOCKED;
    t->trips = 0;
    if (t->state == AMB_TRIPPED) t->state = AMB_OFF;
    t->measured = false;
    amb_forget(t);
    return AMB_DONE;
}

static enum amb_code execute(struct amb_target *t, uint8_t type, const uint8_t *body, size_t length, uint64_t step,
                             const struct amb_peer *from) {
    static const uint8_t lengths[] = {0, 8, 8, 8, 0, 8, 24, 8, 4, 4, 8, 0, 8, 8, 0, 8}; /* from AMB_HEARTBEAT on */
    if (type < AMB_HEARTBEAT || type > AMB_RECORD) return AMB_UNKNOWN;
    if (type == AMB_DATA || type == AMB_PARAMETERS ? length <= 8 : length != lengths[type - AMB_HEARTBEAT])
        return AMB_BAD_LENGTH;
    switch (type) {
    case AMB_STREAM: return amb_stream(t, body, from);
    case AMB_LEVITATE:
    case AMB_DELEVITATE:
        if (!within(amb_get_double(body), 0.0, 60.0)) return AMB_BAD_VALUE;
        return type == AMB_LEVITATE ? levitate(t, amb_get_double(body)) : land(t, amb_get_double(body));
    case AMB_FAULT_RESET: return fault_reset(t);
    case AMB_BEGIN: return amb_begin(t, body);
    case AMB_DATA: return amb_data(t, body, length);
    case AMB_BITMAP: return t->upload.id && amb_get32(body) == t->upload.id ? AMB_DONE : AMB_NO_UPLOAD;
    case AMB_COMMIT: return amb_commit(t, amb_get32(body));
    case AMB_ARM: return amb_get32(body + 4) ? AMB_BAD_VALUE : amb_arm(t, step, amb_get32(body));
    case AMB_DISARM: amb_disarm(t); return AMB_DONE;
    case AMB_PARAMETERS: return set_parameters(t, body, length);
    case AMB_CONTROLLER: return choose_controller(t, body);
    case AMB_RECORD: return amb_record(t, amb_get32(body), amb_get32(body + 4));
    default: return AMB_DONE; /* heartbeat, clock */
    }
}

static void reply(struct amb_target *t, bool repeated, const struct amb_peer *to) {
    uint64_t asked = amb_get64(t->io + AMB_SEALED), step; /* time of the host; or first row, and whether to forget */
    uint8_t type = t->last_type, code = t->last_code;
    if (code == AMB_SILENT) return;
    uint8_t *head = t->io + AMB_SEALED, *extra = amb_put_status(t, head + 8, &step), *p = extra;
    if (type == AMB_CLOCK && !repeated) p = amb_put(amb_put(p, asked, 8), board_time(t->board), 8);
    if (type == AMB_BITMAP && code == AMB_DONE && !repeated) {
        p = amb_put(amb_put(p, t->upload.id, 4), t->upload.chunks, 4);
        p = amb_put_bytes(p, t->upload.bitmap, (t->upload.chunks + 7) / 8);
    }
    if (type == AMB_RECORD && code == AMB_DONE && !repeated && asked >> 32 == 0)
        p = amb_put_record(t, p, t->io + AMB_FRAME - AMB_TAG - AMB_CRC, (uint32_t)asked);
    amb_put(head, type | (uint32_t)code << 8 | (uint32_t)(extra - head - 8) << 16, 4);
    amb_put(head + 4, (uint64_t)(p - extra), 4);
    amb_put(t->io + AMB_HEADER, t->counter, 8);
    amb_close(t, t->io, p + AMB_TAG, AMB_REPLY, step); /* the tag protects the header too */
    amb_tag(t, t->io, (size_t)(p - t->io), p);
    amb_send(t, t->io, p + AMB_TAG, AMB_REPLY, step, to);
}

/* What to count a frame as; AMB_COUNTS if it is to be executed: of this boot, with the right tag, from this machine
 * itself where there is no key, and later than the last one, by its counter or by the step that it is for. */
static int judged(const struct amb_target *t, size_t end, const struct amb_peer *from) {
    uint8_t tag[AMB_TAG], difference = 0;
    if (t->io[4] != AMB_VERSION || t->io[5] >= AMB_DESCRIPTION || amb_get32(t->io + 8) != t->session) return AMB_BAD;
    if (!t->config->key_length && !from->loopback) return AMB_FORGED;
    amb_tag(t, t->io, end, tag);
    for (size_t i = 0; i < AMB_TAG; i++) difference = (uint8_t)(difference | (tag[i] ^ t->io[end + i]));
    if (difference) return AMB_FORGED;
    bool current = t->io[5] == AMB_CURRENT;
    uint64_t number = amb_get64(t->io + (current ? 16 : AMB_HEADER)), last = current ? t->spent : t->counter;
    bool far = !current && number > last && number - last > UINT32_MAX; /* or one uses up all */
    return number <= last || far ? AMB_REPLAYED : AMB_COUNTS;
}

void amb_receive(struct amb_target *t, size_t length, const struct amb_peer *from) {
    bool valid = amb_valid(t->io, length), sealed = valid && length >= AMB_SEALED + AMB_TAG + AMB_CRC;
    size_t end = sealed ? length - AMB_CRC - AMB_TAG : 0;
    uint8_t type = t->io[5], *body = t->io + AMB_SEALED;
    uint64_t step = amb_get64(t->io + 16);
    if (valid && type == AMB_HELLO && length >= AMB_HEADER + AMB_HELLO_LENGTH + AMB_CRC) { /* of any version */
        describe(t, from);
        return;
    }
    int judgement = sealed ? judged(t, end, from) : AMB_BAD;
    if (judgement != AMB_COUNTS) {
        t->count[judgement]++;
        /* The latest command again: its reply was lost. Reply again, do nothing. */
        if (judgement == AMB_REPLAYED && !memcmp(t->io + end, t->last_tag, AMB_TAG)) reply(t, true, from);
        return;
    }
    if (type == AMB_COMMIT && end == AMB_SEALED + 4) amb_copy_matrices(t, amb_get32(body));
    board_lock(t->board);
    if (type == AMB_CURRENT) {
        if (amb_take_current(t, step, body, end - AMB_SEALED)) t->last_heard = t->step;
    } else {
        t->last_heard = t->step;
        t->counter = amb_get64(t->io + AMB_HEADER);
        t->last_type = type;
        t->last_code = (uint8_t)execute(t, type, body, end - AMB_SEALED, step, from);
        memcpy(t->last_tag, t->io + end, AMB_TAG);
    }
    board_unlock(t->board);
    if (type != AMB_CURRENT) reply(t, false, from);
}
