#include <string.h>

#include "lpca_private.h"

#include "btf/btf_checkpoint.h"

/* Version of the checkpoint's content. Increase it when the content changes. */
#define KEPT_FORM 1

static const char *const names[] = {
    [LPCA_KEPT_MEAN] = "lpca.mean",       [LPCA_KEPT_AXES] = "lpca.axes",
    [LPCA_KEPT_ROWS] = "lpca.rows",       [LPCA_KEPT_LABELS] = "lpca.labels",
    [LPCA_KEPT_MEANS] = "lpca.means",     [LPCA_KEPT_BASES] = "lpca.bases",
    [LPCA_KEPT_BRDFS] = "lpca.brdfs",     [LPCA_KEPT_WEIGHTS] = "lpca.weights",
    [LPCA_KEPT_SQUARES] = "lpca.squares",
};

/* The arrays that the checkpoint has in each stage. */
#define KEPT(what) (1U << LPCA_KEPT_##what)
static const guint kept_by[] = {
    [LPCA_REDUCING] = KEPT(MEAN) | KEPT(ROWS) | KEPT(AXES),
    [LPCA_REDUCED] = KEPT(MEAN) | KEPT(ROWS),
    [LPCA_CLUSTERING] = KEPT(MEAN) | KEPT(ROWS) | KEPT(LABELS) | KEPT(MEANS) | KEPT(BASES),
    [LPCA_REFINING] = KEPT(MEAN) | KEPT(ROWS) | KEPT(LABELS) | KEPT(MEANS) | KEPT(BASES) |
                      KEPT(BRDFS) | KEPT(SQUARES),
    [LPCA_WEIGHING] = KEPT(MEAN) | KEPT(ROWS) | KEPT(LABELS) | KEPT(BRDFS) | KEPT(WEIGHTS),
    [LPCA_MADE] = KEPT(MEAN) | KEPT(ROWS) | KEPT(LABELS) | KEPT(BRDFS) | KEPT(WEIGHTS),
};

/* Returns the number of bytes of an array, which depends on run->state. */
static gsize lpca_checkpoint_size_of(const struct lpca_run *run, enum lpca_kept what) {
    const struct lpca_state *state = &run->state;
    const gsize n = (gsize)run->n, d = (gsize)run->d, r = (gsize)run->r, c = (gsize)state->c;
    const gsize asked = (gsize)run->options->n_clusters, k = (gsize)state->k;
    switch (what) {
    case LPCA_KEPT_MEAN:
        return sizeof(float) * d;
    case LPCA_KEPT_AXES:
        return sizeof(float) * r * d;
    case LPCA_KEPT_ROWS:
        return sizeof(float) * n * r;
    case LPCA_KEPT_LABELS:
        return sizeof(int) * n;
    case LPCA_KEPT_MEANS:
        return sizeof(float) * asked * r;
    case LPCA_KEPT_BASES:
        return sizeof(float) * asked * c * r;
    case LPCA_KEPT_BRDFS:
        return sizeof(float) * k * (c + 1) * d;
    case LPCA_KEPT_WEIGHTS:
        return sizeof(float) * n * c;
    default:
        return sizeof(double) * k * run->btf->layout.views.n;
    }
}

/* Returns whether the state `found` belongs to a call with the same arguments, and the checkpoint
 * has all arrays of the stage of `found`. */
static gboolean is_whole(const struct lpca_run *run, const struct lpca_state *found,
                         const struct lpca_state *call) {
    struct lpca_run like = *run;
    const Checkpoint *checkpoint = run->options->checkpoint;
    if (found->form != call->form || found->n_clusters != call->n_clusters ||
        found->n_components != call->n_components || found->colours != call->colours ||
        found->to_pack != call->to_pack || found->target != call->target ||
        found->stage < LPCA_REDUCING || found->stage > LPCA_MADE)
        return FALSE;
    like.state = *found;
    /* If the run was stopped between clustering and refining, there are no eigen-BRDFs yet. */
    const guint begun = KEPT(BRDFS) | KEPT(SQUARES);
    const guint needed = kept_by[found->stage] & ~(found->stage == LPCA_REFINING ? begun : 0);
    for (int i = 0; i < LPCA_KEPT_KINDS; i++)
        if (needed & 1U << i && !checkpoint_get(checkpoint, names[i],
                                                lpca_checkpoint_size_of(&like, (enum lpca_kept)i)))
            return FALSE;
    return TRUE;
}

void lpca_resume(struct lpca_run *run) {
    const struct lpca_options *options = run->options;
    const struct lpca_state call = {.form = KEPT_FORM,
                                    .n_clusters = options->n_clusters,
                                    .n_components = options->n_components,
                                    .colours = options->colours,
                                    .to_pack = options->to_pack,
                                    .target = options->target};
    run->state = call;
    if (!options->checkpoint)
        return;
    g_autofree char *what =
        g_strdup_printf("lpca %d × %d, colours %d, %d, error %.17g", options->n_clusters,
                        options->n_components, options->colours, options->to_pack, options->target);
    btf_checkpoint_begin(options->checkpoint, run->btf, what);
    const struct lpca_state *found =
        checkpoint_get(options->checkpoint, "lpca.state", sizeof run->state);
    if (found && is_whole(run, found, &call))
        run->state = *found;
    else
        lpca_leave(run);
    checkpoint_keep(options->checkpoint, "lpca.state", &run->state, sizeof run->state);
}

void lpca_keep(struct lpca_run *run, enum lpca_kept what, gpointer values) {
    Checkpoint *checkpoint = run->options->checkpoint;
    const gsize size = lpca_checkpoint_size_of(run, what);
    if (!checkpoint)
        return;
    gconstpointer found = checkpoint_get(checkpoint, names[what], size);
    if (found)
        memcpy(values, found, size);
    checkpoint_keep(checkpoint, names[what], values, size);
}

void lpca_enter(struct lpca_run *run, enum lpca_stage stage) {
    run->state.stage = (gint32)stage;
    for (int i = 0; run->options->checkpoint && i < LPCA_KEPT_KINDS; i++)
        if (!(kept_by[stage] & 1U << i))
            checkpoint_drop(run->options->checkpoint, names[i]);
}

void lpca_keep_blocks(struct lpca_run *run, int n) {
    Checkpoint *checkpoint = run->options->checkpoint;
    if (!checkpoint)
        return;
    const gsize size = sizeof(int) * (gsize)n;
    const int *found = checkpoint_get(checkpoint, "lpca.blocks", size);
    run->done = found ? g_memdup2(found, size) : g_new0(int, n);
    checkpoint_keep_flags(checkpoint, "lpca.blocks", run->done, n);
}

void lpca_drop_blocks(struct lpca_run *run) {
    if (!run->done)
        return;
    checkpoint_drop(run->options->checkpoint, "lpca.blocks");
    g_clear_pointer(&run->done, g_free);
}

void lpca_leave(struct lpca_run *run) {
    if (!run->options->checkpoint)
        return;
    for (int i = 0; i < LPCA_KEPT_KINDS; i++)
        checkpoint_drop(run->options->checkpoint, names[i]);
    checkpoint_drop(run->options->checkpoint, "lpca.state");
    checkpoint_drop(run->options->checkpoint, "lpca.blocks");
    g_clear_pointer(&run->done, g_free);
}

/* An array of a complete local PCA in the checkpoint. */
struct piece {
    const char *name;
    gpointer values;
    gsize size;
};
#define PIECES 3

static void pieces(const struct lpca *lpca, struct piece ret[PIECES]) {
    const gsize n = btf_layout_texels(&lpca->layout), c = (gsize)lpca->n_components;
    const gsize d = btf_layout_values(&lpca->layout);
    ret[0] = (struct piece){"clusters", lpca->clusters, sizeof(int) * n};
    ret[1] = (struct piece){"weights", lpca->weights, sizeof(float) * n * c};
    ret[2] =
        (struct piece){"brdfs", lpca->brdfs, sizeof(float) * (gsize)lpca->n_clusters * (c + 1) * d};
}

void lpca_keep_whole(Checkpoint *checkpoint, const char *name, const struct lpca *lpca) {
    struct piece all[PIECES];
    pieces(lpca, all);
    for (int i = 0; i < PIECES; i++) {
        g_autofree char *full = g_strdup_printf("%s.%s", name, all[i].name);
        checkpoint_keep(checkpoint, full, all[i].values, all[i].size);
    }
}

struct lpca *lpca_kept_whole(const Checkpoint *checkpoint, const char *name,
                             const struct btf_matrix *btf, int n_clusters, int n_components) {
    struct piece all[PIECES];
    if (n_clusters < 1 || n_components < 1)
        return NULL;
    struct lpca *lpca = lpca_new(btf, n_clusters, n_components);
    pieces(lpca, all);
    for (int i = 0; lpca && i < PIECES; i++) {
        g_autofree char *full = g_strdup_printf("%s.%s", name, all[i].name);
        gconstpointer found = checkpoint_get(checkpoint, full, all[i].size);
        if (found)
            memcpy(all[i].values, found, all[i].size);
        else
            g_clear_pointer(&lpca, lpca_free);
    }
    return lpca;
}

void lpca_drop_whole(Checkpoint *checkpoint, const char *name) {
    static const char *const parts[PIECES] = {"clusters", "weights", "brdfs"};
    for (int i = 0; i < PIECES; i++) {
        g_autofree char *full = g_strdup_printf("%s.%s", name, parts[i]);
        checkpoint_drop(checkpoint, full);
    }
}
