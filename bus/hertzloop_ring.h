/* Two rings of shared memory between a plant and a controller on one host.
 *
 * See docs/reference/shared-memory.md. C11; little-endian, 64-bit. Every word is 8 bytes, every offset in bytes is given.
 * A controller maps the segment (size hertzloop_ring_bytes(slots)), checks magic, version and run_id,
 * writes run_id into `joined`, and after its first block on the bus answers samples with
 *
 *     while (n < samples) {
 *         int said = hertzloop_ring_sample(lane, n, &value);      0: not yet, 1: there, -1: a gap
 *         ...
 *         hertzloop_ring_answer(lane, &answers, ++n, force, NAN); 0: no room yet, try again
 *     }
 */
#ifndef HERTZLOOP_RING_H
#define HERTZLOOP_RING_H

#include <stdatomic.h>
#include <stddef.h>
#include <stdint.h>

#define HERTZLOOP_RING_MAGIC 0x676e69727a747268 /* "hrtzring" */
#define HERTZLOOP_RING_VERSION 1

typedef struct {
    _Atomic int64_t number; /* i + 1 once sample i is here; written last */
    double value;           /* physical value, in the unit of the sampled quantity */
} hertzloop_ring_sample_t;

typedef struct {
    _Atomic int64_t number; /* i + 1 once record i is here; written last */
    int64_t samples;        /* samples that are answered once this record is read */
    double force_n;         /* of the next step; NaN: all that are known were given */
    double level;           /* the force stays zero while samples stay above; NaN: no promise */
} hertzloop_ring_answer_t;

typedef struct {
    int64_t magic, version; /* 0, 8 */
    int64_t run_id;         /* 16: of the hello */
    int64_t slots;          /* 24: of each ring; a power of two */
    int64_t steps;          /* 32: of the run */
    int64_t every_steps;    /* 40: steps from one sample to the next */
    _Atomic int64_t joined; /* 48: the controller writes run_id */
    _Atomic int64_t closed; /* 56: not 0 once a side has left: nobody has to wait any longer */
    int64_t spare[8];
    _Atomic int64_t answers_taken; /* 128: the plant's; records below it may be written over */
    int64_t spare_too[15];
    hertzloop_ring_sample_t samples[]; /* 256: `slots` of them, then `slots` answers */
} hertzloop_ring;

static inline size_t hertzloop_ring_bytes(int64_t slots) {
    size_t record = sizeof(hertzloop_ring_sample_t) + sizeof(hertzloop_ring_answer_t);
    return sizeof(hertzloop_ring) + (size_t)slots * record;
}

/* Sample i, from 0 on. Returns 1 if it is there, 0 if not yet, -1 if there is another in its place. */
static inline int hertzloop_ring_sample(hertzloop_ring *lane, int64_t i, double *value) {
    hertzloop_ring_sample_t *slot = &lane->samples[i & (lane->slots - 1)];
    int64_t number = atomic_load_explicit(&slot->number, memory_order_acquire);
    if (number != i + 1) return number < i + 1 ? 0 : -1; /* of a lap before, or after */
    *value = slot->value;
    return 1;
}

/* Put one record; `put` counts those put so far, from 0. Returns 0 if there is no room yet. */
static inline int hertzloop_ring_answer(
    hertzloop_ring *lane, int64_t *put, int64_t samples, double force_n, double level) {
    hertzloop_ring_answer_t *ring = (hertzloop_ring_answer_t *)(lane->samples + lane->slots);
    hertzloop_ring_answer_t *slot = &ring[*put & (lane->slots - 1)];
    if (*put >= lane->slots + atomic_load_explicit(&lane->answers_taken, memory_order_acquire))
        return 0;
    slot->samples = samples;
    slot->force_n = force_n;
    slot->level = level;
    atomic_store_explicit(&slot->number, ++*put, memory_order_release);
    return 1;
}

#endif
