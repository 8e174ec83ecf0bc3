/* What the parts of the target offer each other. */
#ifndef AMB_PARTS_H
#define AMB_PARTS_H

#include <math.h>
#include <string.h>

#include "board.h"

#define AMB_FOREVER 4000000000u /* steps */

/* frame.c: little-endian numbers at any address; those that write return the address after what they wrote */
uint16_t amb_get16(const uint8_t *p);
uint32_t amb_get32(const uint8_t *p);
uint64_t amb_get64(const uint8_t *p);
double amb_get_double(const uint8_t *p);
uint8_t *amb_put(uint8_t *p, uint64_t value, size_t bytes);
uint8_t *amb_put_double(uint8_t *p, double value);
uint8_t *amb_put_float(uint8_t *p, double value);
uint8_t *amb_put_bytes(uint8_t *p, const void *bytes, size_t count);
uint32_t amb_crc32(uint32_t before, const uint8_t *bytes, size_t count);
/* Write the header of a frame whose payload reaches up to `end`, and its checksum; returns its length. */
size_t amb_close(const struct amb_target *t, uint8_t *frame, const uint8_t *end, uint8_t type, uint64_t step);
/* Whether length, magic and checksum of a datagram are right, whatever its version. */
bool amb_valid(const uint8_t *frame, size_t length);
/* sha256.c: first 16 bytes of HMAC-SHA-256 of the nonce and `count` bytes of a frame */
void amb_tag(const struct amb_target *t, const uint8_t *frame, size_t count, uint8_t tag[AMB_TAG]);
/* control.c */
void amb_law(struct amb_target *t);
void amb_tune(struct amb_target *t); /* the gains of this step */
bool amb_by_host(const struct amb_target *t); /* whether the currents are those of the host */
bool amb_take_current(struct amb_target *t, uint64_t step, const uint8_t *values, size_t length);
size_t amb_matrix_count(size_t axes, size_t order, size_t inputs);
/* protect.c */
bool amb_levitating(const struct amb_target *t);
void amb_trip(struct amb_target *t, enum amb_reason reason, size_t axis, double value);
void amb_watch(struct amb_target *t);   /* control steps, or currents of the host, that were missed */
void amb_protect(struct amb_target *t); /* measured values against the limits */
double amb_radius(const struct amb_target *t, size_t bearing, const double *at, const double *around); /* (m) */
/* Whether a nominal reference, and with it an excitation that is armed or uploaded, keeps its distance. */
bool amb_keeps_distance(const struct amb_target *t, const double *nominal, const double *limits, bool excited);
uint32_t amb_steps(const struct amb_target *t, double seconds);
/* excitation.c */
enum amb_code amb_begin(struct amb_target *t, const uint8_t *body);
enum amb_code amb_data(struct amb_target *t, const uint8_t *body, size_t length);
void amb_digest(struct amb_target *t);
void amb_copy_matrices(struct amb_target *t, uint32_t id); /* of an upload that can be committed, before the lock */
enum amb_code amb_commit(struct amb_target *t, uint32_t id);
enum amb_code amb_arm(struct amb_target *t, uint64_t step, uint32_t id);
void amb_disarm(struct amb_target *t);
void amb_excite(struct amb_target *t); /* sets t->value for this step */
/* recorder.c */
void amb_remember(struct amb_target *t, uint32_t status); /* this step, unless those before a trip are kept */
void amb_keep(struct amb_target *t);                      /* those before this step */
void amb_forget(struct amb_target *t);
void amb_renew(struct amb_target *t); /* levitated for 10 s after a trip: the next one has a second of its own */
enum amb_code amb_record(struct amb_target *t, uint32_t first, uint32_t forget);
uint8_t *amb_put_record(const struct amb_target *t, uint8_t *p, const uint8_t *end, uint32_t first);
/* target.c */
enum amb_code amb_stream(struct amb_target *t, const uint8_t *body, const struct amb_peer *to);
void amb_apply(struct amb_target *t); /* the currents, or none */
void amb_send(struct amb_target *t, uint8_t *frame, const uint8_t *end, uint8_t type, uint64_t step,
              const struct amb_peer *to); /* closes it, too */
void amb_ramp(struct amb_target *t, enum amb_state state, double seconds); /* to levitation, or to the landing */
void amb_move(struct amb_target *t, const double *to, double seconds);     /* from `from`, no faster than allowed */
/* command.c */
void amb_receive(struct amb_target *t, size_t length, const struct amb_peer *from);
uint8_t *amb_put_status(struct amb_target *t, uint8_t *p, uint64_t *step);

#endif
