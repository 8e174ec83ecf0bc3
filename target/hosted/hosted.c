/* A board in the memory of a process: the target as a library for emulators and tests. The caller owns the memory. */
#include "hosted.h"
#include "../parts.h"

#include <string.h>

size_t hosted_size(void) { return sizeof(struct hosted); }

bool hosted_init(struct hosted *h, const struct amb_config *config, const uint8_t *random) {
    memset(h, 0, sizeof *h);
    memcpy(h->random, random, AMB_NONCE);
    return amb_init(&h->target, config, h);
}

bool hosted_step(struct hosted *h, const double *position, const double *coil, double temperature, bool fault,
                 uint64_t time, double *current) {
    h->position = position, h->coil = coil, h->temperature = temperature, h->fault = fault;
    h->time = time, h->current = current;
    amb_control_step(&h->target);
    amb_poll(&h->target);
    return h->enabled;
}

bool hosted_feed(struct hosted *h, const uint8_t *frame, size_t length, const struct amb_peer *from) {
    h->received = frame, h->length = length, h->from = *from;
    amb_poll(&h->target);
    return h->enabled;
}

bool hosted_hardware_enable(const struct hosted *h) { return h->hardware_enable; }

bool hosted_waits(const struct hosted *h) {
    return amb_by_host(&h->target) && h->target.answered + 1 != h->target.step;
}

size_t hosted_take(struct hosted *h, uint8_t *frame, struct amb_peer *to) {
    if (h->first == h->stop) return 0;
    size_t slot = h->first++ % HOSTED_FRAMES;
    memcpy(frame, h->sent[slot], h->lengths[slot]);
    *to = h->to[slot];
    return h->lengths[slot];
}

void board_read_sensors(void *board, struct amb_sensors *sensors) {
    struct hosted *h = board;
    memcpy(sensors->position, h->position, h->target.config->axes * sizeof *h->position);
    if (h->target.config->coils) memcpy(sensors->coil, h->coil, h->target.config->coils * sizeof *h->coil);
    sensors->temperature = h->temperature;
    sensors->amplifier_fault = h->fault;
}

void board_write_currents(void *board, const double *current, bool enabled) {
    struct hosted *h = board;
    memcpy(h->current, current, h->target.config->axes * sizeof *current);
    h->enabled = enabled;
}

void board_enable(void *board, bool on) { ((struct hosted *)board)->hardware_enable = on; }

uint64_t board_time(void *board) { return ((struct hosted *)board)->time; }

void board_random(void *board, uint8_t *bytes, size_t count) { memcpy(bytes, ((struct hosted *)board)->random, count); }

size_t board_receive(void *board, uint8_t *frame, size_t space, struct amb_peer *from) {
    struct hosted *h = board;
    size_t length = h->length;
    h->length = 0;
    if (length) memcpy(frame, h->received, length < space ? length : space);
    *from = h->from;
    return length;
}

bool board_send(void *board, const uint8_t *frame, size_t length, const struct amb_peer *to) {
    struct hosted *h = board;
    if (h->stop - h->first == HOSTED_FRAMES) return false;
    size_t slot = h->stop++ % HOSTED_FRAMES;
    memcpy(h->sent[slot], frame, length);
    h->lengths[slot] = length, h->to[slot] = *to;
    return true;
}

void board_lock(void *board) { (void)board; }
void board_unlock(void *board) { (void)board; }
