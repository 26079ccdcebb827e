/* Philox 4x64 with 10 rounds (Salmon et al. 2011), in the order in which NumPy takes its numbers;
   normal numbers are drawn by NumPy's own library. */

#include "noise.h"

typedef struct {
    uint64_t counter[4], key[2], ready[4];
    int taken;
} philox;

/* NumPy's interface of bit generators, as its distributions.h declares it. */
typedef struct {
    void *state;
    uint64_t (*next_uint64)(void *);
    uint32_t (*next_uint32)(void *);
    double (*next_double)(void *);
    uint64_t (*next_raw)(void *);
} bitgen_t;

extern double random_standard_normal(bitgen_t *);

static void turn(philox *p) {
    uint64_t a = p->counter[0], b = p->counter[1], c = p->counter[2], d = p->counter[3];
    uint64_t k = p->key[0], l = p->key[1];
    for (int round = 0; round < 10; round++) {
        unsigned __int128 left = (unsigned __int128)0xD2E7470EE14C6C93u * a;
        unsigned __int128 right = (unsigned __int128)0xCA5A826395121157u * c;
        uint64_t b0 = b, d0 = d;
        a = (uint64_t)(right >> 64) ^ b0 ^ k;
        b = (uint64_t)right;
        c = (uint64_t)(left >> 64) ^ d0 ^ l;
        d = (uint64_t)left;
        k += 0x9E3779B97F4A7C15u;
        l += 0xBB67AE8584CAA73Bu;
    }
    p->ready[0] = a, p->ready[1] = b, p->ready[2] = c, p->ready[3] = d;
}

static uint64_t next64(void *state) {
    philox *p = state;
    if (p->taken == 4) {
        for (int i = 0; i < 4 && ++p->counter[i] == 0; i++)
            ;
        turn(p);
        p->taken = 0;
    }
    return p->ready[p->taken++];
}

static uint32_t next32(void *state) { return (uint32_t)next64(state); }

static double next_double(void *state) {
    return (double)(next64(state) >> 11) * (1.0 / 9007199254740992.0);
}

static philox begun(int64_t seed, int64_t stream) {
    return (philox){.key = {(uint64_t)seed, (uint64_t)stream}, .taken = 4};
}

double hertzloop_uniform(int64_t seed, int64_t stream) {
    philox p = begun(seed, stream);
    return next_double(&p);
}

void hertzloop_normal(int64_t seed, int64_t stream, double rms, double *values, int64_t count) {
    philox p = begun(seed, stream);
    bitgen_t bits = {&p, next64, next32, next_double, next64};
    for (int64_t i = 0; i < count; i++)
        values[i] = rms * random_standard_normal(&bits);
}
