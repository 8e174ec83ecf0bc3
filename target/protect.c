/* Protection: every trip is latched with its reason, step, axis and value; the first of each reason counts. */
#include "parts.h"

bool amb_levitating(const struct amb_target *t) { return t->state != AMB_OFF && t->state != AMB_TRIPPED; }

uint32_t amb_steps(const struct amb_target *t, double seconds) {
    double steps = floor(seconds * t->config->sample_rate + 0.5);
    return steps >= AMB_FOREVER ? AMB_FOREVER : steps > 0.0 ? (uint32_t)steps : 0u;
}

void amb_trip(struct amb_target *t, enum amb_reason reason, size_t axis, double value) {
    if (reason == AMB_HOST_SILENT || reason == AMB_EXCITATION) amb_disarm(t);
    else t->state = AMB_TRIPPED, t->excitation = AMB_NONE;
    if (reason == AMB_DISPLACEMENT) t->lock_left = amb_steps(t, t->limits[AMB_LOCK_TIME]);
    for (size_t i = 0; i < t->trips; i++)
        if (t->trip[i].reason == reason) return;
    t->trip[t->trips++] = (struct amb_trip){(uint8_t)reason, (uint8_t)axis, t->step, value};
    t->report = true;
    amb_keep(t);
}

/* What is missed is owed; a step without a miss pays back so much that a share of misses beyond the limit adds up.
 * Without the host a target can land as long as the steps that it has missed itself, its own debt, are few. */
static double owed(const struct amb_target *t, double debt, uint64_t missed) {
    double share = t->limits[AMB_MISSED_SHARE];
    return missed ? debt + (double)missed : fmax(0.0, share < 1.0 ? debt - share / (1.0 - share) : 0.0);
}

void amb_watch(struct amb_target *t) {
    uint64_t now = board_time(t->board), since = now - t->last_time + t->period / 2;
    uint64_t missed = t->step && since >= 2 * t->period ? since / t->period - 1 : 0;
    uint64_t lost = missed + (amb_by_host(t) && t->step - 1 != t->answered);
    double limit = t->limits[AMB_MISSED_LIMIT], silence = (double)(t->step - t->last_heard);
    bool gone = silence / t->config->sample_rate >= t->limits[AMB_LAND_TIME];
    t->last_time = now, t->count[AMB_MISSED] += (uint32_t)lost;
    t->debt = owed(t, t->debt, lost), t->own_debt = owed(t, t->own_debt, missed);
    if (!amb_levitating(t)) t->debt = t->own_debt = 0.0;
    else if (lost && t->debt >= limit) {
        if (t->law != AMB_HOST_OR_LAND || t->own_debt >= limit) amb_trip(t, AMB_WATCHDOG, 0, t->debt);
        else gone = true, silence = fmax(silence, t->debt), t->debt = t->own_debt;
    }
    gone = gone && amb_levitating(t) && t->state != AMB_LANDING;
    bool excited = t->excitation == AMB_ARMED || t->excitation == AMB_PLAYING;
    if (gone || (excited && silence / t->config->sample_rate >= t->limits[AMB_HOST_TIME]))
        amb_trip(t, AMB_HOST_SILENT, 0, silence);
    if (gone) amb_ramp(t, AMB_LANDING, t->limits[AMB_SETTLE_TIME]);
}

double amb_radius(const struct amb_target *t, size_t bearing, const double *at, const double *around) {
    double square = 0.0;
    for (size_t a = 0; a < t->config->axes; a++) {
        double distance = around ? at[a] - around[a] : at[a];
        if (t->group[a] == bearing) square += distance * distance;
    }
    return sqrt(square);
}

bool amb_keeps_distance(const struct amb_target *t, const double *nominal, const double *limits, bool excited) {
    for (size_t a = 0; a < t->config->axes; a++) {
        if (t->group[a] != a) continue;
        double clearance = t->config->axis[a].number[AMB_CLEARANCE], radius = amb_radius(t, a, nominal, NULL);
        double farthest = fmin(limits[AMB_ALARM_SHARE], limits[AMB_TRIP_SHARE]) * clearance, present = 0.0;
        if (t->state == AMB_LEVITATED) /* it may still be on its way from there */
            present = amb_radius(t, a, t->reference, t->value) * (1.0 - 1e-9);
        if (!(radius <= farthest) || !(present <= farthest)) return false; /* NaN too, which fmax would hide */
        radius = fmax(radius, present);
        if (excited && !(radius + t->upload.reach[a] <= limits[AMB_TRIP_SHARE] * clearance)) return false;
    }
    return true;
}

/* On the ramps, and until it has settled, the rotor may be where it lies, but no farther, and not for long where the
 * reference is not; the host's reference is not known here. */
static void displacement(struct amb_target *t) {
    bool on = amb_levitating(t), settled = t->state == AMB_LEVITATED && !t->settle_left;
    double limit = t->limits[settled ? AMB_TRIP_SHARE : AMB_CONTACT_SHARE];
    uint32_t longest = amb_steps(t, t->limits[AMB_LIFT_TIME]);
    const double *around = amb_by_host(t) ? NULL : t->reference;
    t->alarm = false;
    for (size_t a = 0; a < t->config->axes; a++) {
        if (t->group[a] != a) continue;
        double clearance = t->config->axis[a].number[AMB_CLEARANCE];
        double distance = amb_radius(t, a, t->sensors.position, around) / clearance;
        t->share[a] = amb_radius(t, a, t->sensors.position, NULL) / clearance;
        t->alarm = t->alarm || t->share[a] > t->limits[AMB_ALARM_SHARE];
        bool away = on && t->begun && distance > t->limits[AMB_TRIP_SHARE], beyond = on && t->share[a] > limit;
        t->away[a] = away ? t->away[a] + (t->away[a] < AMB_FOREVER - 1) : 0;
        if (beyond || (away && t->away[a] >= longest)) amb_trip(t, AMB_DISPLACEMENT, a, beyond ? t->share[a] : distance);
    }
}

static void sensor(struct amb_target *t, size_t a) {
    double position = t->sensors.position[a];
    /* A rotor that lies on its backup bearing may stand still. */
    bool moves = t->state == AMB_LEVITATED || (amb_levitating(t) && t->share[t->group[a]] <= t->limits[AMB_TRIP_SHARE]);
    bool same = moves && memcmp(&position, &t->before[a], sizeof position) == 0;
    t->stuck[a] = same ? t->stuck[a] + (t->stuck[a] < AMB_FOREVER - 1) : 0;
    t->before[a] = position;
    if (!(fabs(position) <= t->limits[AMB_SENSOR_LIMIT])) amb_trip(t, AMB_SENSOR_RANGE, a, position); /* NaN too */
    if (same && t->stuck[a] >= amb_steps(t, t->limits[AMB_STUCK_TIME])) amb_trip(t, AMB_SENSOR_STUCK, a, position);
}

void amb_protect(struct amb_target *t) {
    uint32_t over = amb_steps(t, t->limits[AMB_COIL_TIME]), longest = amb_steps(t, t->limits[AMB_SATURATION_TIME]);
    bool on = amb_levitating(t);
    if (!on && t->lock_left && t->lock_left < AMB_FOREVER) t->lock_left--;
    for (size_t a = 0; a < t->config->axes; a++) sensor(t, a);
    displacement(t);
    for (size_t a = 0; a < t->config->axes; a++) { /* the current that has flowed since the step before */
        bool full = on && fabs(t->current[a]) >= t->limits[AMB_CURRENT_LIMIT];
        t->saturated[a] = full ? t->saturated[a] + (t->saturated[a] < AMB_FOREVER - 1) : 0;
        if (full && t->saturated[a] >= longest) amb_trip(t, AMB_SATURATED, a, t->current[a]);
    }
    for (size_t c = 0; c < t->config->coils; c++) {
        double coil = t->sensors.coil[c];
        bool above = !(fabs(coil) <= t->limits[AMB_COIL_LIMIT]);
        t->over[c] = above ? t->over[c] + (t->over[c] < AMB_FOREVER - 1) : 0;
        if (above && t->over[c] >= over) amb_trip(t, AMB_OVER_CURRENT, c, coil);
    }
    if (!(t->sensors.temperature <= t->limits[AMB_TEMPERATURE_LIMIT]))
        amb_trip(t, AMB_TEMPERATURE, 0, t->sensors.temperature);
    if (t->sensors.amplifier_fault) amb_trip(t, AMB_AMPLIFIER, 0, 0.0);
    t->measured = true;
}
