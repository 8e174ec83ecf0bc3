/* Hostile datagrams against the C target: target_attack EXCHANGE COUNT SEED. Compiled with the sanitizers, which end it
 * at the first finding; what else must never happen is checked here. EXCHANGE holds key, nonce and the host's frames of
 * tests/data/target, as tests/fuzz/target.py writes them. Prints the counts as JSON. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "hosted/hosted.h"
#include "parts.h"
#include "ports/stream.h"

enum { MOST = 64, AXES = 2, COILS = 4, OLD = 256, WAVEFORM = 4096 };

static struct hosted host;
static uint8_t exchange[MOST][AMB_FRAME], key[32], nonce[AMB_NONCE], old[OLD][AMB_FRAME], latest[AMB_FRAME];
static size_t lengths[MOST], frames, old_lengths[OLD], latest_length;
static uint64_t seed, counter, olds, currents;
static double current[AXES];
static struct amb_config config = {
    .machine = "attacked", .firmware = "fuzz", .sample_rate = 10000, .axes = AXES, .coils = COILS, .key_length = 32,
    .axis = {{"x", "a", {0, 0, 1, 0, 0, 2.5, 3, 250e-6}}, {"y", "a", {0, 0, 0, 1, 0, 2.5, 3, 250e-6}}},
    .limits = {3, 12, 1e-3, 0.4, 0.5, 100e-6, 10, 1e-3, 0.02, 120, 0.02, 1e9, 0.01, 0.5, 20, 0.01, 1.2, 0.2, 0.05, 0.05, 0.2},
    .gains = {{20000, 38, 0, 10000, 1}, {20000, 38, 0, 10000, 1}}, .waveform_size = WAVEFORM};

static uint64_t draw(void) { /* xorshift64*, G. Marsaglia 2003, S. Vigna 2016 */
    seed ^= seed >> 12, seed ^= seed << 25, seed ^= seed >> 27;
    return seed * 0x2545f4914f6cdd1du;
}

static size_t below(size_t limit) { return (size_t)(draw() >> 33) % limit; }

static void require(bool right, const char *what, size_t number) {
    if (right) return;
    fprintf(stderr, "finding at frame %zu: %s\n", number, what);
    abort();
}

static size_t mutate(uint8_t *frame, size_t length) {
    static const uint64_t strange[] = {0, 1, 0x7f, 0x80, 0xff, 0x7fff, 0x8000, 0xffff, 0x7fffffff, 0x80000000, 0xffffffff,
        0x7ff0000000000000, 0x7ff8000000000000, 0x8000000000000000, 0xffffffffffffffff, 0x3ff0000000000000};
    for (size_t times = 1 + below(4); times; times--) {
        size_t place = below(length), width = (size_t)1 << below(4);
        switch (below(6)) {
        case 0: frame[place] ^= (uint8_t)(1u << below(8)); break;
        case 1: frame[place] = (uint8_t)draw(); break;
        case 2: if (place + width <= length) amb_put(frame + place, strange[below(16)], width); break;
        case 3: if (below(4) == 0) length = 1 + below(AMB_FRAME); break;
        case 4: for (size_t i = place; i < length && i < place + 64; i++) frame[i] = (uint8_t)draw(); break;
        default: {
            size_t other = below(frames), from = below(lengths[other]), count = below(lengths[other] - from) + 1;
            if (place + count <= length) memcpy(frame + place, exchange[other] + from, count);
        }
        }
    }
    return length;
}

static void checksum(uint8_t *frame, size_t length) {
    if (length < AMB_HEADER + AMB_CRC) return;
    amb_put(frame + 6, length - AMB_HEADER - AMB_CRC, 2);
    amb_put(frame + length - AMB_CRC, amb_crc32(0, frame, length - AMB_CRC), AMB_CRC);
}

/* As somebody would who has this key, this session and this counter. */
static void sign(uint8_t *frame, size_t length, const struct amb_target *as, uint64_t count) {
    if (length < AMB_SEALED + AMB_TAG + AMB_CRC) return;
    amb_put(frame + 8, as->session, 4);
    amb_put(frame + AMB_HEADER, count, 8);
    amb_put(frame + 6, length - AMB_HEADER - AMB_CRC, 2);
    amb_tag(as, frame, length - AMB_CRC - AMB_TAG, frame + length - AMB_CRC - AMB_TAG);
    checksum(frame, length);
}

/* Exactly as long as it is, so that the sanitizer sees reads beyond it. */
static void feed(const uint8_t *frame, size_t length) {
    struct amb_peer from = {(uint32_t)draw(), (uint16_t)draw(), false};
    uint8_t *copy = malloc(length);
    if (!copy) abort();
    memcpy(copy, frame, length);
    hosted_feed(&host, copy, length, &from);
    free(copy);
}

static void keep(const uint8_t *frame, size_t length) {
    memcpy(old[olds % OLD], frame, length);
    old_lengths[olds++ % OLD] = length;
    memcpy(latest, frame, length);
    latest_length = length;
}

static void boot(void) {
    for (size_t i = 0; i < AMB_NONCE; i++) nonce[i] = (uint8_t)draw();
    nonce[0] |= 1;
    require(hosted_init(&host, &config, nonce), "no start", 0);
    counter = 0, latest_length = 0;
}

static void step(size_t number) {
    static const double strange[] = {NAN, INFINITY, -INFINITY, 1e-3, -2e-4, 1e308, 0};
    double position[AXES], coil[COILS];
    bool hostile = below(2000) == 0;
    for (size_t i = 0; i < AXES; i++) position[i] = hostile ? strange[below(7)] : ((double)below(2001) - 1000) * 2e-8;
    for (size_t i = 0; i < COILS; i++) coil[i] = below(20000) ? 2.5 : strange[below(7)];
    uint64_t time = host.time + (below(5000) ? 100000 : draw() % 10000000);
    bool on = hosted_step(&host, position, coil, below(20000) ? 20.0 : NAN, below(20000) == 0, time, current);
    const struct amb_target *t = &host.target;
    require(t->state <= AMB_TRIPPED && t->trips < AMB_REASONS && t->excitation <= AMB_FADING, "impossible state", number);
    require(on == amb_levitating(t), "amplifiers and state differ", number);
    for (size_t a = 0; a < AXES; a++) {
        require(fabs(current[a]) <= t->limits[AMB_CURRENT_LIMIT] && (on || current[a] == 0.0), "current", number);
        require(fabs(t->value[a]) <= config.limits[AMB_AMPLITUDE_LIMIT], "excitation", number);
        require(fabs(t->reference[a]) < 1e-2 || !on, "reference", number);
    }
    for (size_t i = 0; i < AMB_LIMITS; i++) require(t->limits[i] <= config.limits[i], "a limit was raised", number);
}

static void drain(size_t number) {
    uint8_t frame[AMB_FRAME];
    struct amb_peer to;
    size_t length;
    while ((length = hosted_take(&host, frame, &to)))
        require(amb_valid(frame, length) && frame[5] >= AMB_DESCRIPTION && frame[4] == AMB_VERSION, "answer", number);
}

/* One genuine frame of the exchange, in its turn: so that the target is in all of its states while it is attacked. */
static void genuine(size_t number) {
    static size_t turn;
    uint8_t frame[AMB_FRAME];
    size_t length = lengths[turn % frames];
    memcpy(frame, exchange[turn++ % frames], length);
    if (frame[5] == AMB_ARM) amb_put(frame + 16, host.target.step + 3, 8);
    if (frame[5] == AMB_CURRENT) { /* for the latest step; numbered by it, and not by the counter */
        amb_put(frame + 16, host.target.step - 1, 8);
        sign(frame, length, &host.target, 0);
        bool spent = host.target.spent >= host.target.step - 1; /* by the host gone mad */
        feed(frame, length);
        if (spent || !amb_by_host(&host.target)) return;
        require(host.target.answered == host.target.step - 1, "a current was refused", number);
        currents++;
        return;
    }
    if (frame[5] != AMB_HELLO) sign(frame, length, &host.target, ++counter);
    if (turn % frames == 0) turn += below(frames); /* not always in the same order of states */
    feed(frame, length);
    if (frame[5] == AMB_HELLO) return;
    require(host.target.counter == counter, "a genuine command was refused", number);
    keep(frame, length);
}

/* A frame that must not be accepted: by a wrong key, of before, of another boot, or changed on its way. */
static size_t forge(uint8_t *frame) {
    static struct amb_target stranger;
    static struct amb_config wrong;
    size_t pick = below(frames), length = lengths[pick], kind = below(5);
    memcpy(frame, exchange[pick], length);
    if (kind == 0 && olds) { /* of before, maybe of before a reboot, as it was */
        pick = below((size_t)(olds < OLD ? olds : OLD));
        memcpy(frame, old[pick], old_lengths[pick]);
        return old_lengths[pick];
    }
    if (kind == 1 && latest_length) { /* out of order */
        sign(frame, length, &host.target, counter ? 1 + draw() % counter : 0);
        if (frame[5] == AMB_HELLO) frame[5] = AMB_HEARTBEAT, sign(frame, length, &host.target, 0);
        if (frame[5] == AMB_CURRENT) { /* out of order by its step */
            amb_put(frame + 16, draw() % (host.target.spent + 1), 8);
            sign(frame, length, &host.target, 0);
        }
        return length;
    }
    wrong = config;
    stranger.config = &wrong;
    stranger.session = host.target.session;
    memcpy(stranger.nonce, host.target.nonce, AMB_NONCE);
    if (kind == 2) wrong.key[below(32)] ^= (uint8_t)(1u << below(8));
    else if (kind == 3) stranger.nonce[4 + below(12)] ^= (uint8_t)(1u << below(8)); /* session right, nonce not */
    if (frame[5] == AMB_HELLO) frame[5] = AMB_HEARTBEAT;
    sign(frame, length, &stranger, counter + 1 + draw() % 1000);
    if (kind < 2 || kind == 4) { /* genuine, but for one bit of it */
        size_t place = 8 + below(length - 8 - AMB_CRC);
        frame[place] ^= (uint8_t)(1u << below(8));
        checksum(frame, length);
    }
    return length;
}

static void read_exchange(const char *path) {
    uint8_t size[2];
    FILE *file = fopen(path, "rb");
    require(file && fread(key, 1, 32, file) == 32, "no exchange", 0);
    memcpy(config.key, key, 32);
    for (; fread(size, 1, 2, file) == 2 && frames < MOST; frames++) {
        lengths[frames] = amb_get16(size);
        require(lengths[frames] <= AMB_FRAME && fread(exchange[frames], 1, lengths[frames], file) == lengths[frames],
                "exchange cut off", frames);
    }
    fclose(file);
}

/* The frame in a byte stream, garbled: whatever comes out is a frame that fits, and after two ends the next is whole. */
static void stream(const uint8_t *frame, size_t length, size_t number) {
    static struct amb_stream receiver;
    uint8_t coded[AMB_STREAM_ROOM];
    size_t count = amb_stream_put(frame, length, coded), out = 0;
    require(count <= AMB_STREAM_ROOM && coded[count - 1] == 0, "a frame in the stream", number);
    for (size_t times = below(4); times; times--) coded[below(count)] = (uint8_t)draw();
    for (size_t i = below(4) ? 0 : below(count); i < count; i++) {
        out = amb_stream_take(&receiver, coded[i]);
        require(out <= AMB_FRAME + 1, "a frame longer than its room", number);
    }
    amb_stream_take(&receiver, 0);
    count = amb_stream_put(frame, length, coded);
    for (size_t i = 0; i < count; i++) out = amb_stream_take(&receiver, coded[i]);
    require(out == length && !memcmp(receiver.frame, frame, length), "a whole frame was not found", number);
}

int main(int arguments, char **argument) {
    require(arguments == 4, "usage: target_attack EXCHANGE COUNT SEED", 0);
    size_t count = strtoul(argument[2], NULL, 10), forged = 0, signed_frames = 0, states[AMB_TRIPPED + 1] = {0};
    seed = strtoul(argument[3], NULL, 10) * 0x9e3779b97f4a7c15u + 1;
    read_exchange(argument[1]);
    config.waveform = malloc(WAVEFORM);
    config.record_words = 100 * (3 * AXES + 1) + 5;
    config.record = malloc(config.record_words * sizeof *config.record);
    boot();
    for (size_t number = 0; number < count; number++) {
        uint8_t frame[AMB_FRAME];
        size_t pick = below(frames), length = lengths[pick], kind = below(4);
        if (below(50000) == 0) boot();
        if (below(4) == 0) genuine(number);
        if (below(4) == 0) step(number);
        states[host.target.state]++;
        uint64_t before = host.target.counter, answered = host.target.answered;
        memcpy(frame, exchange[pick], length);
        if (kind == 0) length = mutate(frame, length);
        if (kind == 1) length = mutate(frame, length), checksum(frame, length);
        if (kind == 2) length = forge(frame);
        if (kind == 3) { /* a host with the key gone mad */
            length = mutate(frame, length);
            if (frame[5] == AMB_HELLO) frame[5] = (uint8_t)(AMB_HEARTBEAT + below(17));
            if (frame[5] == AMB_CURRENT && below(2)) amb_put(frame + 16, host.target.step - 1, 8);
            frame[4] = AMB_VERSION;
            amb_put(frame, 0x55424d41, 4);
            sign(frame, length, &host.target, ++counter);
            signed_frames++;
        }
        stream(frame, length, number);
        feed(frame, length);
        drain(number);
        if (kind == 3) counter = host.target.counter;
        else forged++, require(host.target.counter == before && host.target.answered == answered, "a forged command was accepted",
                               number);
    }
    printf("{\"frames\": %zu, \"signed\": %zu, \"forged\": %zu, \"accepted\": 0, \"currents\": %zu, ", count, signed_frames,
           forged, (size_t)currents);
    printf("\"states\": [%zu, %zu, %zu, %zu, %zu]}\n", states[0], states[1], states[2], states[3], states[4]);
    free(config.waveform), free(config.record);
    return 0;
}
