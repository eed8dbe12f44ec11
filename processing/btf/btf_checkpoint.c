#include "btf_checkpoint.h"

#include <string.h>
#include <xxhash.h>

/* All values, or the hashes of the views where the values are in a scratch file. */
static void hash_values(XXH3_state_t *state, const struct btf_matrix *btf) {
    const gsize row = sizeof(float) * (gsize)btf->n_views * (gsize)btf->n_lights * 3;
    if (btf->values) {
        XXH3_128bits_update(state, btf->values, row * (gsize)btf->width * (gsize)btf->height);
        return;
    }
    for (int view = 0; view < btf->n_views; view++) {
        const guint64 hash = btf_scratch_hash(btf->scratch, view);
        XXH3_128bits_update(state, &hash, sizeof hash);
    }
}

static char *hash_inputs(const struct btf_matrix *btf, const char *what) {
    XXH3_state_t *state = XXH3_createState();
    const float *const angles[] = {btf->view_theta_deg, btf->view_phi_deg, btf->light_theta_deg,
                                   btf->light_phi_deg};
    g_autofree char *head =
        g_strdup_printf("%s, %d × %d × %d × %d, %s", what, btf->width, btf->height, btf->n_views,
                        btf->n_lights, MESORIG_VERSION);
    XXH3_128bits_reset(state);
    XXH3_128bits_update(state, head, strlen(head));
    for (int i = 0; i < 4; i++)
        XXH3_128bits_update(state, angles[i],
                            sizeof(float) * (gsize)(i < 2 ? btf->n_views : btf->n_lights));
    hash_values(state, btf);
    const XXH128_hash_t hash = XXH3_128bits_digest(state);
    XXH3_freeState(state);
    return g_strdup_printf("%016" G_GINT64_MODIFIER "x%016" G_GINT64_MODIFIER "x",
                           (guint64)hash.high64, (guint64)hash.low64);
}

void btf_checkpoint_begin(Checkpoint *checkpoint, const struct btf_matrix *btf, const char *what) {
    if (checkpoint_is_begun(checkpoint))
        return;
    g_autofree char *inputs = hash_inputs(btf, what);
    checkpoint_begin(checkpoint, inputs);
}
