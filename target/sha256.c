/* SHA-256 (FIPS 180-4) and HMAC (RFC 2104), in one pass over the data. */
#include "parts.h"

static const uint32_t ROUND[64] = {
    0x428a2f98, 0x71374491, 0xb5c0fbcf, 0xe9b5dba5, 0x3956c25b, 0x59f111f1, 0x923f82a4, 0xab1c5ed5,
    0xd807aa98, 0x12835b01, 0x243185be, 0x550c7dc3, 0x72be5d74, 0x80deb1fe, 0x9bdc06a7, 0xc19bf174,
    0xe49b69c1, 0xefbe4786, 0x0fc19dc6, 0x240ca1cc, 0x2de92c6f, 0x4a7484aa, 0x5cb0a9dc, 0x76f988da,
    0x983e5152, 0xa831c66d, 0xb00327c8, 0xbf597fc7, 0xc6e00bf3, 0xd5a79147, 0x06ca6351, 0x14292967,
    0x27b70a85, 0x2e1b2138, 0x4d2c6dfc, 0x53380d13, 0x650a7354, 0x766a0abb, 0x81c2c92e, 0x92722c85,
    0xa2bfe8a1, 0xa81a664b, 0xc24b8b70, 0xc76c51a3, 0xd192e819, 0xd6990624, 0xf40e3585, 0x106aa070,
    0x19a4c116, 0x1e376c08, 0x2748774c, 0x34b0bcb5, 0x391c0cb3, 0x4ed8aa4a, 0x5b9cca4f, 0x682e6ff3,
    0x748f82ee, 0x78a5636f, 0x84c87814, 0x8cc70208, 0x90befffa, 0xa4506ceb, 0xbef9a3f7, 0xc67178f2};

struct sha256 { uint32_t h[8]; uint64_t count; uint8_t block[64]; };

static uint32_t turn(uint32_t x, int bits) { return (x >> bits) | (x << (32 - bits)); }

#define V(letter) v[((letter) - i) & 7]

static void compress(uint32_t h[8], const uint8_t *block) {
    uint32_t w[64] = {0}, v[8];
    for (int i = 0; i < 64; i++) w[i / 4] = w[i / 4] << 8 | block[i];
    for (int i = 16; i < 64; i++)
        w[i] = w[i - 16] + (turn(w[i - 15], 7) ^ turn(w[i - 15], 18) ^ (w[i - 15] >> 3)) + w[i - 7] +
               (turn(w[i - 2], 17) ^ turn(w[i - 2], 19) ^ (w[i - 2] >> 10));
    memcpy(v, h, sizeof v);
    for (int i = 0; i < 64; i++) {
        uint32_t one = V(7) + (turn(V(4), 6) ^ turn(V(4), 11) ^ turn(V(4), 25)) + ((V(4) & V(5)) ^ (~V(4) & V(6))) +
                       ROUND[i] + w[i];
        uint32_t two = (turn(V(0), 2) ^ turn(V(0), 13) ^ turn(V(0), 22)) + ((V(0) & V(1)) ^ (V(2) & (V(0) ^ V(1))));
        V(3) += one;
        V(7) = one + two; /* is V(0) of the next round */
    }
    for (int i = 0; i < 8; i++) h[i] += v[i];
}

static void add(struct sha256 *s, const uint8_t *bytes, size_t count) {
    for (size_t i = 0; i < count; i++) {
        s->block[s->count++ % 64] = bytes[i];
        if (s->count % 64 == 0) compress(s->h, s->block);
    }
}

void amb_tag(const struct amb_target *t, const uint8_t *frame, size_t count, uint8_t tag[AMB_TAG]) {
    uint8_t pad[64], digest[32];
    for (int outer = 0; outer < 2; outer++) {
        uint8_t mask = outer ? 0x5c : 0x36, byte = 0x80;
        for (int i = 0; i < 64; i++) pad[i] = i < t->config->key_length ? t->config->key[i] ^ mask : mask;
        struct sha256 s = {.h = {0x6a09e667, 0xbb67ae85, 0x3c6ef372, 0xa54ff53a, 0x510e527f, 0x9b05688c, 0x1f83d9ab,
                                 0x5be0cd19}};
        add(&s, pad, 64);
        add(&s, outer ? digest : t->nonce, outer ? 32 : AMB_NONCE);
        add(&s, frame, outer ? 0 : count);
        uint64_t bits = s.count * 8; /* the end of the data: a one, zeros, and their length */
        for (; byte || s.count % 64 != 56; byte = 0) add(&s, &byte, 1);
        for (int i = 0; i < 8; i++, add(&s, &byte, 1)) byte = (uint8_t)(bits >> (56 - 8 * i));
        for (int i = 0; i < 32; i++) digest[i] = (uint8_t)(s.h[i / 4] >> (24 - 8 * (i % 4)));
    }
    memcpy(tag, digest, AMB_TAG);
}
