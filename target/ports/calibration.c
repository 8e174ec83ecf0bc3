#include "calibration.h"

#include <math.h>

double calibrated_position(const struct position_calibration *c, double code) {
    for (int i = 1; i < c->points; i++)
        if (code >= c->code[i - 1] && code <= c->code[i]) {
            double share = (code - c->code[i - 1]) / (c->code[i] - c->code[i - 1]);
            return c->position[i - 1] + share * (c->position[i] - c->position[i - 1]);
        }
    return (double)NAN;
}

void turned_back(double cosine, double sine, double *x, double *y) {
    double along = *x;
    *x = cosine * along - sine * *y;
    *y = sine * along + cosine * *y;
}

double calibrated_current(double offset, double gain, double code) { return gain * (code - offset); }

double calibrated_temperature(double full, double last, double code) {
    return code > 0.0 && code < last ? full * code / last : (double)NAN;
}

uint32_t compare_value(double current, double full, uint32_t period, int enabled) {
    if (!enabled || !(current > 0.0)) return 0;
    return current < full ? (uint32_t)(current / full * period) : period;
}
