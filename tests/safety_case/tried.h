/* Which frames and measurements the search tries in each state, by part; included by states.c alone, into its
 * configuration and its lists. */

static struct event *frame_of(const char *name, uint8_t type, int16_t step, size_t length) {
    struct event *e = &events[event_count++];
    if (event_count > MOST_EVENTS) abort();
    snprintf(e->name, NAME, "%s", name);
    e->type = type, e->step = step, e->length = (uint16_t)length;
    memset(e->body, 0, sizeof e->body);
    return e;
}
static void real(const char *name, uint8_t type, int16_t step, double value) {
    amb_put_double(frame_of(name, type, step, 8)->body, value);
}
static void whole(const char *name, uint8_t type, uint64_t value) { amb_put(frame_of(name, type, 0, 8)->body, value, 8); }

static void parameter(const char *name, uint8_t kind, const double *value, size_t count) {
    struct event *e = frame_of(name, AMB_PARAMETERS, 0, 8 + 8 * count);
    uint8_t *p = amb_put(e->body, kind, 8);
    for (size_t i = 0; i < count; i++) p = amb_put_double(p, value[i]);
}
static void limits(const char *name, enum amb_limit which, double value) {
    double changed[AMB_LIMITS];
    memcpy(changed, config.limits, sizeof changed);
    changed[which] = value;
    parameter(name, 4, changed, AMB_LIMITS);
}

static void upload(const char *name, uint8_t kind, uint32_t id, const double *value, uint32_t count) {
    char text[NAME];
    uint8_t bytes[64];
    for (size_t i = 0; i < count; i++) amb_put_double(bytes + 8 * i, value[i]);
    snprintf(text, NAME, "BEGIN %s", name);
    struct event *e = frame_of(text, AMB_BEGIN, 0, 24);
    amb_put(e->body, kind, 2), amb_put(e->body + 4, kind == 2, 4), amb_put(e->body + 8, id, 4), amb_put(e->body + 12, 8 * count, 4);
    amb_put(e->body + 16, amb_crc32(0, bytes, 8 * count), 4), amb_put(e->body + 20, kind == 1 ? count : 0, 4);
    snprintf(text, NAME, "DATA %s", name);
    e = frame_of(text, AMB_DATA, 0, 8 + 8 * count);
    amb_put(e->body, id, 8), memcpy(e->body + 8, bytes, 8 * count);
    snprintf(text, NAME, "COMMIT %s", name);
    amb_put(frame_of(text, AMB_COMMIT, 0, 4)->body, id, 4);
}

static void at_rest_and_off(void) {
    real("LEVITATE", AMB_LEVITATE, 0, 0.0), real("LEVITATE slowly", AMB_LEVITATE, 0, 2e-3);
    real("DELEVITATE 0", AMB_DELEVITATE, 0, 0.0), real("DELEVITATE", AMB_DELEVITATE, 0, 1e-3);
    frame_of("FAULT_RESET", AMB_FAULT_RESET, 0, 0), frame_of("HEARTBEAT", AMB_HEARTBEAT, 0, 0);
}

static void measure_all(void) { /* every place of the rotor, with every fault beside it */
    static const double positions[] = {0.0, 16e-6, 100e-6, 150e-6, 320e-6, 2e-3, NAN}; /* up to the alarm, and beyond */
    static const struct measurement beside[] = {
        {0, 2.5, 20, false, 0}, {0, NAN, 20, false, 0}, {0, 13.0, 20, false, 0}, {0, 2.5, 130, false, 0},
        {0, 2.5, NAN, false, 0}, {0, 2.5, 20, true, 0}, {0, 2.5, 20, false, 1}, {0, 2.5, 20, false, 2}, {0, NAN, NAN, true, 2}};
    for (size_t p = 0; p < sizeof positions / sizeof *positions; p++)
        for (size_t b = 0; b < sizeof beside / sizeof *beside; b++) {
            measurements[measurement_count] = beside[b];
            measurements[measurement_count++].position = positions[p];
        }
}

static void measure_few(void) { /* where the rotor can be, and a fault at a time */
    static const struct measurement few[] = {
        {0.0, 2.5, 20.0, false, 0}, {16e-6, 2.5, 20.0, false, 0}, {150e-6, 2.5, 20.0, false, 0},
        {320e-6, 2.5, 20.0, false, 0}, {NAN, 2.5, 20.0, false, 0}, {16e-6, 2.5, 20.0, true, 0},
        {16e-6, 2.5, 20.0, false, 1}, {16e-6, 2.5, 20.0, false, 2}};
    memcpy(measurements, few, sizeof few);
    measurement_count = sizeof few / sizeof *few;
}

static void part_of(const char *name) {
    double gain[AMB_GAINS] = {32768, 0, 0, 0, 1}, half[AMB_GAINS] = {16384, 0, 0, 0, 1}, none[AMB_GAINS] = {0};
    double near = NEAR, far = 200e-6, low = -200e-6, outside = 300e-6, nowhere = NAN, zero = 0.0;
    double samples[] = {10e-6, -10e-6}, matrices[] = {-32768.0, 0.0, 0.0};
    at_rest_and_off();
    if (!strcmp(name, "faults")) measure_all();
    else measure_few();
    if (!strcmp(name, "faults")) {
        real("LEVITATE in NaN seconds", AMB_LEVITATE, 0, NAN), 
        whole("CLOCK", AMB_CLOCK, 1), whole("CONTROLLER nonsense", AMB_CONTROLLER, 9), whole("CURRENT too early", AMB_CURRENT, 0);
        frame_of("unknown", 0x40, 0, 8), frame_of("HEARTBEAT too long", AMB_HEARTBEAT, 0, 3);
    } else if (!strcmp(name, "gains")) {
        config.limits[AMB_SETTLE_TIME] = 4e-4; /* no steps: gains change at once, so that their values are few */
        config.limits[AMB_LAND_TIME] = INFINITY;
        parameter("gains", 1, gain, AMB_GAINS), parameter("half gains", 1, half, AMB_GAINS), parameter("no gains", 1, none, AMB_GAINS);
        limits("limits", AMB_TRIP_SHARE, 0.5), limits("limits: less trip share", AMB_TRIP_SHARE, 0.03);
        limits("limits: more trip share", AMB_TRIP_SHARE, 0.6), limits("limits: less current", AMB_CURRENT_LIMIT, 0.25);
    } else if (!strcmp(name, "references")) {
        config.limits[AMB_LAND_TIME] = INFINITY;
        parameter("nominal 0", 2, &zero, 1), parameter("nominal near", 2, &near, 1), parameter("nominal far", 2, &far, 1);
        parameter("nominal NaN", 2, &nowhere, 1), parameter("landing 0", 3, &zero, 1), parameter("landing low", 3, &low, 1);
        parameter("landing outside", 3, &outside, 1);
    } else if (!strcmp(name, "excitation")) {
        upload("excitation", 1, 1, samples, 2);
        amb_put(frame_of("ARM now", AMB_ARM, 0, 8)->body, 1, 8), amb_put(frame_of("ARM soon", AMB_ARM, 2, 8)->body, 1, 8);
        amb_put(frame_of("ARM too late", AMB_ARM, -1, 8)->body, 1, 8), amb_put(frame_of("ARM other", AMB_ARM, 0, 8)->body, 2, 8);
        frame_of("DISARM", AMB_DISARM, 0, 0);
        limits("limits", AMB_AMPLITUDE_LIMIT, 20e-6), limits("limits: less amplitude", AMB_AMPLITUDE_LIMIT, 1e-6);
    } else if (!strcmp(name, "host")) {
        for (uint64_t law = 0; law < 4; law++)
            whole((const char *[]){"CONTROLLER PD", "CONTROLLER matrices", "CONTROLLER host", "CONTROLLER host or land"}[law],
                  AMB_CONTROLLER, law);
        real("CURRENT", AMB_CURRENT, -1, 0.5), real("CURRENT at its limit", AMB_CURRENT, -1, 1e9);
        real("CURRENT NaN", AMB_CURRENT, -1, NAN), real("CURRENT late", AMB_CURRENT, -2, -0.5), real("CURRENT early", AMB_CURRENT, 0, 1.0);
    } else if (!strcmp(name, "matrices")) {
        upload("matrices", 2, 3, matrices, 3);
        for (uint64_t law = 0; law < 2; law++) whole(law ? "CONTROLLER matrices" : "CONTROLLER PD", AMB_CONTROLLER, law);
    } else exit(2);
}
