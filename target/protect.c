/* Protection: every trip is latched with its reason, step, axis and value; the first of each reason counts. */
#include "parts.h"

bool amb_levitating(const struct amb_target *t) { return t->state != AMB_OFF && t->state != AMB_TRIPPED; }

uint32_t amb_steps(const struct amb_target *t, double seconds) {
    double steps = floor(seconds * t->config->sample_rate + 0.5);
    return steps >= 4e9 ? 4000000000u : steps > 0.0 ? (uint32_t)steps : 0u;
}

void amb_trip(struct amb_target *t, enum amb_reason reason, size_t axis, double value) {
    if (reason == AMB_HOST_SILENT || reason == AMB_EXCITATION) amb_disarm(t);
    else t->state = AMB_TRIPPED, t->excitation = AMB_NONE;
    for (size_t i = 0; i < t->trips; i++)
        if (t->trip[i].reason == reason) return;
    t->trip[t->trips++] = (struct amb_trip){(uint8_t)reason, (uint8_t)axis, t->step, value};
    t->report = true;
}

void amb_watch(struct amb_target *t) {
    uint64_t now = board_time(t->board), since = now - t->last_time + t->period / 2;
    uint64_t missed = t->step && since >= 2 * t->period ? since / t->period - 1 : 0;
    uint64_t unanswered = amb_by_host(t) ? t->step - 1 - t->answered : 0, silence = t->step - t->last_heard;
    bool lost = (double)(missed + unanswered) >= t->limits[AMB_MISSED_LIMIT];
    bool gone = (double)silence / t->config->sample_rate >= t->limits[AMB_LAND_TIME];
    t->last_time = now;
    t->count[AMB_MISSED] += (uint32_t)missed + (unanswered > 0);
    if (lost && unanswered && t->law == AMB_HOST_OR_LAND) gone = true;
    else if (lost && amb_levitating(t)) amb_trip(t, AMB_WATCHDOG, 0, (double)(missed + unanswered));
    gone = gone && amb_levitating(t) && t->state != AMB_LANDING;
    bool excited = t->excitation == AMB_ARMED || t->excitation == AMB_PLAYING;
    if (gone || (excited && silence >= amb_steps(t, t->limits[AMB_HOST_TIME])))
        amb_trip(t, AMB_HOST_SILENT, 0, (double)(silence > unanswered ? silence : unanswered));
    if (gone) amb_ramp(t, AMB_LANDING, t->limits[AMB_SETTLE_TIME]);
}

static void displacement(struct amb_target *t) {
    bool alarm = false;
    for (size_t a = 0; a < t->config->axes; a++) {
        double square = 0.0;
        for (size_t b = 0; b < t->config->axes; b++)
            if (t->group[b] == a) square += t->sensors.position[b] * t->sensors.position[b];
        double share = sqrt(square) / t->config->axis[a].number[AMB_CLEARANCE];
        alarm = alarm || share > t->limits[AMB_ALARM_SHARE];
        if (t->state == AMB_LEVITATED && !t->settle_left && share > t->limits[AMB_TRIP_SHARE])
            amb_trip(t, AMB_DISPLACEMENT, a, share);
    }
    t->alarm = alarm;
}

void amb_protect(struct amb_target *t) {
    uint32_t stuck = amb_steps(t, t->limits[AMB_STUCK_TIME]), over = amb_steps(t, t->limits[AMB_COIL_TIME]);
    for (size_t a = 0; a < t->config->axes; a++) {
        double position = t->sensors.position[a];
        if (!(fabs(position) <= t->limits[AMB_SENSOR_LIMIT])) amb_trip(t, AMB_SENSOR_RANGE, a, position); /* NaN too */
        bool same = t->state == AMB_LEVITATED && memcmp(&position, &t->before[a], sizeof position) == 0;
        t->stuck[a] = same ? t->stuck[a] + 1 : 0;
        t->before[a] = position;
        if (same && t->stuck[a] >= stuck) amb_trip(t, AMB_SENSOR_STUCK, a, position);
    }
    for (size_t c = 0; c < t->config->coils; c++) {
        double coil = t->sensors.coil[c];
        bool above = !(fabs(coil) <= t->limits[AMB_COIL_LIMIT]);
        t->over[c] = above ? t->over[c] + (t->over[c] < UINT32_MAX) : 0;
        if (above && t->over[c] >= over) amb_trip(t, AMB_OVER_CURRENT, c, coil);
    }
    if (!(t->sensors.temperature <= t->limits[AMB_TEMPERATURE_LIMIT]))
        amb_trip(t, AMB_TEMPERATURE, 0, t->sensors.temperature);
    if (t->sensors.amplifier_fault) amb_trip(t, AMB_AMPLIFIER, 0, 0.0);
    displacement(t);
}
