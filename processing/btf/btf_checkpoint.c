#include "btf_checkpoint.h"

#include <string.h>
#include <xxhash.h>

/* Returns a hash of the text `what`, the layout, and all values. If the values are in a scratch
 * file, the hashes of the file's views are hashed instead. */
static char *btf_checkpoint_hash(const struct btf_matrix *btf, const char *what) {
    const struct btf_layout *layout = &btf->layout;
    const struct direction_list *const lists[] = {&layout->views, &layout->lights};
    XXH3_state_t *state = XXH3_createState();
    g_autofree char *head =
        g_strdup_printf("%s, %zu × %zu × %zu × %zu, %s", what, layout->width, layout->height,
                        layout->views.n, layout->lights.n, MESORIG_VERSION);
    XXH3_128bits_reset(state);
    XXH3_128bits_update(state, head, strlen(head));
    for (gsize i = 0; i < G_N_ELEMENTS(lists); i++) {
        XXH3_128bits_update(state, lists[i]->theta_deg, sizeof(float) * lists[i]->n);
        XXH3_128bits_update(state, lists[i]->phi_deg, sizeof(float) * lists[i]->n);
    }
    if (btf->values)
        XXH3_128bits_update(state, btf->values, (gsize)btf_matrix_bytes(layout));
    for (gsize view = 0; !btf->values && view < layout->views.n; view++) {
        const guint64 hash = btf_scratch_hash(btf->scratch, (int)view);
        XXH3_128bits_update(state, &hash, sizeof hash);
    }
    const XXH128_hash_t hash = XXH3_128bits_digest(state);
    XXH3_freeState(state);
    return g_strdup_printf("%016" G_GINT64_MODIFIER "x%016" G_GINT64_MODIFIER "x",
                           (guint64)hash.high64, (guint64)hash.low64);
}

void btf_checkpoint_begin(Checkpoint *checkpoint, const struct btf_matrix *btf, const char *what) {
    if (checkpoint_is_begun(checkpoint))
        return;
    g_autofree char *inputs = btf_checkpoint_hash(btf, what);
    checkpoint_begin(checkpoint, inputs);
}
