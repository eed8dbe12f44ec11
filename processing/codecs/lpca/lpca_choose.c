#include "lpca_choose.h"

#include "base/data_error.h"
#include "btf/btf_checkpoint.h"
#include "lpca_private.h"

/* maximum number of consecutive tries with more clusters that bring no improvement */
#define PATIENCE 2

/* The state of a choice. The checkpoint stores it byte by byte. */
struct choice {
    struct lpca_target target;
    /* clusters  number of clusters to try next
     * worse     number of consecutive tries without improvement */
    gint32 clusters, worse;
    /* best     the best result so far
     * nearest  of the results that do not reach the target, the one with the smallest error */
    struct lpca_nearest best, nearest;
};

struct choosing {
    const struct btf_matrix *btf;
    const struct lpca_options *options;
    const struct lpca_target *target;
    struct choice choice;
    struct lpca *best;
};

/* Returns the bytes of a local PCA with these numbers of clusters and components, quantised as the
 * target says. */
static gint64 size_of(const struct btf_matrix *btf, const struct lpca_target *target, int clusters,
                      int components) {
    const struct lpca like = {
        .layout.width = btf->layout.width,
        .layout.height = btf->layout.height,
        .layout.views.n = target->n_grid ? target->n_grid * target->n_grid : btf->layout.views.n,
        .layout.lights.n = target->n_grid ? target->n_grid * target->n_grid : btf->layout.lights.n,
        .n_clusters = clusters,
        .n_components = components,
        .quantise = target->quantise,
    };
    return lpca_bytes(&like);
}

static gint64 raw_bytes(const struct btf_matrix *btf) {
    return 2 * 3 * btf_layout_texels(&btf->layout) * btf->layout.views.n * btf->layout.lights.n;
}

/* Returns the maximum number of bytes of the next model. With an error to reach, the model must be
 * smaller than the best model so far, and at most as large as the BTF. For a material with few
 * texels, there is an exception: one cluster may have as many components as represent the BTF
 * exactly. */
static gint64 most_bytes(const struct choosing *choosing) {
    const struct btf_matrix *btf = choosing->btf;
    const struct lpca_target *target = choosing->target;
    const struct lpca_nearest *best = &choosing->choice.best;
    gint64 most = target->bytes > 0 ? target->bytes : G_MAXINT64;
    if (target->error <= 0)
        return most;
    if (best->n_clusters > 0)
        return MIN(most, size_of(btf, target, best->n_clusters, best->n_components) - 1);
    const gint64 texels = btf_layout_texels(&btf->layout);
    const int all = (int)MIN(texels, LPCA_MAX_COMPONENTS);
    return MIN(most, MAX(raw_bytes(btf), size_of(btf, target, 1, all)));
}

/* Returns the maximum number of components with which the next model takes at most most_bytes().
 * Returns 0 if one component already takes more. */
static int max_components(const struct choosing *choosing, int clusters) {
    const struct btf_matrix *btf = choosing->btf;
    const gint64 bytes = most_bytes(choosing);
    int c = MIN(choosing->target->n_components, LPCA_MAX_COMPONENTS);
    c = MIN(c, btf_layout_values(&btf->layout));
    while (c > 0 && size_of(btf, choosing->target, clusters, c) > bytes)
        c--;
    return c;
}

static struct lpca *not_reached(const struct choosing *choosing, GError **error) {
    const struct lpca_nearest *nearest = &choosing->choice.nearest;
    const struct lpca_target *target = choosing->target;
    const gint64 takes = size_of(choosing->btf, target, nearest->n_clusters, nearest->n_components);
    g_autofree char *size = g_format_size((guint64)takes);
    g_autofree char *limit =
        g_format_size((guint64)(target->bytes > 0 ? target->bytes : raw_bytes(choosing->btf)));
    g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                "an error of %.3g %% is not reached within %s%s: the smallest error is %.3g %%, "
                "with %d %s of %d %s in %s; allow a larger error%s. Noise of the capture cannot be "
                "compressed",
                100 * target->error, limit, target->bytes > 0 ? "" : ", the size of the BTF",
                100 * nearest->error, nearest->n_clusters,
                nearest->n_clusters == 1 ? "cluster" : "clusters", nearest->n_components,
                nearest->n_components == 1 ? "component" : "components", size,
                target->bytes > 0 ? " or a larger size" : "");
    return NULL;
}

/* Tries choice->clusters clusters. The checkpoint saves *choice, which is updated only when the try
 * is complete. If memory is not sufficient, the search ends with the best result so far. Fails if
 * there is no earlier result. */
static gboolean try_clusters(struct choosing *choosing, GError **error) {
    struct choice *choice = &choosing->choice;
    g_autoptr(GError) failed = NULL;
    struct lpca_options now = *choosing->options;
    struct lpca_nearest nearest = {0};
    int worse = choice->worse + 1;
    now.n_clusters = choice->clusters;
    now.n_components = max_components(choosing, choice->clusters);
    now.target = choosing->target->error;
    now.nearest = &nearest;
    g_autoptr(Lpca) lpca = now.n_components > 0 ? lpca_compute(choosing->btf, &now, &failed) : NULL;
    if (failed && nearest.n_clusters == 0) {
        if (!g_error_matches(failed, DATA_ERROR, DATA_ERROR_INVALID) ||
            choice->best.n_clusters + choice->nearest.n_clusters == 0) {
            g_propagate_error(error, g_steal_pointer(&failed));
            return FALSE;
        }
        worse = PATIENCE;
    } else if (lpca && (choice->best.n_clusters == 0 || choosing->target->error > 0 ||
                        lpca->error < choice->best.error)) {
        /* Each model that reaches the error is smaller than the one before, because
         * max_components() limits its size. */
        lpca_free(choosing->best);
        choice->best = (struct lpca_nearest){lpca->n_clusters, lpca->n_components, lpca->error};
        if (now.checkpoint)
            lpca_keep_whole(now.checkpoint, "best", lpca);
        choosing->best = g_steal_pointer(&lpca);
        worse = 0;
    } else if (nearest.n_clusters > 0 &&
               (choice->nearest.n_clusters == 0 || nearest.error < choice->nearest.error)) {
        choice->nearest = nearest;
        worse = choosing->best ? worse : 0;
    }
    choice->worse = worse;
    choice->clusters *= 2;
    return TRUE;
}

/* Takes the choice from the checkpoint if the checkpoint has a choice for the same target.
 * Otherwise begins with one cluster. */
static void resume(struct choosing *choosing) {
    Checkpoint *checkpoint = choosing->options->checkpoint;
    const struct lpca_target *target = choosing->target;
    choosing->choice = (struct choice){.target = *target, .clusters = 1};
    if (!checkpoint)
        return;
    g_autofree char *what =
        g_strdup_printf("choose %.17g, %" G_GINT64_FORMAT ", %d, %d, %d", target->error,
                        target->bytes, target->n_components, (int)target->quantise, target->n_grid);
    btf_checkpoint_begin(checkpoint, choosing->btf, what);
    const struct choice *found = checkpoint_get(checkpoint, "choice", sizeof *found);
    if (found && found->target.error == target->error && found->target.bytes == target->bytes) {
        const struct lpca_nearest *best = &found->best;
        choosing->best = lpca_kept_whole(checkpoint, "best", choosing->btf, best->n_clusters,
                                         best->n_components);
        if (choosing->best || best->n_clusters == 0)
            choosing->choice = *found;
    }
    if (choosing->best) {
        choosing->best->error = choosing->choice.best.error;
        choosing->best->colours = choosing->options->colours;
        lpca_keep_whole(checkpoint, "best", choosing->best);
    }
    checkpoint_keep(checkpoint, "choice", &choosing->choice, sizeof choosing->choice);
}

/* Returns whether the eigen-BRDF of a component is not 0 in some cluster. */
static gboolean is_used(const struct lpca *lpca, int component) {
    const gsize d = btf_layout_values(&lpca->layout);
    for (int k = 0; k < lpca->n_clusters; k++) {
        const float *brdf = lpca_brdf(lpca, k, component);
        for (gsize i = 0; i < d; i++)
            if (brdf[i] != 0)
                return TRUE;
    }
    return FALSE;
}

/* Returns the local PCA without the last components if they are 0 in all clusters. Takes ownership
 * of lpca. A target size may allow more components than a material needs. */
static struct lpca *without_unused(struct lpca *lpca) {
    int c = lpca->n_components;
    while (c > 1 && !is_used(lpca, c))
        c--;
    if (c == lpca->n_components)
        return lpca;
    struct lpca *fewer = lpca_truncated(lpca, c);
    fewer->error = lpca->error;
    lpca_free(lpca);
    return fewer;
}

struct lpca *lpca_choose(const struct btf_matrix *btf, const struct lpca_options *options,
                         const struct lpca_target *target, GError **error) {
    const gint64 most = MIN(btf_layout_texels(&btf->layout), LPCA_MAX_CLUSTERS);
    struct choosing choosing = {btf, options, target, {.target = *target}, NULL};
    gboolean ok = TRUE;
    if (target->bytes > 0 && max_components(&choosing, 1) == 0) {
        g_autofree char *wanted = g_format_size((guint64)target->bytes);
        g_autofree char *least = g_format_size((guint64)size_of(btf, target, 1, 1));
        g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                    "a size of %s is too small: one cluster of one component already takes %s; "
                    "allow a larger size",
                    wanted, least);
        return NULL;
    }
    resume(&choosing);
    while (ok && choosing.choice.clusters <= most && choosing.choice.worse < PATIENCE)
        ok = try_clusters(&choosing, error);
    if (options->checkpoint) {
        checkpoint_drop(options->checkpoint, "choice");
        lpca_drop_whole(options->checkpoint, "best");
    }
    if (!ok)
        g_clear_pointer(&choosing.best, lpca_free);
    else if (!choosing.best)
        return not_reached(&choosing, error);
    return ok ? without_unused(choosing.best) : NULL;
}
