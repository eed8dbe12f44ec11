#include "btf_checkpoint.h"

#include <string.h>
#include <xxhash.h>

/* All values, or the hashes of the views where the values are in a scratch file. */
static void hash_values(XXH3_state_t *state, const struct btf_matrix *btf) {
    const gsize row = sizeof(float) * btf_layout_values(&btf->layout);
    if (btf->values) {
        XXH3_128bits_update(state, btf->values, row * btf_layout_texels(&btf->layout));
        return;
    }
    for (gsize view = 0; view < btf->layout.views.n; view++) {
        const guint64 hash = btf_scratch_hash(btf->scratch, view);
        XXH3_128bits_update(state, &hash, sizeof hash);
    }
}

static char *hash_inputs(const struct btf_matrix *btf, const char *what) {
    XXH3_state_t *state = XXH3_createState();
    const float *const angles[] = {btf->layout.views.theta_deg, btf->layout.views.phi_deg,
                                   btf->layout.lights.theta_deg, btf->layout.lights.phi_deg};
    g_autofree char *head = g_strdup_printf(
        "%s, %zu × %zu × %zu × %zu, %s", what, btf->layout.width, btf->layout.height,
        btf->layout.views.n, btf->layout.lights.n, MESORIG_VERSION);
    XXH3_128bits_reset(state);
    XXH3_128bits_update(state, head, strlen(head));
    for (int i = 0; i < 4; i++)
        XXH3_128bits_update(state, angles[i],
                            sizeof(float) *
                                (gsize)(i < 2 ? btf->layout.views.n : btf->layout.lights.n));
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
