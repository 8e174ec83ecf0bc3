/* Every state that the compiled target can reach with a small configuration: states PART [MOST].
 *
 * Breadth first, from the start: in each state every frame of the part and every measurement of it is tried on the real
 * functions. A state is the memory of the target, moved in time so that the present step is always the same one, without
 * what the control never reads (counts, telemetry, values of trips). So the search ends, and what it has not reached
 * cannot be reached with these frames and measurements. The checks are written anew here, from the protocol, and keep
 * their own counts. Prints what it found as JSON. */
#include <stdio.h>
#include <stdlib.h>

#include "parts.h"

enum { NOW = 1000, KEEP = offsetof(struct amb_target, block), STATES = 1 << 23, MOST_EVENTS = 512, NAME = 32, SILENT = 3 /* steps, after which all times of silence are over */ };

/* What the checks remember, beside the target. */
struct watched {
    uint8_t must_reset, measured, locked, over, saturated, same, missed, settled, commanded;
    double position;
};
struct node { struct watched watched; uint8_t target[KEEP]; };
struct event { char name[NAME]; uint8_t type, spare; int16_t step; uint16_t length; uint8_t body[192]; };
struct measurement { double position, coil, temperature; bool fault; uint8_t missed; };

static uint8_t waveform[64];
static struct amb_config config = {
    .machine = "small", .firmware = "states", .sample_rate = 1000.0, .axes = 1, .coils = 1, .key_length = 16,
    .axis = {{"x", "a", {0, 0, 1, 0, 0, 2.5, 3, 256e-6}}},
    /* Times in steps of 1 ms: coil 2, stuck 2, host 2, land 3, fade 1, settle 1, missed 2, lift 2, saturation 2, lock 2 */
    .limits = {3, 12, 2e-3, 0.375, 0.5, 20e-6, 1.0, 1e-3, 2e-3, 120, 2e-3, 3e-3, 1e-3, 1e-3, 2, 1.0, 1.2, 2e-3, 2e-3, 0.5,
               2e-3},
    .gains = {{32768, 0, 0, 0, 1}}, .waveform = waveform, .waveform_size = sizeof waveform};
static const double NEAR = 16e-6;

static struct { struct amb_target target; struct watched watched; } now, base, held;
static struct amb_target *const t = &now.target;
static struct watched *const w = &now.watched;
static uint64_t moment;
static struct measurement measured;
static bool enabled, hardware;
static size_t sent;

static struct event events[MOST_EVENTS];
static struct measurement measurements[MOST_EVENTS];
static size_t event_count, measurement_count;
static const char *doing = "";
static size_t wrong, transitions, hostile, recovered, repeated;

static void check(bool right, const char *what) {
    if (right) return;
    if (wrong++ < 20)
        fprintf(stderr, "%s in state %d: %s (step: %g m, %g A, %g deg C, fault %d, missed %d)\n", doing, base.target.state,
                what, measured.position, measured.coil, measured.temperature, measured.fault, measured.missed);
}

/* -- the board */

void board_read_sensors(void *board, struct amb_sensors *sensors) {
    (void)board;
    sensors->position[0] = measured.position, sensors->coil[0] = measured.coil;
    sensors->temperature = measured.temperature, sensors->amplifier_fault = measured.fault;
}
void board_write_currents(void *board, const double *current, bool on) {
    (void)board;
    check(fabs(current[0]) <= config.limits[AMB_CURRENT_LIMIT], "a current beyond its limit, or none");
    check(on || current[0] == 0.0, "a current while off");
    check(!on || !w->must_reset, "powered after a trip without a reset");
    check(on == hardware, "the two enables differ");
    enabled = on;
}
void board_enable(void *board, bool on) { (void)board, hardware = on; }
uint64_t board_time(void *board) { return (void)board, moment; }
void board_random(void *board, uint8_t *bytes, size_t count) { (void)board, memset(bytes, 0xa5, count); }
size_t board_receive(void *board, uint8_t *frame, size_t space, struct amb_peer *from) {
    return (void)board, (void)frame, (void)space, (void)from, 0;
}
bool board_send(void *board, const uint8_t *frame, size_t length, const struct amb_peer *to) {
    (void)board, (void)frame, (void)length, (void)to;
    sent++;
    return true;
}
void board_lock(void *board) { (void)board; }
void board_unlock(void *board) { (void)board; }

/* -- one state for all that differ only in time, or in what is never read */

static bool latched_off(void) {
    for (size_t i = 0; i < t->trips; i++)
        if (t->trip[i].reason != AMB_HOST_SILENT && t->trip[i].reason != AMB_EXCITATION) return true;
    return false;
}

static void normalise(void) {
    bool on = amb_levitating(t);
    if (t->step) { /* the first step is another one: nothing has been missed before it */
        uint64_t by = NOW - t->step;
        t->last_heard = t->last_heard + SILENT < t->step ? NOW - SILENT : t->last_heard + by;
        t->spent = t->spent + 3 < t->step ? NOW - 3 : t->spent + by;
        t->answered = amb_by_host(t) ? t->answered + by : 0;
        t->start = t->excitation == AMB_ARMED || t->excitation == AMB_PLAYING ? t->start + by : 0;
        t->step = NOW;
        t->last_time = moment = (uint64_t)NOW * t->period;
    }
    if (t->trips) { /* the control reads whether there is one; what it was is only reported */
        bool off = latched_off();
        memset(t->trip, 0, sizeof t->trip);
        t->trips = 1, t->trip[0].reason = off ? AMB_AMPLIFIER : AMB_HOST_SILENT;
    }
    memset(t->count, 0, sizeof t->count);
    memset(t->last_tag, 0, sizeof t->last_tag);
    t->last_type = t->last_code = 0, t->counter = t->last_status = 0, t->sequence = 0, t->report = false;
    t->differentiated[0] = 0.0; /* the derivative gain is 0 */
    t->sensors.coil[0] = t->sensors.temperature = 0.0, t->sensors.amplifier_fault = false; /* measured anew */
    if (t->over[0] > 2) t->over[0] = 2; /* more than its time */
    memset(t->after, 0, sizeof t->after), memset(t->input, 0, sizeof t->input);
    if (!t->ramp_left) t->ramp = 0, t->from[0] = 0.0;
    if (!t->gain_left) t->gain_ramp = 0, memset(t->wanted, 0, sizeof t->wanted), memset(t->former, 0, sizeof t->former);
    if (t->excitation != AMB_FADING) t->fade_left = 0;
    if (!on) t->settle_left = 0, t->debt = t->own_debt = 0.0, t->reference[0] = 0.0, t->last_heard = t->step; /* set by LEVITATE */
    w->missed = 0;
    w->position = t->step ? measured.position : 0.0;
}

/* -- what the target is checked for, by counts of its own */

static void follow(void) { /* after anything: what is latched, and what the outputs are */
    bool on = t->state == AMB_LEVITATING || t->state == AMB_LEVITATED || t->state == AMB_LANDING;
    check(t->state <= AMB_TRIPPED, "a state that is none");
    if (latched_off()) w->must_reset = 1;
    check(!w->must_reset || !on, "levitated after a trip without a reset");
    check((t->state == AMB_TRIPPED) <= (w->must_reset != 0), "tripped without a trip");
    check(on || t->excitation == AMB_NONE, "excited while off");
    for (size_t i = 0; i < AMB_LIMITS; i++) check(t->limits[i] > 0.0 && t->limits[i] <= config.limits[i], "a limit was raised");
}

static void take_step(const struct measurement *m) {
    const double *limit = t->limits, clearance = config.axis[0].number[AMB_CLEARANCE];
    bool was_on = amb_levitating(t), displaced = false, was_levitated = t->state == AMB_LEVITATED;
    measured = *m;
    enabled = hardware = was_on;
    moment = t->last_time + (t->step ? t->period * (1u + m->missed) : 0u);
    if (w->locked) w->locked--;
    w->over = (uint8_t)(fabs(m->coil) <= limit[AMB_COIL_LIMIT] ? 0 : w->over < 2 ? w->over + 1 : 2);
    w->saturated = (uint8_t)(was_on && fabs(t->current[0]) >= limit[AMB_CURRENT_LIMIT] ? w->saturated + 1 : 0);
    w->same = (uint8_t)(was_levitated && m->position == w->position ? w->same + 1 : 0);
    w->missed = (uint8_t)(was_on ? m->missed : 0);
    bool settled = was_levitated && !t->settle_left;
    amb_control_step(t);
    bool on = amb_levitating(t);
    for (size_t i = 0; i < t->trips; i++) displaced = displaced || t->trip[i].reason == AMB_DISPLACEMENT;
    if (displaced && was_on && !on) w->locked = 2;
    check(enabled == on && hardware == on, "outputs and state differ");
    check(!on || was_on, "powered by no command");
    check(!on || fabs(m->position) <= limit[AMB_SENSOR_LIMIT], "powered with a position beyond its range, or none");
    check(!on || fabs(m->position) <= limit[AMB_CONTACT_SHARE] * clearance, "powered beyond the contact share");
    check(!on || !settled || t->state == AMB_LANDING || fabs(m->position) <= limit[AMB_TRIP_SHARE] * clearance, "powered beyond the trip share");
    check(!on || w->over < 2, "powered with a coil above its current for its time");
    check(!on || m->temperature <= limit[AMB_TEMPERATURE_LIMIT], "powered when too hot, or without a temperature");
    check(!on || !m->fault, "powered with a fault of the amplifiers");
    check(!on || w->saturated < 2, "powered with a current at its limit for its time");
    check(!on || w->same < 2, "powered with a sensor that is stuck for its time");
    check(!on || w->missed < 2, "powered after so many steps missed");
    check(fabs(t->current[0]) <= limit[AMB_CURRENT_LIMIT], "a current beyond the limit in force");
    check(!on || isfinite(t->reference[0]), "a reference that is no number");
    w->measured = 1;
    follow();
    transitions++;
}

/* -- frames */

static size_t seal(uint8_t *frame, const struct event *e, uint64_t counter, uint64_t step) {
    uint8_t *p = amb_put(frame + AMB_HEADER, counter, 8);
    p = amb_put_bytes(p, e->body, e->length);
    amb_close(t, frame, p + AMB_TAG, e->type, step);
    amb_tag(t, frame, (size_t)(p - frame), p);
    return amb_close(t, frame, p + AMB_TAG, e->type, step);
}

/* Whether the target is as it was held, but for what it counts. */
static void unchanged(bool powered, const char *what) {
    held.target.sequence = t->sequence;
    memcpy(held.target.count, t->count, sizeof t->count);
    check(!memcmp(&held.target, t, KEEP) && powered == hardware, what);
}

static const struct amb_peer HOST = {0x0a000001, 5000, false};

/* Frames that the host has not made: each leaves all but the counts as it was. */
static void attack(const struct event *e) {
    enum { FORGED, LAST_BYTE, VERSION, SESSION, SHORT, AHEAD, DAMAGED, OLD, HELLO, KINDS };
    struct amb_peer stranger = {0x0a000002, 6000, true};
    uint8_t frame[AMB_FRAME];
    size_t whole = seal(frame, e, t->counter + 1, t->step - 1);
    for (int kind = 0; kind < KINDS; kind++) {
        size_t length = whole;
        memcpy(t->io, frame, whole);
        if (kind == FORGED) t->io[length - AMB_CRC - AMB_TAG] ^= 1;
        if (kind == LAST_BYTE) t->io[length - AMB_CRC - 1] ^= 0x80;
        if (kind == VERSION) t->io[4] = 1;
        if (kind == SESSION) t->io[8] ^= 1;
        if (kind == SHORT) amb_put(t->io + 6, --length - AMB_HEADER - AMB_CRC, 2);
        if (kind == AHEAD) amb_put(t->io + 16, t->step + 100000, 8);
        if (kind <= AHEAD) amb_put(t->io + length - AMB_CRC, amb_crc32(0, t->io, length - AMB_CRC), AMB_CRC);
        if (kind == DAMAGED) t->io[AMB_SEALED] ^= 1;
        if (kind == OLD && e->type == AMB_CURRENT) continue; /* it has no counter; "CURRENT late" is one */
        if (kind == OLD) length = seal(t->io, e, 0, t->step - 1);
        if (kind == HELLO) {
            memset(t->io + AMB_HEADER, 0, AMB_HELLO_LENGTH);
            length = amb_close(t, t->io, t->io + AMB_HEADER + AMB_HELLO_LENGTH, AMB_HELLO, 0);
        }
        bool was = hardware;
        held = now;
        amb_receive(t, length, &stranger);
        unchanged(was, "a frame of a stranger changed something");
        hostile++;
    }
}

/* A genuine frame; the code of its reply. */
static uint8_t command(const struct event *e) {
    bool was_on = amb_levitating(t), current = e->type == AMB_CURRENT;
    uint8_t frame[AMB_FRAME];
    uint64_t counter = t->counter + 1;
    size_t length = seal(frame, e, current ? 0 : counter, t->step + (uint64_t)(int64_t)e->step);
    enabled = hardware = was_on;
    bool locked = w->locked != 0;
    memcpy(t->io, frame, length);
    sent = 0;
    amb_receive(t, length, &HOST);
    uint8_t code = current ? AMB_SILENT : t->last_code;
    if (!current) check(t->counter == counter, "a genuine command was not executed");
    if (!current && e->type != AMB_DATA) check(sent == 1, "a genuine command had no reply");
    if (e->type == AMB_FAULT_RESET) {
        check((code == AMB_LOCKED) == locked, "locked for another time than the lock time");
        if (code == AMB_DONE) w->must_reset = 0, w->measured = 0, w->locked = 0;
    }
    bool on = amb_levitating(t);
    if (on && !was_on) {
        check(e->type == AMB_LEVITATE && code == AMB_DONE, "powered by another command than LEVITATE");
        check(w->measured, "powered without a measurement since the reset");
    } else check(enabled == on && hardware == on, "outputs and state differ after a command");
    if (e->type == AMB_DELEVITATE && amb_get_double(e->body) == 0.0)
        check(code == AMB_DONE && !enabled && !hardware && !on, "DELEVITATE 0 did not switch off at once");
    check(!(code != AMB_DONE && code != AMB_SILENT) || on == was_on, "a refused command changed the power");
    follow();
    if (code == AMB_DONE) { /* the same again, since its reply was lost */
        held = now;
        memcpy(t->io, frame, length);
        amb_receive(t, length, &HOST);
        check(sent == 2, "a repeated command had no reply");
        unchanged(hardware, "a repeated command was executed again");
        repeated++;
    }
    transitions++;
    return code;
}

#include "tried.h"

/* -- the search */

static struct node *nodes[STATES / 4096 + 1];
static uint32_t *table;
static size_t found;
static struct node *node(size_t i) { return &nodes[i / 4096][i % 4096]; }

static void visit(void) {
    struct node here;
    memset(&here, 0, sizeof here);
    normalise();
    here.watched = now.watched;
    memcpy(here.target, t, KEEP);
    uint64_t hash = 1469598103934665603u;
    for (size_t i = 0; i + 8 <= sizeof here; i += 8) {
        uint64_t word;
        memcpy(&word, (const uint8_t *)&here + i, 8);
        hash = (hash ^ word) * 0x9e3779b97f4a7c15u, hash ^= hash >> 29;
    }
    size_t slot = (size_t)hash % (2 * STATES);
    for (; table[slot]; slot = (slot + 1) % (2 * STATES))
        if (!memcmp(node(table[slot] - 1), &here, sizeof here)) return;
    if (found % 4096 == 0 && !(nodes[found / 4096] = malloc(4096 * sizeof here))) abort();
    memcpy(node(found), &here, sizeof here);
    table[slot] = (uint32_t)++found;
}

static void restore(size_t i) {
    now.watched = node(i)->watched;
    memcpy(t, node(i)->target, KEEP);
    moment = t->last_time;
    measured.position = w->position;
    base = now;
}

/* From every state the host levitates the rotor again: off, wait, reset, measure, levitate. */
static void recover(void) {
    static const struct measurement quiet = {0.0, 2.5, 20.0, false, 0};
    double gain[AMB_GAINS] = {32768, 0, 0, 0, 1}, zero = 0.0;
    size_t first = event_count;
    real("off", AMB_DELEVITATE, 0, 0.0), frame_of("reset", AMB_FAULT_RESET, 0, 0), whole("law", AMB_CONTROLLER, 0);
    parameter("gains", 1, gain, AMB_GAINS), parameter("limits", 4, config.limits, AMB_LIMITS), parameter("nominal", 2, &zero, 1);
    real("levitate", AMB_LEVITATE, 0, 0.0);
    doing = "recovery";
    command(&events[first]);
    for (size_t i = 0; i < 3; i++) take_step(&quiet);
    for (size_t i = 1; i < 6; i++) check(command(&events[first + i]) == AMB_DONE, "it does not recover");
    take_step(&quiet);
    check(command(&events[first + 6]) == AMB_DONE, "it does not levitate again");
    take_step(&quiet);
    check(enabled, "it is not powered again");
    recovered++;
    event_count = first;
}

static uint64_t replies[5][MOST_EVENTS][5]; /* by state and event: bits of codes, by state after it */
static uint64_t moves[5][5]; /* by state and state after a step: bits of reasons that are new */

static void search(size_t most) {
    for (size_t i = 0; i < found && found < most; i++) {
        restore(i);
        size_t from = t->state;
        for (size_t e = 0; e < event_count; e++) {
            restore(i);
            doing = events[e].name;
            uint8_t code = command(&events[e]);
            replies[from][e][t->state] |= 1ull << (code == AMB_SILENT ? 63 : code);
            amb_digest(t);
            visit();
        }
        for (size_t m = 0; m < measurement_count; m++) {
            restore(i);
            doing = "step";
            unsigned before = 0, after = 0;
            for (size_t k = 0; k < t->trips; k++) before |= 1u << t->trip[k].reason;
            take_step(&measurements[m]);
            for (size_t k = 0; k < t->trips; k++) after |= 1u << t->trip[k].reason;
            moves[from][t->state] |= after & ~before ? after & ~before : 1u;
            visit();
        }
        restore(i);
        doing = "a stranger";
        enabled = hardware = amb_levitating(t);
        attack(&events[i % event_count]);
        restore(i);
        recover();
    }
}

static void print_findings(const char *part, bool ended) {
    size_t by_state[5] = {0};
    for (size_t i = 0; i < found; i++) restore(i), by_state[t->state]++;
    printf("{\"part\": \"%s\", \"ended\": %s, \"states\": %zu, \"by_state\": [", part, ended ? "true" : "false", found);
    for (size_t s = 0; s < 5; s++) printf("%s%zu", s ? ", " : "", by_state[s]);
    printf("], \"frames\": %zu, \"measurements\": %zu, \"transitions\": %zu, \"hostile\": %zu, \"repeated\": %zu, ",
           event_count, measurement_count, transitions, hostile, repeated);
    printf("\"recovered\": %zu, \"wrong\": %zu, \"commands\": [", recovered, wrong);
    bool first = true;
    for (size_t s = 0; s < 5; s++)
        for (size_t e = 0; e < event_count; e++)
            for (size_t to = 0; to < 5; to++)
                for (int code = 0; code < 64; code++)
                    if (replies[s][e][to] >> code & 1) {
                        printf("%s[%zu, \"%s\", %d, %zu]", first ? "" : ", ", s, events[e].name, code == 63 ? 255 : code, to);
                        first = false;
                    }
    printf("], \"steps\": [");
    first = true;
    for (size_t s = 0; s < 5; s++)
        for (size_t to = 0; to < 5; to++)
            for (int reason = 0; reason < AMB_REASONS; reason++)
                if (moves[s][to] >> reason & 1) printf("%s[%zu, %d, %zu]", first ? "" : ", ", s, reason, to), first = false;
    printf("]}\n");
}

int main(int arguments, char **argument) {
    if (arguments < 2) return 2;
    size_t most = arguments > 2 ? strtoul(argument[2], NULL, 10) : STATES;
    memset(config.key, 7, config.key_length);
    part_of(argument[1]);
    if (!(table = calloc(2 * STATES, sizeof *table)) || !amb_init(t, &config, NULL)) return 2;
    visit();
    search(most);
    print_findings(argument[1], found < most);
    return 0;
}
