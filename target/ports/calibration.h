/* From converters to metres and amperes, and from amperes to a duty cycle: what a port writes around its registers. */
#ifndef AMB_CALIBRATION_H
#define AMB_CALIBRATION_H

#include <stdint.h>

enum { CALIBRATION_POINTS = 8 };

/* A position sensor, by a table of readings (code, rising) and positions (m) that were measured with a gauge: offset, gain
 * and linearisation in one. NaN beyond the table, which the target takes for a failed sensor. */
struct position_calibration { uint8_t points; double code[CALIBRATION_POINTS], position[CALIBRATION_POINTS]; };
double calibrated_position(const struct position_calibration *c, double code);
/* Two sensors at right angles that are turned against the axes of the magnets by an angle with this cosine and sine. */
void turned_back(double cosine, double sine, double *x, double *y);
/* A coil current by offset (code at no current) and gain (A a code). */
double calibrated_current(double offset, double gain, double code);
/* A temperature (deg C) of a converter whose last code stands for `full`, which is above the limit of the target. NaN at
 * either end, where the thermistor is open or shorted: the target trips. */
double calibrated_temperature(double full, double last, double code);
/* Compare value of a PWM timer that counts to `period`, for a coil current reference of which `full` (A) is the largest
 * that the amplifier takes; 0 while disabled, or if it is not a number. */
uint32_t compare_value(double current, double full, uint32_t period, int enabled);

#endif
