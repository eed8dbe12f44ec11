#include "exposures.h"

#include "world/world.h"

static struct scene *noted;

void exposures_note(struct scene *scene) {
    noted = scene;
}

void __real_world_expose(World *world, int camera, const struct world_state *state,
                         gint64 exposure_us, double gain_db, guint64 noise_key,
                         guint16 *ret_pixels);
void __wrap_world_expose(World *world, int camera, const struct world_state *state,
                         gint64 exposure_us, double gain_db, guint64 noise_key,
                         guint16 *ret_pixels);

/* In the threads that render. */
void __wrap_world_expose(World *world, int camera, const struct world_state *state,
                         gint64 exposure_us, double gain_db, guint64 noise_key,
                         guint16 *ret_pixels) {
    const int n = noted ? g_atomic_int_add(&noted->n_exposures, 1) : SCENE_MAX_EXPOSURES;
    if (n < SCENE_MAX_EXPOSURES) {
        struct exposure *exposure = &noted->exposures[n];
        *exposure = (struct exposure){.tag = noise_key,
                                      .camera = camera,
                                      .turntable_deg = state->turntable_deg,
                                      .arc_deg = state->arc_deg};
        for (int i = 0; i < 32; i++) {
            exposure->lamps |= (guint32)(state->lamp_output[i] > 0) << i;
            if (i < WORLD_MAX_LASERS)
                exposure->lasers |= (guint32)(state->laser_on[i] != 0) << i;
        }
    }
    __real_world_expose(world, camera, state, exposure_us, gain_db, noise_key, ret_pixels);
}
