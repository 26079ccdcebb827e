/* The exported plant around its compiled kernels: memory, checks, what is seen of the state. */

#include "hertzloop_plant.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "image.h" /* generated: constants of the scene, and where things are */
#include "noise.h"

/* image.bin: words, relocations, state at the start, arrays of the model. */
__asm__(".section .rodata\n"
        ".balign 64\n"
        ".hidden hertzloop_image\n"
        ".global hertzloop_image\n"
        "hertzloop_image:\n"
        ".incbin \"image.bin\"\n"
        ".balign 64\n"
        ".previous\n");
extern const unsigned char hertzloop_image[];

/* The kernels, of which `words` is the unit's table. They return nothing and cannot fail; there has
   to be room for both. */
extern int32_t hertzloop_kernel_release(void **, void **, int64_t *words, double, double);
extern int32_t hertzloop_kernel_advance(void **, void **, int64_t *words, double, int64_t);
extern int32_t hertzloop_kernel_balance(void **, void **, int64_t *words);

enum { MODEL, STATE, NOISE }; /* memory that relocations point into */
enum { LINE = 64 };           /* arrays begin at a cache line */

typedef struct {
    uint64_t digest;
    double drop_height_m;
    int64_t seed;
} start;

struct hertzloop_plant {
    start from;
    int64_t *words;
    unsigned char *state, *spare;
    double *noise;
    void *none, *fault;
    char said[256];
};

static double number_at(const hertzloop_plant *plant, size_t offset) {
    double value;
    memcpy(&value, plant->state + offset, sizeof value);
    return value;
}

static int64_t count_at(const hertzloop_plant *plant, size_t offset) {
    int64_t value;
    memcpy(&value, plant->state + offset, sizeof value);
    return value;
}

static int wrong(hertzloop_plant *plant, int status, const char *sentence, double value) {
    snprintf(plant->said, sizeof plant->said, sentence, value);
    return status;
}

const hertzloop_about *hertzloop_plant_about(void) {
    static const hertzloop_about about = {
        IMAGE_SCENE, IMAGE_PROCESSOR, IMAGE_QUANTITY, IMAGE_STEP_S, IMAGE_EVERY_STEPS, IMAGE_STEPS,
        IMAGE_DROP_HEIGHT_M, IMAGE_SEED, sizeof(start) + IMAGE_STATE_BYTES,
    };
    return &about;
}

const char *hertzloop_plant_refused(void) {
    static char said[512];
    char missing[256] = "";
    __builtin_cpu_init();
#define LOOK(name)                                                              \
    if (!__builtin_cpu_supports(name)) {                                        \
        size_t used = strlen(missing);                                          \
        snprintf(missing + used, sizeof missing - used, "%s" name, used ? ", " : ""); \
    }
    IMAGE_NEEDS(LOOK)
#undef LOOK
    if (!missing[0])
        return NULL;
    snprintf(said, sizeof said,
             "this plant was exported for %s and its code needs %s, which this processor does not "
             "have; export it with --cpu x86-64",
             IMAGE_PROCESSOR, missing);
    return said;
}

/* Let the words point into the plant's memory. */
static void place(hertzloop_plant *plant) {
    const unsigned char *base[] = {
        hertzloop_image + IMAGE_MODEL_AT, plant->state, (const unsigned char *)plant->noise};
    const int64_t *relocation = (const int64_t *)(hertzloop_image + IMAGE_RELOCATIONS_AT);
    memcpy(plant->words, hertzloop_image, 8 * IMAGE_WORDS);
    for (int i = 0; i < IMAGE_RELOCATIONS; i++, relocation += 3)
        plant->words[relocation[0]] = (int64_t)(intptr_t)(base[relocation[1]] + relocation[2]);
}

static void seed_noise(hertzloop_plant *plant) {
    if (plant->noise)
        hertzloop_normal(plant->from.seed, IMAGE_NOISE_STREAM, IMAGE_NOISE_RMS, plant->noise,
                         IMAGE_NOISE);
}

static void begin(hertzloop_plant *plant) {
    double phase = IMAGE_TOUCH_PHASE;
    if (phase < 0.0)
        phase = hertzloop_uniform(plant->from.seed, IMAGE_PHASE_STREAM);
    memcpy(plant->state, hertzloop_image + IMAGE_STATE_AT, IMAGE_STATE_BYTES);
    hertzloop_kernel_release(&plant->none, &plant->fault, plant->words, plant->from.drop_height_m,
                             phase);
    hertzloop_kernel_advance(&plant->none, &plant->fault, plant->words, 0.0, 0); /* first sample */
}

hertzloop_plant *hertzloop_plant_new(void) {
    if (hertzloop_plant_refused())
        return NULL;
    hertzloop_plant *plant = calloc(1, sizeof *plant);
    if (!plant)
        return NULL;
    plant->from = (start){IMAGE_DIGEST, IMAGE_DROP_HEIGHT_M, IMAGE_SEED};
    plant->words = malloc(8 * IMAGE_WORDS);
    plant->state = aligned_alloc(LINE, IMAGE_STATE_BYTES);
    plant->spare = aligned_alloc(LINE, IMAGE_STATE_BYTES);
    if (IMAGE_NOISE > 0)
        plant->noise = malloc(sizeof(double) * (size_t)IMAGE_NOISE);
    if (!plant->words || !plant->state || !plant->spare || (IMAGE_NOISE > 0 && !plant->noise)) {
        hertzloop_plant_free(plant);
        return NULL;
    }
    place(plant);
    seed_noise(plant);
    begin(plant);
    return plant;
}

void hertzloop_plant_free(hertzloop_plant *plant) {
    if (!plant)
        return;
    free(plant->words);
    free(plant->state);
    free(plant->spare);
    free(plant->noise);
    free(plant);
}

int hertzloop_plant_reset(hertzloop_plant *plant, double drop_height_m, int64_t seed) {
    if (!(drop_height_m >= 1e-7 && drop_height_m <= 100.0))
        return wrong(plant, HERTZLOOP_WRONG, "a drop height is 1e-7 to 100 m, not %g", drop_height_m);
    if (seed < 0)
        return wrong(plant, HERTZLOOP_WRONG, "a seed is 0 or more, not %.0f", (double)seed);
    int other = seed != plant->from.seed;
    plant->from.drop_height_m = drop_height_m;
    plant->from.seed = seed;
    if (other)
        seed_noise(plant);
    begin(plant);
    return HERTZLOOP_OK;
}

int hertzloop_plant_step(hertzloop_plant *plant, double command_n, int64_t steps) {
    if (!isfinite(command_n))
        return wrong(plant, HERTZLOOP_WRONG, "the command is %g; a force is a number", command_n);
    if (steps < 0)
        return wrong(plant, HERTZLOOP_WRONG, "%.0f steps are asked for; time runs on", (double)steps);
    if (steps > IMAGE_STEPS - count_at(plant, IMAGE_STEP))
        return wrong(plant, HERTZLOOP_AT_END,
                     "the exported run ends at %g s; export a scene with a longer run.duration_s",
                     IMAGE_STEPS * IMAGE_STEP_S);
    hertzloop_kernel_advance(&plant->none, &plant->fault, plant->words, command_n, steps);
    return HERTZLOOP_OK;
}

void hertzloop_plant_values(const hertzloop_plant *plant, hertzloop_values *values) {
    values->step = count_at(plant, IMAGE_STEP);
    values->samples = count_at(plant, IMAGE_SAMPLES);
    values->sample = number_at(plant, IMAGE_SAMPLE);
    values->code = count_at(plant, IMAGE_CODE);
    values->clipped = count_at(plant, IMAGE_CLIPPED);
    values->gap_m = number_at(plant, IMAGE_GAP);
    values->sphere_height_m = number_at(plant, IMAGE_HEIGHT);
    values->plate_deflection_m = number_at(plant, IMAGE_DEFLECTION);
    values->plate_velocity_m_s = number_at(plant, IMAGE_VELOCITY);
    values->contact_force_n = number_at(plant, IMAGE_CONTACT_FORCE);
    values->actuator_force_n = number_at(plant, IMAGE_ACTUATOR_FORCE);
}

int64_t hertzloop_plant_step_all(hertzloop_plant *const *plants, const double *commands_n,
                                 int64_t count, int64_t steps, hertzloop_values *values) {
    for (int64_t i = 0; i < count; i++) {
        if (hertzloop_plant_step(plants[i], commands_n[i], steps) != HERTZLOOP_OK)
            return i;
        hertzloop_plant_values(plants[i], values + i);
    }
    return count;
}

void hertzloop_plant_energies(hertzloop_plant *plant, hertzloop_energies *energies) {
    memcpy(plant->spare, plant->state, IMAGE_STATE_BYTES);
    hertzloop_kernel_balance(&plant->none, &plant->fault, plant->words);
    memcpy(energies, plant->state + IMAGE_ENERGIES, sizeof *energies);
    memcpy(plant->state, plant->spare, IMAGE_STATE_BYTES);
}

void hertzloop_plant_get_state(const hertzloop_plant *plant, void *state) {
    memcpy(state, &plant->from, sizeof(start));
    memcpy((unsigned char *)state + sizeof(start), plant->state, IMAGE_STATE_BYTES);
}

int hertzloop_plant_set_state(hertzloop_plant *plant, const void *state) {
    start from;
    memcpy(&from, state, sizeof from);
    if (from.digest != IMAGE_DIGEST)
        return wrong(plant, HERTZLOOP_WRONG, "the state is not one of this plant", 0.0);
    int other = from.seed != plant->from.seed;
    plant->from = from;
    if (other)
        seed_noise(plant);
    memcpy(plant->state, (const unsigned char *)state + sizeof(start), IMAGE_STATE_BYTES);
    return HERTZLOOP_OK;
}

const char *hertzloop_plant_said(const hertzloop_plant *plant) { return plant->said; }
