/* The plant with a controller of one's own: supports the plate while the sphere is below a gap.
   See hertzloop_plant.h beside this file; built as its page says. */

#include <stdio.h>

#include "hertzloop_plant.h"

/* The controller: a force (N) by the sample. */
static double law(double gap_m) { return gap_m < 0.0 ? 20.0 : 0.0; }

int main(void) {
    const hertzloop_about *about = hertzloop_plant_about();
    if (hertzloop_plant_refused()) {
        fprintf(stderr, "%s\n", hertzloop_plant_refused());
        return 1;
    }
    hertzloop_plant *plant = hertzloop_plant_new();
    if (!plant)
        return 1;
    hertzloop_values now;
    hertzloop_energies energies;
    double deepest_m = 0.0, peak_n = 0.0, force_n = 0.0;
    for (int64_t step = 0; step + about->every_steps <= about->steps; step += about->every_steps) {
        hertzloop_plant_values(plant, &now);
        /* What the sample says acts one sample later, as in any real loop. */
        if (hertzloop_plant_step(plant, force_n, about->every_steps) != HERTZLOOP_OK) {
            fprintf(stderr, "%s\n", hertzloop_plant_said(plant));
            return 1;
        }
        force_n = law(now.sample);
        deepest_m = now.gap_m < deepest_m ? now.gap_m : deepest_m;
        peak_n = now.contact_force_n > peak_n ? now.contact_force_n : peak_n;
    }
    hertzloop_plant_energies(plant, &energies);
    printf("%s: %.3g us deep %.4g um, contact force at most %.4g N, plate %.3g J, residual %.1g\n",
           about->scene, 1e6 * about->steps * about->step_s, -1e6 * deepest_m, peak_n,
           energies.modal_j, energies.residual);
    hertzloop_plant_free(plant);
    return 0;
}
