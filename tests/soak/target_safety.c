/* Random sequences of commands, faults and times against the C target around a rotor: target_safety SEQUENCES SEED.
 *
 * The rotor is a point mass on linear magnets between backup bearings, and moves in steps that the target misses, too. A
 * jump is a change of reference or gains between two steps with currents that is faster than the limits in force. A limit
 * is broken by currents after a trip, beyond a limit, or without a reset. Prints the counts as JSON. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "hosted/hosted.h"
#include "parts.h"

enum { AXES = 2, COILS = 4, WAVEFORM = 4096, RATE = 10000, MOST_ROWS = 80 };

static const double MASS = 6.25, CURRENT = 66.0, STIFFNESS = 3.3e5, CLEARANCE = 250e-6, GRAVITY = -9.81;
static struct hosted host;
static struct amb_target *const t = &host.target;
static uint8_t waveform[WAVEFORM];
static struct amb_config config = {
    .machine = "soaked", .firmware = "safety", .sample_rate = RATE, .axes = AXES, .coils = COILS, .key_length = 16,
    .axis = {{"x", "a", {0, 0, 1, 0, 0, 2.5, 3, 250e-6}}, {"y", "a", {0, 0, 0, 1, 0, 2.5, 3, 250e-6}}},
    .limits = {3, 12, 1e-4, 0.4, 0.5, 100e-6, 0.2, 1e-3, 0.02, 120, 0.02, 0.5, 0.01, 0.01, 20, 0.02, 1.2, 0.05, 0.02, 0.05,
               0.02},
    .gains = {{20000, 38, 0, RATE, 1}, {20000, 38, 0, RATE, 1}}, .waveform = waveform, .waveform_size = WAVEFORM};
static double position[AXES], velocity[AXES], current[AXES], before[AXES], gains[AXES][2];
static uint64_t seed, counter, now, tripped_at;
static bool was_on, was_settled, stuck_sensor, inverted;
static size_t sequence, jumps, broken, steps, levitated, accepted, refused, lifted, offs, saturated[AXES], excited;
static size_t reasons[AMB_REASONS];

static uint64_t draw(void) { /* xorshift64*, G. Marsaglia 2003, S. Vigna 2016 */
    seed ^= seed >> 12, seed ^= seed << 25, seed ^= seed >> 27;
    return seed * 0x2545f4914f6cdd1du;
}
static size_t below(size_t limit) { return (size_t)(draw() >> 33) % limit; }
static double uniform(double low, double high) { return low + (high - low) * ((double)(draw() >> 11) / 9007199254740992.0); }

static void breaks(bool wrong, const char *what) {
    if (!wrong) return;
    if (broken++ < 20) fprintf(stderr, "sequence %zu, step %llu: %s\n", sequence, (unsigned long long)t->step, what);
}

static void jump(bool wrong, const char *what) {
    if (!wrong) return;
    if (jumps++ < 20) fprintf(stderr, "sequence %zu, step %llu: jump of %s\n", sequence, (unsigned long long)t->step, what);
}

static void move(bool on) {
    for (size_t a = 0; a < AXES; a++) {
        double force = on ? CURRENT * current[a] + STIFFNESS * position[a] : 0.0;
        velocity[a] += (force / MASS + (a ? GRAVITY : 0.0)) / RATE;
        position[a] += velocity[a] / RATE;
    }
    double radius = hypot(position[0], position[1]);
    for (size_t a = 0; a < AXES && radius > CLEARANCE; a++) position[a] *= CLEARANCE / radius, velocity[a] *= 0.2;
}

static bool switched_off(void) { /* by a trip that is latched */
    for (size_t i = 0; i < t->trips; i++)
        if (t->trip[i].reason != AMB_HOST_SILENT && t->trip[i].reason != AMB_EXCITATION) return true;
    return false;
}

static void check(bool on, const double *measured) {
    double radius = 0.0, wanted = 0.0, step = 1.0 / RATE, room = 1.0 + 1e-6;
    double slew = t->limits[AMB_REFERENCE_SLEW] + t->limits[AMB_SLEW_LIMIT];
    breaks(on != amb_levitating(t) || on != host.hardware_enable, "outputs and state differ");
    breaks(on && switched_off(), "on after a trip");
    for (size_t i = 0; i < AMB_LIMITS; i++) breaks(!(t->limits[i] <= config.limits[i]), "a limit was raised");
    breaks(t->excitation == AMB_FADING && t->fade_left > 60u * RATE, "a fade that does not end");
    breaks(!on && (t->excitation != AMB_NONE || t->value[0] != 0.0), "an excitation while off");
    for (size_t a = 0; a < AXES; a++) {
        radius += measured[a] * measured[a], wanted += t->reference[a] * t->reference[a];
        breaks(!isfinite(t->reference[a]) || !isfinite(t->nominal[a]), "a reference that is no number");
        breaks(!(fabs(current[a]) <= t->limits[AMB_CURRENT_LIMIT]) || (!on && current[a] != 0.0), "current");
        breaks(on && !(fabs(measured[a]) <= t->limits[AMB_SENSOR_LIMIT]), "on with a sensor out of its range");
        saturated[a] = on && fabs(current[a]) >= t->limits[AMB_CURRENT_LIMIT] ? saturated[a] + 1 : 0;
        breaks(saturated[a] > amb_steps(t, t->limits[AMB_SATURATION_TIME]) + 1, "a current at its limit for too long");
        if (on && was_on) {
            jump(!(fabs(t->reference[a] - before[a]) <= slew * step * room + 1e-15), "the reference");
            for (size_t i = 0; i < 2; i++) {
                double most = 1.01 * gains[a][i] / (t->limits[AMB_SETTLE_TIME] * RATE) + 1e-9;
                jump(!(fabs(t->gains[a][i] - gains[a][i]) <= 2.0 * most), "a gain");
            }
            breaks(!(t->gains[a][0] > 0.0), "a rotor without stiffness");
        }
        before[a] = t->reference[a];
        memcpy(gains[a], t->gains[a], sizeof gains[a]);
    }
    double share = sqrt(radius) / CLEARANCE;
    breaks(on && share > t->limits[AMB_CONTACT_SHARE] * room, "on beyond the contact");
    breaks(on && was_settled && t->state == AMB_LEVITATED && share > t->limits[AMB_TRIP_SHARE] * room, "on beyond the trip share");
    breaks(on && t->state == AMB_LEVITATED && sqrt(wanted) > t->limits[AMB_TRIP_SHARE] * CLEARANCE * room + 1e-12,
           "a reference beyond the trip share");
    for (size_t i = 0; i < t->trips; i++)
        if (t->trip[i].reason == AMB_DISPLACEMENT) tripped_at = t->trip[i].step;
    lifted += on && !was_on, levitated += on, excited += t->excitation == AMB_PLAYING, steps++;
    was_on = on, was_settled = t->state == AMB_LEVITATED && !t->settle_left;
}

/* One step, after `missed` that did not take place; `fault`: of the sensors and inputs, 0 for none. */
static void step(size_t missed, size_t fault) {
    static const double strange[] = {NAN, INFINITY, 1.1e-3, -2e-4, 2.9e-4, 3.1e-4, 0.0};
    static double held[AXES];
    double measured[AXES], coil[COILS] = {2.5, 2.5, 2.5, 2.5};
    for (size_t i = 0; i < missed; i++) move(was_on);
    now += 100000u * (missed + 1);
    for (size_t a = 0; a < AXES; a++) measured[a] = (inverted ? -1.0 : 1.0) * position[a] + uniform(-2e-8, 2e-8);
    if (fault == 1) measured[below(AXES)] = strange[below(7)];
    if (fault == 2) coil[below(COILS)] = 13.0;
    if (stuck_sensor) measured[0] = held[0];
    memcpy(held, measured, sizeof held);
    bool on_before = was_on;
    bool on = hosted_step(&host, measured, coil, fault == 3 ? 121.0 : 20.0, fault == 4, now, current);
    breaks(on && on_before && (double)missed >= t->limits[AMB_MISSED_LIMIT], "on after a pause");
    breaks(on && (fault == 3 || fault == 4), "on with a fault");
    check(on, measured);
    move(on);
}

static uint8_t send(uint8_t type, uint64_t at, const uint8_t *body, size_t length) {
    static const struct amb_peer peer = {0xc0a80001, 5000, false};
    uint8_t frame[AMB_FRAME], answer[AMB_FRAME], *end = frame + AMB_SEALED + length, code = AMB_SILENT;
    struct amb_peer to;
    size_t size;
    amb_put(frame + AMB_HEADER, type == AMB_CURRENT ? 0 : ++counter, 8);
    memcpy(frame + AMB_SEALED, body, length);
    amb_close(t, frame, end + AMB_TAG, type, at);
    amb_tag(t, frame, (size_t)(end - frame), end);
    size = amb_close(t, frame, end + AMB_TAG, type, at);
    hosted_feed(&host, frame, size, &peer);
    was_on = was_on && host.enabled; /* off, if only between two steps */
    while ((size = hosted_take(&host, answer, &to)))
        if (answer[5] == AMB_REPLY) code = answer[AMB_SEALED + 1];
    accepted += code == AMB_DONE, refused += code != AMB_DONE && code != AMB_SILENT;
    return code;
}

static uint8_t send_numbers(uint8_t type, uint64_t word, const double *value, size_t count) {
    uint8_t body[8 + 8 * AXES * AMB_GAINS + 8 * AMB_LIMITS], *p = amb_put(body, word, 8);
    for (size_t i = 0; i < count; i++) p = amb_put_double(p, value[i]);
    return send(type, 0, body, (size_t)(p - body));
}

static void send_seconds(uint8_t type) {
    static const double some[] = {0.0, 0.0, 1e-4, 1e-3, 0.01, 0.05, 60.0, -1.0, NAN};
    uint8_t body[8];
    double seconds = some[below(9)];
    amb_put_double(body, seconds);
    uint8_t code = send(type, 0, body, 8);
    bool off = type == AMB_DELEVITATE && seconds == 0.0;
    breaks(off && (code != AMB_DONE || host.enabled || host.hardware_enable || amb_levitating(t)), "an off that is none");
    offs += off;
}

static void send_parameters(void) {
    static const double strange[] = {0.0, 1e-9, 90e-6, -90e-6, 2e-4, 1.0, 1e6, NAN, INFINITY, 5e-324};
    double value[AXES * AMB_GAINS > AMB_LIMITS ? AXES * AMB_GAINS : AMB_LIMITS];
    uint64_t kind = 1 + below(4);
    size_t count = kind == 1 ? AXES * AMB_GAINS : kind == 4 ? AMB_LIMITS : AXES;
    for (size_t i = 0; i < count; i++) {
        if (kind == 1) value[i] = t->gains[i / AMB_GAINS][i % AMB_GAINS] * (i % AMB_GAINS < 2 ? uniform(0.8, 1.3) : 1.0);
        else if (kind == 4 && t->excitation == AMB_PLAYING)
            value[i] = t->limits[i] * (i == AMB_SLEW_LIMIT || i == AMB_AMPLITUDE_LIMIT ? uniform(0.05, 1.0) : 1.0);
        else if (kind == 4) value[i] = t->limits[i] * (below(4) || i == AMB_LOCK_TIME ? 1.0 : uniform(0.3, 1.2));
        else value[i] = uniform(-1.0, 1.0) * (kind == 2 ? 100e-6 : 250e-6);
    }
    if (below(6) == 0) value[below(count)] = strange[below(10)];
    send_numbers(AMB_PARAMETERS, kind, value, count);
}

static void send_excitation(void) {
    static uint32_t id = 1;
    uint8_t body[8 + 8 * AXES * MOST_ROWS], *p;
    size_t rows = 5 + below(MOST_ROWS - 5), size = 8 * AXES * rows;
    double amplitude[AXES], turn = uniform(0.01, 0.4);
    for (size_t a = 0; a < AXES; a++) amplitude[a] = uniform(0.0, 110e-6);
    p = amb_put(body, ++id, 4), p = amb_put(p, 0, 4);
    for (size_t i = 0; i < rows; i++)
        for (size_t a = 0; a < AXES; a++)
            p = amb_put_double(p, amplitude[a] * sin(turn * (double)i + (double)a) * sin(M_PI * (double)i / (double)rows));
    uint8_t begin[24];
    uint32_t crc = amb_crc32(0, body + 8, size);
    amb_put(amb_put(begin, 1, 8), id, 4);
    amb_put(amb_put(amb_put(begin + 12, size, 4), crc, 4), rows, 4);
    send(AMB_BEGIN, 0, begin, 24);
    send(AMB_DATA, 0, body, 8 + size);
    send(AMB_COMMIT, 0, body, 4);
    send(AMB_ARM, t->step + below(30), body, 8); /* the index of the chunk, 0, is the reserved word */
}

static void command(void) {
    uint8_t word[8 + 8 * AXES];
    double value[AXES] = {uniform(-4.0, 4.0), below(30) ? uniform(-1.0, 1.0) : NAN};
    bool displaced = false;
    switch (below(12)) {
    case 0:
    case 1: send_seconds(AMB_LEVITATE); break;
    case 2: send_seconds(AMB_DELEVITATE); break;
    case 3:
        for (size_t i = 0; i < t->trips; i++) displaced = displaced || t->trip[i].reason == AMB_DISPLACEMENT;
        uint8_t code = send(AMB_FAULT_RESET, 0, word, 0);
        breaks(displaced && code == AMB_DONE && t->step < tripped_at + amb_steps(t, config.limits[AMB_LOCK_TIME]),
               "a reset while locked");
        break;
    case 4:
    case 5:
    case 6: send_parameters(); break;
    case 7:
    case 8: send_excitation(); break;
    case 9: send(AMB_DISARM, 0, word, 0); break;
    case 10:
        amb_put(word, below(20) ? 0 : below(5), 8);
        send(AMB_CONTROLLER, 0, word, 8);
        break;
    default:
        for (size_t a = 0; a < AXES; a++) amb_put_double(word + 8 * a, value[a]);
        send(AMB_CURRENT, t->step + below(3) - 2, word, 8 * AXES);
    }
}

static void run_sequence(void) {
    uint8_t nonce[AMB_NONCE], word[8];
    for (size_t i = 0; i < AMB_NONCE; i++) nonce[i] = (uint8_t)(draw() | 1);
    if (!hosted_init(&host, &config, nonce)) abort();
    counter = now = tripped_at = 0, was_on = was_settled = stuck_sensor = false, inverted = below(20) == 0;
    for (size_t a = 0; a < AXES; a++) {
        position[a] = uniform(-170e-6, 170e-6), velocity[a] = 0.0, saturated[a] = 0;
        memcpy(gains[a], config.gains[a], sizeof gains[a]);
    }
    bool calm = below(2);
    step(0, 0);
    if (below(4)) { /* mostly from a rotor that is levitated */
        amb_put_double(word, uniform(0.0, 0.02));
        send(AMB_LEVITATE, 0, word, 8);
        for (size_t i = below(600); i; i--) step(0, 0);
    }
    for (size_t actions = 4 + below(20); actions; actions--) {
        command();
        for (size_t i = below(40) + (below(30) ? 0 : 300); i; i--)
            step(calm || below(200) ? 0 : below(30), calm || below(400) ? 0 : 1 + below(4));
        if (!calm && below(60) == 0) stuck_sensor = !stuck_sensor;
    }
    for (size_t i = 0; i < t->trips; i++) reasons[t->trip[i].reason]++;
}

int main(int arguments, char **argument) {
    if (arguments != 3) return 2;
    size_t count = strtoul(argument[1], NULL, 10);
    seed = strtoul(argument[2], NULL, 10) * 0x9e3779b97f4a7c15u + 1;
    for (sequence = 0; sequence < count; sequence++) run_sequence();
    printf("{\"sequences\": %zu, \"jumps\": %zu, \"limits_broken\": %zu, \"steps\": %zu, \"levitated\": %zu, \"lifted\": %zu, ",
           sequence, jumps, broken, steps, levitated, lifted);
    printf("\"accepted\": %zu, \"refused\": %zu, \"offs\": %zu, \"excited\": %zu, \"reasons\": [", accepted, refused, offs, excited);
    for (size_t i = 0; i < AMB_REASONS; i++) printf("%zu%s", reasons[i], i + 1 < AMB_REASONS ? ", " : "]}\n");
    return 0;
}
