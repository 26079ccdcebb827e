/* Runs an exported plant under given forces: drive FORCES VALUES. FORCES holds a double for every
   step; VALUES gets a hertzloop_values for the start and after every step, and at last a
   hertzloop_energies. Says how much of the processor's time the steps took, s. */

#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "hertzloop_plant.h"

static double now_s(void) {
    struct timespec now;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

int main(int count, char **words) {
    FILE *in = count == 3 ? fopen(words[1], "rb") : NULL;
    FILE *out = in ? fopen(words[2], "wb") : NULL;
    size_t steps = (size_t)hertzloop_plant_about()->steps;
    double *forces = malloc(steps * sizeof *forces);
    hertzloop_values *values = calloc(steps + 1, sizeof *values);
    hertzloop_plant *plant = hertzloop_plant_new();
    if (!out || !forces || !values || !plant) {
        const char *refused = hertzloop_plant_refused();
        fprintf(stderr, "%s\n", refused ? refused : "drive FORCES VALUES: no file, or no memory");
        return 1;
    }
    steps = fread(forces, sizeof *forces, steps, in);
    double started_s = now_s();
    hertzloop_plant_values(plant, values);
    for (size_t i = 0; i < steps; i++) {
        if (hertzloop_plant_step(plant, forces[i], 1) != HERTZLOOP_OK) {
            fprintf(stderr, "%s\n", hertzloop_plant_said(plant));
            return 1;
        }
        hertzloop_plant_values(plant, values + i + 1);
    }
    printf("%.9f\n", now_s() - started_s);
    hertzloop_energies energies;
    hertzloop_plant_energies(plant, &energies);
    fwrite(values, sizeof *values, steps + 1, out);
    fwrite(&energies, sizeof energies, 1, out);
    hertzloop_plant_free(plant);
    free(forces);
    free(values);
    fclose(in);
    return fclose(out) != 0;
}
