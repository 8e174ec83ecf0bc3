/* What a port implements: nine functions. `board` is the pointer that was given to amb_init. */
#ifndef AMB_BOARD_H
#define AMB_BOARD_H

#include "amb_target.h"

/* Sample interrupt: fill in the measured values of this step. A sensor that is known to have failed reads NaN. */
void board_read_sensors(void *board, struct amb_sensors *sensors);
/* Sample interrupt, and locked background for currents of the host: control current references (A), added to the bias.
 * `enabled` false: all coils without current, bias included. Also the place to serve the hardware watchdog. */
void board_write_currents(void *board, const double *current, bool enabled);
/* Sample interrupt, and locked background: output for the enable of the amplifiers in hardware, on a path of its own,
 * beside `enabled` above. Off before the currents are, on before they flow. */
void board_enable(void *board, bool on);
/* Monotonic time (ns); may start anywhere. */
uint64_t board_time(void *board);
/* Numbers that nobody can predict, different at every boot. */
void board_random(void *board, uint8_t *bytes, size_t count);
/* Background: next datagram into `frame` of `space` bytes. Its length (0: none; more than `space`: it was longer). */
size_t board_receive(void *board, uint8_t *frame, size_t space, struct amb_peer *from);
/* Background: false if it could not be sent. */
bool board_send(void *board, const uint8_t *frame, size_t length, const struct amb_peer *to);
/* Keep the sample interrupt out for a few microseconds. They are not nested. */
void board_lock(void *board);
void board_unlock(void *board);

#endif
