/* Uploads of excitations and matrices, chunk by chunk into one buffer; an excitation plays from an exact step. */
#include "parts.h"

enum { EXCITATION = 1, STATE_SPACE = 2 };

static double number(const struct amb_target *t, size_t i) { return amb_get_double(t->config->waveform + 8 * i); }

static bool received(const struct amb_target *t, uint32_t i) { return t->upload.bitmap[i / 8] >> i % 8 & 1; }

/* It must fade within a minute, too, wherever it is stopped. */
static bool beyond_limit(const struct amb_target *t) {
    return t->upload.amplitude > t->limits[AMB_AMPLITUDE_LIMIT] || t->upload.slew > t->limits[AMB_SLEW_LIMIT] ||
           t->upload.amplitude > 60.0 * t->limits[AMB_SLEW_LIMIT];
}

enum amb_code amb_begin(struct amb_target *t, const uint8_t *body) {
    uint8_t kind = body[0];
    uint16_t order = amb_get16(body + 2), inputs = amb_get16(body + 4);
    uint32_t id = amb_get32(body + 8), size = amb_get32(body + 12), steps = amb_get32(body + 20);
    size_t axes = t->config->axes;
    uint64_t expected = 8 * (uint64_t)steps * axes;
    if (t->excitation != AMB_NONE) return AMB_WRONG_STATE;
    if (kind == STATE_SPACE && steps == 0) {
        if (order > AMB_ORDER || (inputs != axes && inputs != 2 * axes)) return AMB_BAD_VALUE;
        expected = 8 * amb_matrix_count(axes, order, inputs);
        if (expected > 8 * AMB_MATRICES) return AMB_TOO_LARGE;
    } else if (kind != EXCITATION || order || inputs || !steps) return AMB_BAD_VALUE;
    if (!id || size != expected || amb_get16(body + 6) || body[1]) return AMB_BAD_VALUE;
    if (size > t->config->waveform_size || size > (uint32_t)AMB_CHUNKS * AMB_CHUNK) return AMB_TOO_LARGE;
    t->upload = (struct amb_upload){
        .kind = kind, .order = order, .inputs = inputs, .id = id, .size = size, .steps = steps,
        .crc = amb_get32(body + 16), .chunks = (size + AMB_CHUNK - 1) / AMB_CHUNK};
    return AMB_DONE;
}

enum amb_code amb_data(struct amb_target *t, const uint8_t *body, size_t length) {
    uint32_t index = amb_get32(body + 4);
    if (!t->upload.id || amb_get32(body) != t->upload.id || t->upload.complete || index >= t->upload.chunks)
        return AMB_NO_UPLOAD;
    uint32_t first = index * AMB_CHUNK, left = t->upload.size - first;
    if (length - 8 != (left < AMB_CHUNK ? left : AMB_CHUNK)) return AMB_BAD_LENGTH;
    if (received(t, index)) return AMB_SILENT; /* it may have been checked, and must not change any more */
    memcpy(t->config->waveform + first, body + 8, length - 8);
    t->upload.bitmap[index / 8] = (uint8_t)(t->upload.bitmap[index / 8] | 1 << index % 8);
    t->upload.arrived++;
    return AMB_SILENT;
}

/* How far a row of all axes reaches in each bearing. */
static void take_reach(struct amb_target *t, size_t first) {
    double row[AMB_AXES];
    for (size_t a = 0; a < t->config->axes; a++) row[a] = number(t, first + a);
    for (size_t a = 0; a < t->config->axes; a++)
        if (t->group[a] == a) t->upload.reach[a] = fmax(t->upload.reach[a], amb_radius(t, a, row, NULL));
}

/* Take the next chunk into checksum and peaks; the change from and to the zero around the signal counts too. One chunk
 * a call, so that the background never keeps the link waiting. */
void amb_digest(struct amb_target *t) {
    uint32_t chunk = t->upload.checked, first = chunk * AMB_CHUNK, left = t->upload.size - first;
    if (chunk >= t->upload.chunks || !received(t, chunk)) return;
    uint32_t count = left < AMB_CHUNK ? left : AMB_CHUNK;
    size_t axes = t->config->axes, end = (first + count) / 8;
    t->upload.sum = amb_crc32(t->upload.sum, t->config->waveform + first, count);
    for (size_t i = first / 8; i < end + (left == count ? axes : 0); i++) {
        double value = i < end ? number(t, i) : 0.0, last = i < axes ? 0.0 : number(t, i - axes);
        t->upload.amplitude = isfinite(value) ? fmax(t->upload.amplitude, fabs(value)) : INFINITY;
        t->upload.slew = fmax(t->upload.slew, fabs(value - last) * t->config->sample_rate);
        if (i % axes == axes - 1 && i < end) take_reach(t, i - axes + 1);
    }
    t->upload.checked++;
}

/* Without the lock, since it takes long: only the background can levitate a rotor with matrices. */
void amb_copy_matrices(struct amb_target *t, uint32_t id) {
    bool whole = t->upload.id && id == t->upload.id && t->upload.checked == t->upload.chunks && isfinite(t->upload.amplitude);
    if (!whole || t->upload.kind != STATE_SPACE || t->upload.sum != t->upload.crc) return;
    board_lock(t->board);
    bool used = amb_levitating(t) && t->law == AMB_STATE_SPACE;
    board_unlock(t->board);
    for (size_t i = 0; i < t->upload.size / 8 && !used; i++) t->matrices[i] = number(t, i);
}

enum amb_code amb_commit(struct amb_target *t, uint32_t id) {
    if (!t->upload.id || id != t->upload.id) return AMB_NO_UPLOAD;
    if (t->upload.arrived < t->upload.chunks) return AMB_INCOMPLETE;
    if (t->upload.checked < t->upload.chunks) return AMB_BUSY;
    if (t->upload.sum != t->upload.crc) return AMB_CHECKSUM;
    if (isinf(t->upload.amplitude)) return AMB_BAD_VALUE;
    if (t->upload.kind == STATE_SPACE) {
        if (amb_levitating(t) && t->law == AMB_STATE_SPACE) return AMB_WRONG_STATE;
        t->order = t->upload.order, t->inputs = t->upload.inputs;
        t->matrices_ready = true;
    } else if (beyond_limit(t)) return AMB_BEYOND_LIMIT;
    t->upload.complete = true;
    return AMB_DONE;
}

enum amb_code amb_arm(struct amb_target *t, uint64_t step, uint32_t id) {
    if (t->trips) return AMB_LATCHED;
    if (t->state != AMB_LEVITATED || t->excitation != AMB_NONE || amb_by_host(t)) return AMB_WRONG_STATE;
    if (t->upload.kind != EXCITATION || !t->upload.complete || id != t->upload.id) return AMB_NO_UPLOAD;
    if (beyond_limit(t) || !amb_keeps_distance(t, t->nominal, t->limits, true)) return AMB_BEYOND_LIMIT;
    if (step < t->step) return AMB_TOO_LATE; /* t->step is the one that comes next */
    t->start = step;
    t->excitation = AMB_ARMED;
    return AMB_DONE;
}

void amb_disarm(struct amb_target *t) {
    if (t->excitation == AMB_ARMED) t->excitation = AMB_NONE;
    if (t->excitation != AMB_PLAYING) return;
    double steps = fmin(amb_steps(t, t->limits[AMB_FADE_TIME]), 60.0 * t->config->sample_rate);
    for (size_t a = 0; a < t->config->axes; a++)
        steps = fmax(steps, fabs(t->value[a]) * t->config->sample_rate / t->limits[AMB_SLEW_LIMIT]);
    t->fade_left = steps < AMB_FOREVER ? (uint32_t)ceil(steps) : AMB_FOREVER;
    t->excitation = AMB_FADING;
}

static void play(struct amb_target *t) {
    uint64_t index = t->step - t->start;
    bool ends = index >= t->upload.steps;
    double next[AMB_AXES], fastest = t->limits[AMB_SLEW_LIMIT] * (1.0 + 1e-9) / t->config->sample_rate;
    for (size_t a = 0; a < t->config->axes && t->excitation == AMB_PLAYING; a++) {
        next[a] = ends ? 0.0 : number(t, (size_t)index * t->config->axes + a);
        if (!(fabs(next[a]) <= t->limits[AMB_AMPLITUDE_LIMIT]) || !(fabs(next[a] - t->value[a]) <= fastest))
            amb_trip(t, AMB_EXCITATION, a, next[a]); /* a limit was lowered meanwhile */
    }
    if (t->excitation != AMB_PLAYING) return;
    memcpy(t->value, next, t->config->axes * sizeof *next);
    if (ends) t->excitation = AMB_NONE;
}

void amb_excite(struct amb_target *t) {
    if (t->excitation == AMB_ARMED && t->step == t->start) t->excitation = AMB_PLAYING;
    if (t->excitation == AMB_PLAYING) play(t);
    if (t->excitation == AMB_FADING && t->fade_left-- == 0) t->excitation = AMB_NONE;
    for (size_t a = 0; a < t->config->axes && t->excitation == AMB_FADING; a++)
        t->value[a] *= (double)t->fade_left / ((double)t->fade_left + 1.0);
    if (t->excitation == AMB_NONE || t->excitation == AMB_ARMED) memset(t->value, 0, sizeof t->value);
}
