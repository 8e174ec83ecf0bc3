/* The functions of a port to a microcontroller, an example each. `registers` stands for those that the manufacturer's
 * header names. It is compiled by a test, and has run on no board: replace registers, pins and numbers by your own. */
#include "../board.h"
#include "stream.h"
#include "calibration.h"

enum { AXES = 2, PERIOD = 1000, RING = 4096, LAST_CODE = 4095 };

extern volatile struct {
    uint16_t position[AXES], coil[2 * AXES], temperature; /* converters, triggered by the sample timer */
    uint32_t compare[2 * AXES];                           /* PWM timer */
    uint32_t pins, fault_pins, cycles, cycles_high, random, random_ready, watchdog, interrupts;
} registers;
bool usb_write(const uint8_t *bytes, size_t count); /* of the driver: false if it has no room */
extern volatile uint8_t ring[RING];                 /* filled by the driver's interrupt up to ring_end */
extern volatile size_t ring_end;

static const struct position_calibration sensor[AXES] = {
    {3, {410, 2050, 3690}, {-300e-6, 2e-6, 300e-6}}, {3, {395, 2040, 3705}, {-300e-6, -1e-6, 300e-6}}};
static const double BIAS = 2.5, FULL_CURRENT = 10.0, FULL_TEMPERATURE = 200.0, COSINE = 0.70710678118654752,
                    SINE = 0.70710678118654752;
static const uint32_t AMPLIFIERS_ON = 1u << 3, AMPLIFIER_FAULT = 1u << 4;

/* ADC: scale, linearise, turn the sensors at 45 degrees into the axes of the magnets; coils +x, -x, +y, -y. */
void board_read_sensors(void *board, struct amb_sensors *s) {
    (void)board;
    for (int i = 0; i < AXES; i++) s->position[i] = calibrated_position(&sensor[i], registers.position[i]);
    turned_back(COSINE, SINE, &s->position[0], &s->position[1]);
    for (int i = 0; i < 2 * AXES; i++) s->coil[i] = calibrated_current(2048, 0.005, registers.coil[i]);
    s->temperature = calibrated_temperature(FULL_TEMPERATURE, LAST_CODE, registers.temperature);
    s->amplifier_fault = (registers.fault_pins & AMPLIFIER_FAULT) != 0;
}

/* PWM: bias plus and minus the control current, or nothing at all; and the watchdog that switches off without it. */
void board_write_currents(void *board, const double *current, bool enabled) {
    (void)board;
    for (int i = 0; i < AXES; i++) {
        registers.compare[2 * i] = compare_value(BIAS + current[i], FULL_CURRENT, PERIOD, enabled);
        registers.compare[2 * i + 1] = compare_value(BIAS - current[i], FULL_CURRENT, PERIOD, enabled);
    }
    registers.watchdog = 0xaaaa;
}

/* Enable: a pin of its own, which no timer can set. */
void board_enable(void *board, bool on) {
    (void)board;
    registers.pins = on ? registers.pins | AMPLIFIERS_ON : registers.pins & ~AMPLIFIERS_ON;
}

/* Timer: two counters of 32 bits in a chain, at 400 MHz; read again if the low one wrapped meanwhile. */
uint64_t board_time(void *board) {
    uint32_t high, low;
    (void)board;
    do high = registers.cycles_high, low = registers.cycles;
    while (high != registers.cycles_high);
    return ((uint64_t)high << 32 | low) * 5 / 2;
}

/* Generator: each number only once it is ready, or the same one is drawn again. */
void board_random(void *board, uint8_t *bytes, size_t count) {
    (void)board;
    for (size_t i = 0; i < count; i++) {
        while (!registers.random_ready) {}
        bytes[i] = (uint8_t)registers.random;
    }
}

/* Transport: a USB port as a byte stream. */
size_t board_receive(void *board, uint8_t *frame, size_t space, struct amb_peer *from) {
    static struct amb_stream stream;
    static size_t next;
    (void)board;
    while (next != ring_end) {
        size_t length = amb_stream_take(&stream, ring[next]);
        next = (next + 1) % RING;
        if (!length) continue;
        for (size_t i = 0; i < length && i < space && i < AMB_FRAME; i++) frame[i] = stream.frame[i];
        *from = (struct amb_peer){0, 0, false}; /* true: without a key, for one computer at the end of the cable */
        return length;
    }
    return 0;
}

bool board_send(void *board, const uint8_t *frame, size_t length, const struct amb_peer *to) {
    static uint8_t coded[AMB_STREAM_ROOM];
    (void)board, (void)to;
    return usb_write(coded, amb_stream_put(frame, length, coded));
}

/* Lock: the sample interrupt is off, here by a register; on a Cortex-M by PRIMASK or BASEPRI. */
void board_lock(void *board) { (void)board, registers.interrupts = 0; }
void board_unlock(void *board) { (void)board, registers.interrupts = 1; }
