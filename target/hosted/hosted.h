/* The target as a library: one call per control step, frames as memory. */
#ifndef AMB_HOSTED_H
#define AMB_HOSTED_H

#include "../board.h"

enum { HOSTED_FRAMES = 64 }; /* sent and not yet taken */

struct hosted {
    struct amb_target target;
    uint8_t random[AMB_NONCE];
    const double *position, *coil;
    double temperature, *current;
    bool fault, enabled, hardware_enable;
    uint64_t time;
    const uint8_t *received;
    size_t length, first, stop, lengths[HOSTED_FRAMES];
    struct amb_peer from, to[HOSTED_FRAMES];
    uint8_t sent[HOSTED_FRAMES][AMB_FRAME];
};

size_t hosted_size(void);
bool hosted_init(struct hosted *h, const struct amb_config *config, const uint8_t *random);
/* One control step at a time (ns), then the background; whether the amplifiers are on. */
bool hosted_step(struct hosted *h, const double *position, const double *coil, double temperature, bool fault,
                 uint64_t time, double *current);
/* Take a datagram; whether the amplifiers are on. */
bool hosted_feed(struct hosted *h, const uint8_t *frame, size_t length, const struct amb_peer *from);
bool hosted_hardware_enable(const struct hosted *h); /* the output of board_enable */
bool hosted_waits(const struct hosted *h); /* for the current of the host for the latest step */
size_t hosted_take(struct hosted *h, uint8_t *frame, struct amb_peer *to); /* length; 0: no more */

#endif
