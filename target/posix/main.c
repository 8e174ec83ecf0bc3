/* The target on Linux, for tests of a link over real UDP: amb_target PORT [KEY_FILE [ADDRESS]]. The file has the key in
 * hexadecimal digits; ADDRESS, by default 127.0.0.1, is where it listens. Its rotor is a point mass in each axis on linear
 * magnets; timing is as good as the scheduler's. */
#define _POSIX_C_SOURCE 200809L

#include <arpa/inet.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include "../board.h"

enum { RATE = 10000, SAMPLES = 100000, AXES = 2 };

static uint8_t waveform[SAMPLES * AXES * 8];
static uint32_t record[RATE * (3 * AXES + 1)]; /* a second */
static struct amb_target target;
static struct amb_config config = {
    .machine = "point_mass", .firmware = "posix", .sample_rate = RATE, .firmware_version = 0x010000, .axes = AXES,
    .axis = {{"x", "a", {0, 0, 1, 0, 0, 2.5, 2.5, 250e-6}}, {"y", "a", {0, 0, 0, 1, 0, 2.5, 2.5, 250e-6}}},
    .limits = {3, 10, 1e-3, 0.4, 0.5, 100e-6, 10, 1e-3, 0.02, 100, 0.02, 1e9, 0.01, 0.2, 100, 0.01, 1.2, 0.2, 0.05, 1, 0.2},
    .gains = {{20000, 38, 0, RATE, 1}, {20000, 38, 0, RATE, 1}}, .waveform = waveform, .waveform_size = sizeof waveform,
    .record = record, .record_words = RATE * (3 * AXES + 1)};
static double position[AXES] = {-20e-6, 10e-6}, velocity[AXES];
static int udp;

void board_read_sensors(void *board, struct amb_sensors *sensors) {
    (void)board;
    memcpy(sensors->position, position, sizeof position);
}

void board_write_currents(void *board, const double *current, bool enabled) {
    (void)board;
    for (int i = 0; i < AXES; i++) {
        double acceleration = enabled ? (66.0 * current[i] + 3.3e5 * position[i]) / 6.25 : 0.0;
        velocity[i] = enabled ? velocity[i] + acceleration / RATE : 0.0;
        position[i] += velocity[i] / RATE;
    }
}

void board_enable(void *board, bool on) { (void)board, (void)on; /* a pin, on a board that has one */ }

uint64_t board_time(void *board) {
    struct timespec now;
    (void)board;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (uint64_t)now.tv_sec * 1000000000u + (uint64_t)now.tv_nsec;
}

void board_random(void *board, uint8_t *bytes, size_t count) {
    int file = open("/dev/urandom", O_RDONLY);
    (void)board;
    if (file < 0 || read(file, bytes, count) != (ssize_t)count) abort(); /* without it anybody could replay commands */
    close(file);
}

size_t board_receive(void *board, uint8_t *frame, size_t space, struct amb_peer *from) {
    struct sockaddr_in address;
    socklen_t size = sizeof address;
    (void)board;
    ssize_t length = recvfrom(udp, frame, space, MSG_DONTWAIT | MSG_TRUNC, (struct sockaddr *)&address, &size);
    if (length <= 0) return 0;
    uint32_t ip = ntohl(address.sin_addr.s_addr);
    *from = (struct amb_peer){ip, ntohs(address.sin_port), ip >> 24 == 127};
    return (size_t)length;
}

bool board_send(void *board, const uint8_t *frame, size_t length, const struct amb_peer *to) {
    struct sockaddr_in address = {.sin_family = AF_INET, .sin_port = htons(to->port)};
    (void)board;
    address.sin_addr.s_addr = htonl(to->address);
    return sendto(udp, frame, length, 0, (struct sockaddr *)&address, sizeof address) == (ssize_t)length;
}

/* Steps and background share one thread here. */
void board_lock(void *board) { (void)board; }
void board_unlock(void *board) { (void)board; }

/* Without a message that could show a part of it. */
static bool read_key(const char *path) {
    FILE *file = fopen(path, "r");
    unsigned byte;
    if (!file) return false;
    while (config.key_length < AMB_KEY && fscanf(file, "%2x", &byte) == 1) config.key[config.key_length++] = (uint8_t)byte;
    bool whole = fscanf(file, " %*c") == EOF && config.key_length >= AMB_SHORTEST_KEY;
    fclose(file);
    return whole;
}

int main(int count, char **arguments) {
    struct sockaddr_in address = {.sin_family = AF_INET};
    const char *where = count > 3 ? arguments[3] : "127.0.0.1";
    if (count > 2 && !read_key(arguments[2])) {
        fprintf(stderr, "amb_target: no key in %s; allowed: %d to %d bytes in hexadecimal digits\n", arguments[2],
                AMB_SHORTEST_KEY, AMB_KEY);
        return 1;
    }
    if (inet_pton(AF_INET, where, &address.sin_addr) != 1) {
        fprintf(stderr, "amb_target: address %s; allowed: an IPv4 address\n", where);
        return 1;
    }
    udp = socket(AF_INET, SOCK_DGRAM, 0);
    address.sin_port = htons((uint16_t)(count > 1 ? strtoul(arguments[1], NULL, 10) : 0));
    socklen_t size = sizeof address;
    if (udp < 0 || bind(udp, (struct sockaddr *)&address, size) || !amb_init(&target, &config, NULL)) {
        perror("amb_target");
        return 1;
    }
    getsockname(udp, (struct sockaddr *)&address, &size);
    printf("%u\n", (unsigned)ntohs(address.sin_port));
    fflush(stdout);
    struct timespec next;
    clock_gettime(CLOCK_MONOTONIC, &next);
    for (;;) {
        amb_control_step(&target);
        amb_poll(&target);
        next.tv_nsec += 1000000000 / RATE;
        next.tv_sec += next.tv_nsec / 1000000000;
        next.tv_nsec %= 1000000000;
        clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &next, NULL);
    }
}
