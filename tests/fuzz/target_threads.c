/* The C target with its sample interrupt and its background in two threads: target_threads EXCHANGE STEPS. Compiled with
 * the thread sanitizer, which reports what they share without the lock. EXCHANGE as in target_attack.c. */
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "parts.h"

enum { MOST = 64, AXES = 2, COILS = 4, WAVEFORM = 65536 };

static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static struct amb_target target;
static uint8_t waveform[WAVEFORM], exchange[MOST][AMB_FRAME];
static uint32_t record[1000 * (3 * AXES + 1)];
static size_t lengths[MOST], frames, turn;
static uint64_t counter, time_now, stepped;
static struct amb_config config = {
    .machine = "shared", .firmware = "threads", .sample_rate = 10000, .axes = AXES, .coils = COILS, .key_length = 32,
    .axis = {{"x", "a", {0, 0, 1, 0, 0, 2.5, 3, 250e-6}}, {"y", "a", {0, 0, 0, 1, 0, 2.5, 3, 250e-6}}},
    .limits = {3, 12, 1e-3, 0.4, 0.5, 100e-6, 10, 1e-3, 0.02, 120, 0.02, 1e9, 0.01, 0.5, 20, 0.01, 1.2, 0.2, 0.05, 0.05, 0.2},
    .gains = {{20000, 38, 0, 10000, 1}, {20000, 38, 0, 10000, 1}}, .waveform = waveform, .waveform_size = WAVEFORM,
    .record = record, .record_words = sizeof record / sizeof *record};

void board_lock(void *board) { (void)board, pthread_mutex_lock(&lock); }
void board_unlock(void *board) { (void)board, pthread_mutex_unlock(&lock); }
uint64_t board_time(void *board) { return (void)board, __atomic_load_n(&time_now, __ATOMIC_RELAXED); }
void board_random(void *board, uint8_t *bytes, size_t count) { (void)board, memset(bytes, 7, count); }
void board_enable(void *board, bool on) { (void)board, (void)on; }
void board_write_currents(void *board, const double *current, bool on) { (void)board, (void)current, (void)on; }

void board_read_sensors(void *board, struct amb_sensors *sensors) {
    (void)board;
    for (size_t a = 0; a < AXES; a++) sensors->position[a] = 1e-8 * (double)((stepped + a) % 7);
    if (stepped % 20011 == 0) sensors->amplifier_fault = true;
    else sensors->amplifier_fault = false;
}

bool board_send(void *board, const uint8_t *frame, size_t length, const struct amb_peer *to) {
    (void)board, (void)to;
    return length && frame[length - 1] != 0x55; /* now and then, one is not sent */
}

/* The frames of the exchange in their turn, sealed anew. */
size_t board_receive(void *board, uint8_t *frame, size_t space, struct amb_peer *from) {
    size_t length = lengths[turn % frames];
    (void)board, (void)space;
    memcpy(frame, exchange[turn++ % frames], length);
    *from = (struct amb_peer){1, 2, false};
    if (frame[5] == AMB_HELLO) return length;
    amb_put(frame + 8, target.session, 4);
    amb_put(frame + AMB_HEADER, frame[5] == AMB_CURRENT ? 0 : ++counter, 8);
    amb_tag(&target, frame, length - AMB_CRC - AMB_TAG, frame + length - AMB_CRC - AMB_TAG);
    amb_put(frame + length - AMB_CRC, amb_crc32(0, frame, length - AMB_CRC), AMB_CRC);
    return length;
}

static void *interrupt(void *steps) {
    for (size_t left = *(size_t *)steps; left; left--) {
        pthread_mutex_lock(&lock);
        stepped++;
        amb_control_step(&target);
        pthread_mutex_unlock(&lock);
        __atomic_add_fetch(&time_now, 100000, __ATOMIC_RELAXED);
    }
    return NULL;
}

int main(int arguments, char **argument) {
    FILE *file = arguments == 3 ? fopen(argument[1], "rb") : NULL;
    uint8_t size[2];
    pthread_t thread;
    if (!file || fread(config.key, 1, 32, file) != 32) return 2;
    for (; fread(size, 1, 2, file) == 2 && frames < MOST; frames++) {
        lengths[frames] = amb_get16(size);
        if (fread(exchange[frames], 1, lengths[frames], file) != lengths[frames]) return 2;
    }
    size_t steps = strtoul(argument[2], NULL, 10), polls = 0;
    if (!amb_init(&target, &config, NULL) || pthread_create(&thread, NULL, interrupt, &steps)) return 2;
    for (; __atomic_load_n(&time_now, __ATOMIC_RELAXED) < 100000 * (uint64_t)steps; polls++) amb_poll(&target);
    pthread_join(thread, NULL);
    printf("{\"polls\": %zu, \"counter\": %llu}\n", polls, (unsigned long long)target.counter);
    fclose(file);
    return 0;
}
