/* Instructions for which the background of the C target keeps the sample interrupt out: target_sections. A child runs the
 * longest commands and breaks in board_lock; from there its parent goes on step by step until board_unlock. Prints the
 * longest section of each type of command as JSON. x86-64 Linux. */
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/ptrace.h>
#include <sys/wait.h>
#include <unistd.h>

#include "parts.h"

enum { AXES = 16, TYPES = 256, CHUNKS = 4096 };
struct shared { volatile int locked, type; };

static struct shared *shared;
static struct amb_target target;
static uint8_t *waveform, waiting[AMB_FRAME];
static uint32_t record[100 * (3 * AXES + 1)];
static size_t length;
static uint64_t counter, now;
static struct amb_config config = {
    .machine = "long", .firmware = "sections", .sample_rate = 10000, .axes = AXES, .coils = 2 * AXES, .key_length = 16,
    .limits = {3, 12, 1e-3, 0.4, 0.5, 100e-6, 10, 1e-3, 0.02, 120, 0.02, 1e9, 0.01, 0.5, 20, 0.01, 1.2, 0.2, 0.05, 0.05, 0.2},
    .waveform_size = CHUNKS * AMB_CHUNK, .record = record, .record_words = sizeof record / sizeof *record};

void board_lock(void *board) {
    (void)board;
    shared->locked = 1;
    __asm__ volatile("int3");
}
void board_unlock(void *board) { (void)board, shared->locked = 0; }
uint64_t board_time(void *board) { return (void)board, now += 100000; }
void board_random(void *board, uint8_t *bytes, size_t count) { (void)board, memset(bytes, 7, count); }
void board_enable(void *board, bool on) { (void)board, (void)on; }
void board_write_currents(void *board, const double *current, bool on) { (void)board, (void)current, (void)on; }
bool board_send(void *board, const uint8_t *frame, size_t size, const struct amb_peer *to) {
    return (void)board, (void)frame, (void)size, (void)to, true;
}

void board_read_sensors(void *board, struct amb_sensors *sensors) {
    (void)board;
    for (size_t a = 0; a < AXES; a++) sensors->position[a] = 1e-8 * (double)((now / 100000 + a) % 7);
}

size_t board_receive(void *board, uint8_t *frame, size_t space, struct amb_peer *from) {
    size_t size = length;
    (void)board, (void)space;
    memcpy(frame, waiting, size);
    *from = (struct amb_peer){1, 2, false};
    length = 0;
    return size;
}

static void send(uint8_t type, uint64_t step, const void *body, size_t size) {
    uint8_t *end = waiting + AMB_SEALED + size;
    amb_put(waiting + AMB_HEADER, type == AMB_CURRENT ? 0 : ++counter, 8);
    memcpy(waiting + AMB_SEALED, body, size);
    amb_close(&target, waiting, end + AMB_TAG, type, step);
    amb_tag(&target, waiting, (size_t)(end - waiting), end);
    length = amb_close(&target, waiting, end + AMB_TAG, type, step);
    shared->type = type;
    amb_poll(&target);
    shared->type = 0;
}

static void upload(uint32_t id, uint8_t kind, uint32_t order, uint32_t inputs, uint32_t size, uint32_t steps) {
    static uint8_t zeros[CHUNKS * AMB_CHUNK];
    uint8_t begin[24] = {kind, 0, (uint8_t)order, 0, (uint8_t)inputs}, data[8 + AMB_CHUNK] = {0};
    amb_put(begin + 8, id, 4), amb_put(begin + 12, size, 4), amb_put(begin + 20, steps, 4);
    amb_put(begin + 16, amb_crc32(0, zeros, size), 4);
    send(AMB_BEGIN, 0, begin, 24);
    uint32_t chunks = (size + AMB_CHUNK - 1) / AMB_CHUNK;
    for (uint32_t chunk = 0; chunk < chunks; chunk++) {
        amb_put(amb_put(data, id, 4), chunk, 4);
        if (chunk % 512 && chunk + 1 < chunks) { /* most of them without their sections being counted */
            amb_data(&target, data, 8 + AMB_CHUNK);
            continue;
        }
        send(AMB_DATA, 0, data, 8 + (chunk + 1 < chunks ? AMB_CHUNK : size - chunk * AMB_CHUNK));
    }
    send(AMB_BITMAP, 0, data, 4);
    for (uint32_t chunk = 0; chunk < chunks; chunk++) amb_digest(&target);
    send(AMB_COMMIT, 0, data, 4);
    send(AMB_ARM, target.step + 1000, data, 8);
}

static void numbers(uint64_t kind, size_t count, double value) {
    uint8_t body[8 + 8 * AXES * AMB_GAINS], *p = amb_put(body, kind, 8);
    for (size_t i = 0; i < count; i++)
        p = amb_put_double(p, kind == 1 ? config.gains[0][i % AMB_GAINS] : kind == 4 ? config.limits[i] : value);
    send(AMB_PARAMETERS, 0, body, (size_t)(p - body));
}

static void child(void) {
    uint8_t word[8] = {0}, stream[8] = {7, 0, 2};
    ptrace(PTRACE_TRACEME, 0, NULL, NULL);
    raise(SIGSTOP);
    waveform = calloc(CHUNKS, AMB_CHUNK);
    config.waveform = waveform;
    for (size_t a = 0; a < AXES; a++) {
        config.axis[a] = (struct amb_axis){"", "", {0, 0, 1, 0, 0, 2.5, 3, 250e-6}};
        config.axis[a].bearing[0] = (char)('a' + a / 2);
        memcpy(config.gains[a], (double[]){20000, 38, 0, 10000, 1}, sizeof config.gains[a]);
    }
    if (!amb_init(&target, &config, NULL)) exit(2);
    amb_control_step(&target);
    send(AMB_STREAM, 0, stream, 8);
    upload(1, 2, 4, AXES, 8 * (16 + 2 * 64 + 2 * 64 + 256 + 16 + 16), 0);
    for (int on = 0; on < 2; on++) {
        for (uint64_t kind = 1; kind <= 4; kind++) numbers(kind, kind == 1 ? AXES * AMB_GAINS : kind == 4 ? AMB_LIMITS : AXES, 1e-5);
        amb_put_double(word, on ? 0.5 : 0.001);
        send(on ? AMB_DELEVITATE : AMB_LEVITATE, 0, word, 8);
        for (int i = 0; i < 20; i++) amb_control_step(&target);
        if (!on) upload(2, 1, 0, 0, CHUNKS * AMB_CHUNK, CHUNKS * AMB_CHUNK / 8 / AXES);
    }
    for (uint8_t reason = 1; reason < AMB_REASONS; reason++) amb_trip(&target, reason, 0, 1.0);
    memset(word, 0, sizeof word);
    send(AMB_RECORD, 0, word, 8);
    send(AMB_HEARTBEAT, 0, word, 0), send(AMB_CLOCK, 0, word, 8), send(AMB_FAULT_RESET, 0, word, 0);
    exit(0);
}

int main(void) {
    static unsigned long longest[TYPES];
    int status;
    shared = mmap(NULL, sizeof *shared, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    pid_t pid = fork();
    if (pid == 0) child();
    waitpid(pid, &status, 0);
    if (WIFEXITED(status)) return 3; /* it must not be traced here */
    for (;;) {
        ptrace(PTRACE_CONT, pid, NULL, NULL);
        if (waitpid(pid, &status, 0) < 0 || WIFEXITED(status) || WIFSIGNALED(status)) break;
        unsigned long count = 0;
        while (shared->locked && WIFSTOPPED(status)) {
            ptrace(PTRACE_SINGLESTEP, pid, NULL, NULL);
            waitpid(pid, &status, 0);
            count++;
        }
        if (count > longest[shared->type]) longest[shared->type] = count;
    }
    printf("{\"ended\": %d", WIFEXITED(status) ? WEXITSTATUS(status) : -1);
    for (size_t i = 0; i < TYPES; i++)
        if (longest[i]) printf(", \"%zu\": %lu", i, longest[i]);
    printf("}\n");
    return 0;
}
