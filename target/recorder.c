/* The second before a trip: a ring of rows, which stands still from the trip on until the host has read it. The sample
 * interrupt fills and stops it, only the background lets it go on: what stands is read without the lock. */
#include "parts.h"

static uint32_t words(const struct amb_target *t) { return 3u * t->config->axes + 1u; }
static uint32_t room(const struct amb_target *t) { return t->config->record_words / words(t); }

static uint32_t *put(uint32_t *p, const double *values, size_t count) {
    for (float value; count; count--) value = (float)*values++, memcpy(p++, &value, sizeof value);
    return p;
}

void amb_remember(struct amb_target *t, uint32_t status) {
    uint32_t rows = room(t), next = t->record.next;
    size_t axes = t->config->axes;
    if (t->record.kept || !rows) return;
    uint32_t *row = t->config->record + (size_t)next * words(t);
    *put(put(put(row, t->reference, axes), t->sensors.position, axes), t->current, axes) = status;
    t->record.next = next + 1 < rows ? next + 1 : 0;
    if (t->record.rows < rows) t->record.rows++;
}

void amb_keep(struct amb_target *t) {
    if (!t->record.kept && room(t)) t->record.kept = true, t->record.end = t->step;
}

void amb_forget(struct amb_target *t) { t->record.kept = false, t->record.rows = 0; }

void amb_renew(struct amb_target *t) {
    if (t->record.kept && amb_levitating(t) && t->step - t->record.end > amb_steps(t, 10.0)) amb_forget(t);
}

enum amb_code amb_record(struct amb_target *t, uint32_t first, uint32_t forget) {
    if (!t->record.kept) return AMB_WRONG_STATE;
    if (forget > 1 || (forget && first) || first > t->record.rows) return AMB_BAD_VALUE;
    if (forget) amb_forget(t);
    return AMB_DONE;
}

uint8_t *amb_put_record(const struct amb_target *t, uint8_t *p, const uint8_t *end, uint32_t first) {
    uint32_t width = 4 * words(t), left = t->record.rows - first, fit = (uint32_t)(end - p - 16) / width;
    uint32_t count = left < fit ? left : fit, rows = room(t), at = t->record.next + rows - left;
    p = amb_put(amb_put(p, t->record.end - left, 8), t->record.rows, 4);
    for (p = amb_put(p, count | width << 16, 4); count; count--, at++)
        for (size_t i = 0; i < words(t); i++) p = amb_put(p, t->config->record[(size_t)(at % rows) * words(t) + i], 4);
    return p;
}
