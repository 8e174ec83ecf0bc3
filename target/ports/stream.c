/* COBS: every group of up to 254 bytes without a zero follows a code, the offset of the next code. A code below 255 stands
 * for a zero after its group, except at the end of the frame. So 0 is the end of a frame and nothing else, and whatever
 * was lost or changed, the frame after the next 0 is whole. */
#include "stream.h"

static void store(struct amb_stream *s, uint8_t byte) {
    if (s->length == AMB_FRAME) s->broken = true;
    else s->frame[s->length++] = byte;
}

size_t amb_stream_take(struct amb_stream *s, uint8_t byte) {
    if (byte == 0) {
        size_t length = s->broken || s->left ? AMB_FRAME + 1 : s->length;
        s->zero = s->broken = false;
        s->left = 0, s->length = 0;
        return length;
    }
    if (s->broken) return 0;
    if (s->left) {
        store(s, byte);
        s->left--;
        return 0;
    }
    if (s->zero) store(s, 0);
    s->zero = byte < 0xff;
    s->left = (uint8_t)(byte - 1);
    return 0;
}

size_t amb_stream_put(const uint8_t *frame, size_t length, uint8_t *out) {
    size_t code = 0, next = 1;
    for (size_t i = 0; i < length; i++) {
        if (frame[i]) out[next++] = frame[i];
        if (frame[i] && next - code < 0xff) continue;
        out[code] = (uint8_t)(next - code);
        code = next++;
    }
    out[code] = (uint8_t)(next - code);
    out[next++] = 0;
    return next;
}
