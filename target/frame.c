/* Frames: little-endian numbers at any address, checksum (as zlib's) and seal. */
#include "parts.h"

static const uint32_t MAGIC = 0x55424d41; /* the bytes A M B U */

uint16_t amb_get16(const uint8_t *p) { return (uint16_t)(p[0] | p[1] << 8); }
uint32_t amb_get32(const uint8_t *p) { return amb_get16(p) | (uint32_t)amb_get16(p + 2) << 16; }
uint64_t amb_get64(const uint8_t *p) { return amb_get32(p) | (uint64_t)amb_get32(p + 4) << 32; }

double amb_get_double(const uint8_t *p) {
    union { uint64_t bits; double value; } both = {amb_get64(p)};
    return both.value;
}

uint8_t *amb_put(uint8_t *p, uint64_t value, size_t bytes) {
    for (; bytes; bytes--, value >>= 8) *p++ = (uint8_t)value;
    return p;
}

uint8_t *amb_put_double(uint8_t *p, double value) {
    union { double value; uint64_t bits; } both = {value};
    return amb_put(p, both.bits, 8);
}

uint8_t *amb_put_float(uint8_t *p, double value) {
    union { float value; uint32_t bits; } both = {(float)value}; /* infinite beyond its range, as in IEEE 754 */
    return amb_put(p, both.bits, 4);
}

uint8_t *amb_put_bytes(uint8_t *p, const void *bytes, size_t count) {
    memcpy(p, bytes, count);
    return p + count;
}

uint32_t amb_crc32(uint32_t before, const uint8_t *bytes, size_t count) {
    static const uint32_t nibble[16] = {
        0x00000000, 0x1db71064, 0x3b6e20c8, 0x26d930ac, 0x76dc4190, 0x6b6b51f4, 0x4db26158, 0x5005713c,
        0xedb88320, 0xf00f9344, 0xd6d6a3e8, 0xcb61b38c, 0x9b64c2b0, 0x86d3d2d4, 0xa00ae278, 0xbdbdf21c};
    uint32_t crc = ~before;
    for (; count; count--) {
        crc ^= *bytes++;
        for (int half = 0; half < 2; half++) crc = (crc >> 4) ^ nibble[crc & 15];
    }
    return ~crc;
}

size_t amb_close(const struct amb_target *t, uint8_t *frame, const uint8_t *end, uint8_t type, uint64_t step) {
    size_t length = (size_t)(end - frame);
    uint64_t start = MAGIC | (uint64_t)AMB_VERSION << 32 | (uint64_t)type << 40 | (uint64_t)(length - AMB_HEADER) << 48;
    amb_put(amb_put(amb_put(frame, start, 8), t->session | (uint64_t)t->sequence << 32, 8), step, 8);
    amb_put(frame + length, amb_crc32(0, frame, length), AMB_CRC);
    return length + AMB_CRC;
}

bool amb_valid(const uint8_t *frame, size_t length) {
    if (length < AMB_HEADER + AMB_CRC || length > AMB_FRAME || amb_get32(frame) != MAGIC) return false;
    return amb_get16(frame + 6) == length - AMB_HEADER - AMB_CRC &&
           amb_crc32(0, frame, length - AMB_CRC) == amb_get32(frame + length - AMB_CRC);
}
