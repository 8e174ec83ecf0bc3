/* Frames of AMB-UDP over a stream of bytes, serial or USB: each in COBS (S. Cheshire and M. Baker 1999), ended by 0.
 * A port whose link has no datagrams calls these in board_receive and board_send; see PORTING.md. */
#ifndef AMB_STREAM_H
#define AMB_STREAM_H

#include "../amb_target.h"

/* Longest frame in the stream: a code for each 254 bytes, and the end. */
enum { AMB_STREAM_ROOM = AMB_FRAME + AMB_FRAME / 254 + 2 };

struct amb_stream {
    uint8_t frame[AMB_FRAME];
    uint16_t length;
    uint8_t left;      /* bytes until the next code */
    bool zero, broken; /* a zero is due before the next group; skipped up to its end */
};

/* One byte, at most two stores. As board_receive: the length of the frame that it ends, in `frame` until the next byte (0:
 * none; more than AMB_FRAME: it was cut or longer, for amb_poll to count). */
size_t amb_stream_take(struct amb_stream *s, uint8_t byte);
/* The frame, at most AMB_FRAME bytes, as it goes into the stream: so many bytes of `out`, which has room for AMB_STREAM_ROOM. */
size_t amb_stream_put(const uint8_t *frame, size_t length, uint8_t *out);

#endif
