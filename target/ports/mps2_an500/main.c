/* A port to a Cortex-M7 without an operating system: ARM's MPS2 board with FPGA image AN500, which QEMU has, too.
 *
 * UART 0 is the link: AMB-UDP over a byte stream. UART 1 stands for converters, amplifiers, sample timer and generator of
 * random numbers: a bench sends the measurement of each step and gets the currents back, in lock-step. So a run is the
 * same every time, bit for bit. Packets of the bench, in COBS: nonce 16 bytes; step: time (ns, u64), temperature (f64),
 * positions, coil currents (f64), fault (u8); answer: currents (f64), enabled, hardware enable (u8), ticks of the
 * processor's clock in the control step, stack used (u32). */
#include "../../board.h"
#include "../stream.h"

#include <string.h>

enum { RATE = 10000, SAMPLES = 20000, AXES = 2, COILS = 4, STEP = 8 + 8 + 8 * AXES + 8 * COILS + 1 };

#define WORD(address) (*(volatile uint32_t *)(address))
enum { UART_DATA = 0x0, UART_STATE = 0x4, UART_CONTROL = 0x8, UART_DIVISOR = 0x10, UART_FULL = 1, UART_THERE = 2 };
static const uint32_t LINK = 0x40004000, BENCH = 0x40005000, SYSTICK = 0xe000e010;

static uint8_t waveform[SAMPLES * AXES * 8];
static uint32_t record[RATE * (3 * AXES + 1)]; /* a second */
static struct amb_target target;
static const struct amb_config config = {
    .machine = "point_mass", .firmware = "mps2_an500", .sample_rate = RATE, .firmware_version = 0x010000, .axes = AXES,
    .coils = COILS,
    .axis = {{"x", "a", {0, 0, 1, 0, 0, 2.5, 2.5, 250e-6}}, {"y", "a", {0, 0, 0, 1, 0, 2.5, 2.5, 250e-6}}},
    .limits = {3, 10, 1e-3, 0.4, 0.5, 100e-6, 10, 1e-3, 0.02, 100, 0.02, 1e9, 0.01, 0.2, 100, 0.01, 1.2, 0.2, 0.05, 1, 0.2},
    .gains = {{20000, 38, 0, RATE, 1}, {20000, 38, 0, RATE, 1}}, .waveform = waveform, .waveform_size = sizeof waveform,
    .record = record, .record_words = RATE * (3 * AXES + 1)};
static struct amb_stream link, bench;
static uint8_t measured[STEP], answer[8 * AXES + 2 + 8];
static size_t waiting; /* bytes of a frame of the link that nobody has taken yet */

uint32_t stack_used(void);

static void prepare(uint32_t uart) {
    WORD(uart + UART_DIVISOR) = 16;
    WORD(uart + UART_CONTROL) = 3; /* sends and receives */
}

static size_t take(uint32_t uart, struct amb_stream *stream) {
    return WORD(uart + UART_STATE) & UART_THERE ? amb_stream_take(stream, (uint8_t)WORD(uart + UART_DATA)) : 0;
}

static void put(uint32_t uart, const uint8_t *frame, size_t length) {
    static uint8_t coded[AMB_STREAM_ROOM];
    size_t count = amb_stream_put(frame, length, coded);
    for (size_t i = 0; i < count; i++) {
        while (WORD(uart + UART_STATE) & UART_FULL) {}
        WORD(uart + UART_DATA) = coded[i];
    }
}

static double number(const uint8_t *from) {
    double value;
    memcpy(&value, from, 8);
    return value;
}

void board_read_sensors(void *board, struct amb_sensors *sensors) {
    (void)board;
    sensors->temperature = number(measured + 8);
    for (size_t i = 0; i < AXES; i++) sensors->position[i] = number(measured + 16 + 8 * i);
    for (size_t i = 0; i < COILS; i++) sensors->coil[i] = number(measured + 16 + 8 * (AXES + i));
    sensors->amplifier_fault = measured[STEP - 1] != 0;
}

void board_write_currents(void *board, const double *current, bool enabled) {
    (void)board;
    memcpy(answer, current, 8 * AXES);
    answer[8 * AXES] = enabled;
}

void board_enable(void *board, bool on) { (void)board, answer[8 * AXES + 1] = on; }

uint64_t board_time(void *board) {
    uint64_t time;
    (void)board;
    memcpy(&time, measured, 8);
    return time;
}

void board_random(void *board, uint8_t *bytes, size_t count) {
    (void)board;
    while (take(BENCH, &bench) != count) {} /* QEMU has no generator; a board has one, or see PORTING.md */
    memcpy(bytes, bench.frame, count);
}

size_t board_receive(void *board, uint8_t *frame, size_t space, struct amb_peer *from) {
    size_t length = waiting;
    (void)board;
    waiting = 0;
    memcpy(frame, link.frame, length < space ? length : space);
    *from = (struct amb_peer){0, 0, true}; /* the other end of a cable; behind a radio or a server of ports: false */
    return length;
}

bool board_send(void *board, const uint8_t *frame, size_t length, const struct amb_peer *to) {
    (void)board, (void)to;
    put(LINK, frame, length);
    return true;
}

void board_lock(void *board) {
    (void)board;
    __asm__ volatile("cpsid i" ::: "memory");
}

void board_unlock(void *board) {
    (void)board;
    __asm__ volatile("cpsie i" ::: "memory");
}

/* Ticks of the processor's clock, downwards; in QEMU with -icount shift=10 one instruction takes 25.6 of them. */
static uint32_t ticks(void) { return WORD(SYSTICK + 8); }
static void since(uint32_t before, uint8_t *to) {
    uint32_t passed = (before - ticks()) & 0xffffff;
    memcpy(to, &passed, 4);
}

int main(void) {
    prepare(LINK), prepare(BENCH);
    WORD(SYSTICK + 4) = 0xffffff, WORD(SYSTICK + 8) = 0, WORD(SYSTICK) = 5;
    if (!amb_init(&target, &config, NULL)) return 1;
    for (;;) {
        if (take(BENCH, &bench) == STEP) {
            memcpy(measured, bench.frame, STEP);
            uint8_t *figures = answer + 8 * AXES + 2;
            uint32_t before = ticks();
            amb_control_step(&target);
            since(before, figures);
            amb_poll(&target);
            uint32_t used = stack_used();
            memcpy(figures + 4, &used, 4);
            put(BENCH, answer, sizeof answer);
        }
        waiting = take(LINK, &link);
        if (waiting) amb_poll(&target);
    }
}
