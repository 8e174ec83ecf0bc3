/* Reference target of AMB-UDP (docs/reference/target-protocol.md): the control loop of a machine on active magnetic bearings.
 *
 * amb_control_step runs in the sample interrupt, amb_poll in the background. Memory is static; see PORTING.md. */
#ifndef AMB_TARGET_H
#define AMB_TARGET_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Sizes: most axes, states of a state-space controller, numbers in its matrices, chunks of an upload (at most 8192). */
#ifndef AMB_AXES
#define AMB_AXES 16
#define AMB_ORDER 32
#define AMB_MATRICES 768
#define AMB_CHUNKS 4096
#endif

/* Bytes. FRAME: Ethernet's 1500 without the headers of IP and UDP. SEALED: where the body of an authenticated frame
 * starts, after its counter. HELLO_LENGTH: shortest payload of a hello, at least as long as the answer to it. */
enum {
    AMB_VERSION = 2, AMB_FRAME = 1472, AMB_HEADER = 24, AMB_SEALED = 32, AMB_TAG = 16, AMB_CRC = 4, AMB_NONCE = 16,
    AMB_CHALLENGE = 16, AMB_KEY = 64, AMB_SHORTEST_KEY = 16, AMB_CHUNK = 1408, AMB_HELLO_LENGTH = 1152
};

enum amb_type {
    AMB_HELLO = 0x01, AMB_HEARTBEAT = 0x10, AMB_STREAM, AMB_LEVITATE, AMB_DELEVITATE, AMB_FAULT_RESET, AMB_CLOCK,
    AMB_BEGIN, AMB_DATA, AMB_BITMAP, AMB_COMMIT, AMB_ARM, AMB_DISARM, AMB_PARAMETERS, AMB_CONTROLLER, AMB_CURRENT,
    AMB_RECORD, AMB_DESCRIPTION = 0x81, AMB_REPLY, AMB_TELEMETRY = 0x90, AMB_STATUS
};
/* Codes of replies; the last stands for none at all. */
enum amb_code {
    AMB_DONE, AMB_WRONG_STATE, AMB_BAD_LENGTH, AMB_BAD_VALUE, AMB_BEYOND_LIMIT, AMB_UNKNOWN, AMB_NO_UPLOAD,
    AMB_INCOMPLETE, AMB_CHECKSUM, AMB_TOO_LATE, AMB_LATCHED, AMB_TOO_LARGE, AMB_BUSY, AMB_LOCKED, AMB_SILENT = 0xff
};
enum amb_state { AMB_OFF, AMB_LEVITATING, AMB_LEVITATED, AMB_LANDING, AMB_TRIPPED };
/* LAW: a current that is not finite. HOST_SILENT and EXCITATION stop the excitation; the loop goes on. */
enum amb_reason {
    AMB_DISPLACEMENT = 1, AMB_SENSOR_RANGE, AMB_SENSOR_STUCK, AMB_OVER_CURRENT, AMB_TEMPERATURE, AMB_AMPLIFIER,
    AMB_WATCHDOG, AMB_LAW, AMB_HOST_SILENT, AMB_EXCITATION, AMB_SATURATED, AMB_REASONS
};
/* Limits, in their order in frames; docs/reference/target-protocol.md, Protection, has their units and consequences.
 * The host may lower them, never raise them above those of the configuration. */
enum amb_limit {
    AMB_CURRENT_LIMIT, AMB_COIL_LIMIT, AMB_COIL_TIME, AMB_ALARM_SHARE, AMB_TRIP_SHARE, AMB_AMPLITUDE_LIMIT,
    AMB_SLEW_LIMIT, AMB_SENSOR_LIMIT, AMB_STUCK_TIME, AMB_TEMPERATURE_LIMIT, AMB_HOST_TIME, AMB_LAND_TIME,
    AMB_FADE_TIME, AMB_SETTLE_TIME, AMB_MISSED_LIMIT, AMB_REFERENCE_SLEW, AMB_CONTACT_SHARE, AMB_LIFT_TIME,
    AMB_SATURATION_TIME, AMB_MISSED_SHARE, AMB_LOCK_TIME, AMB_LIMITS
};
enum amb_gain { AMB_PROPORTIONAL, AMB_DERIVATIVE, AMB_KEEP, AMB_WEIGHT, AMB_ON_ERROR, AMB_GAINS };
/* Counted since boot: control steps missed; frames damaged or of another boot, forged, replayed; frames not sent. */
enum { AMB_MISSED, AMB_BAD, AMB_FORGED, AMB_REPLAYED, AMB_UNSENT, AMB_COUNTS };
/* Axial positions of sensor and magnets (m; NaN: unknown), direction in the stator frame, bias current (A), largest
 * control current that the coils follow (A), displacement at which the rotor touches (m). */
enum { AMB_SENSOR_AT, AMB_ACTUATOR_AT, AMB_DIRECTION, AMB_BIAS = 5, AMB_FOLLOWED, AMB_CLEARANCE, AMB_NUMBERS };
struct amb_axis { char name[16], bearing[16]; double number[AMB_NUMBERS]; };

struct amb_config {
    char machine[32], firmware[32];
    double sample_rate;
    uint32_t firmware_version;
    uint8_t axes, coils, key_length, key[AMB_KEY];
    struct amb_axis axis[AMB_AXES];
    double limits[AMB_LIMITS], gains[AMB_AXES][AMB_GAINS];
    uint8_t *waveform; /* buffer of uploads, of so many bytes: */
    uint32_t waveform_size;
    uint32_t *record, record_words; /* buffer of the second before a trip: 3 axes + 1 words a step; 0: none is kept */
};

struct amb_peer { uint32_t address; uint16_t port; bool loopback; };
struct amb_sensors {
    double position[AMB_AXES], coil[2 * AMB_AXES]; /* (m), and as many measured coil currents as there are (A) */
    double temperature;                            /* (deg C); 0 without a sensor */
    bool amplifier_fault;
};

struct amb_trip { uint8_t reason, axis; uint64_t step; double value; };
struct amb_upload {
    uint8_t kind;
    bool complete;
    uint16_t order, inputs;
    uint32_t id, size, crc, steps, chunks, arrived, checked, sum;
    double amplitude, slew;  /* infinite amplitude: a number is not finite */
    double reach[AMB_AXES];  /* radially, of each bearing (m) */
    uint8_t bitmap[(AMB_CHUNKS + 7) / 8];
};

struct amb_target {
    const struct amb_config *config;
    void *board;
    uint64_t step, last_time, period, last_heard;
    enum amb_state state;
    /* Protection */
    struct amb_trip trip[AMB_REASONS];
    uint8_t trips, group[AMB_AXES]; /* group: the first axis of the bearing, which stands for it */
    bool alarm, report, measured;   /* measured: since the start, and since the latest reset */
    uint32_t stuck[AMB_AXES], away[AMB_AXES], saturated[AMB_AXES], over[2 * AMB_AXES], lock_left, count[AMB_COUNTS];
    double limits[AMB_LIMITS], share[AMB_AXES], debt, own_debt; /* displacement over clearance; steps missed lately */
    /* Loop: `ramp_left` of `ramp` steps from the reference `from` to the nominal or the landing one; and as many of the
     * gains from `former` to `wanted` */
    struct amb_sensors sensors;
    double nominal[AMB_AXES], landing[AMB_AXES], from[AMB_AXES], before[AMB_AXES];
    double reference[AMB_AXES], current[AMB_AXES];
    uint32_t ramp, ramp_left, settle_left, gain_ramp, gain_left;
    double wanted[AMB_AXES][2], former[AMB_AXES][2];
    /* Controllers */
    enum { AMB_PD, AMB_STATE_SPACE, AMB_HOST, AMB_HOST_OR_LAND } law; /* without the host: off, or the PD lands */
    bool matrices_ready, begun; /* the background copies matrices without the lock: while nothing uses them */
    double gains[AMB_AXES][AMB_GAINS], derivative[AMB_AXES], differentiated[AMB_AXES];
    uint16_t order, inputs;
    uint64_t answered, spent; /* steps of the latest current of the host, and of the latest that was genuine */
    double matrices[AMB_MATRICES], x[AMB_ORDER], after[AMB_ORDER], input[2 * AMB_AXES];
    /* Excitation */
    enum { AMB_NONE, AMB_ARMED, AMB_PLAYING, AMB_FADING } excitation;
    uint64_t start;
    uint32_t fade_left;
    double value[AMB_AXES];
    struct amb_upload upload;
    /* Second before a trip: the step after its last row, where the next one goes, how many there are */
    struct { uint64_t end; uint32_t next, rows; bool kept; } record;
    /* Communication */
    uint8_t nonce[AMB_NONCE], last_tag[AMB_TAG], last_type, last_code;
    uint32_t session, sequence;
    uint64_t counter, last_status;
    struct amb_peer peer;
    uint16_t per_frame, row, filled;
    uint8_t options, filling;
    bool pending;
    uint64_t first[2];
    uint8_t block[2][AMB_FRAME], io[AMB_FRAME];
};

/* False if the configuration is for another machine than this code is compiled for, has a number that is none, a limit
 * that is not positive, no limit of the current, too low a reference slew to land, or a key of fewer than 16 bytes. */
bool amb_init(struct amb_target *t, const struct amb_config *config, void *board);
void amb_control_step(struct amb_target *t); /* once per sample, at the highest priority */
void amb_poll(struct amb_target *t);         /* as often as possible, in the background: receives and sends */

#endif
