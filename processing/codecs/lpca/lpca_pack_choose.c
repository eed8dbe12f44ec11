#include "base/data_error.h"
#include "btf/btf_checkpoint.h"
#include "lpca_choose.h"
#include "lpca_pack_private.h"

#include <errno.h>
#include <glib/gstdio.h>
#include <math.h>
#include <unistd.h>

#define FIRST  64    /* first number of components that is tried */
#define ENOUGH 0.7   /* maximum part of the target error that left-out components may cause */
#define COARSE 4.0   /* coarsest step, relative to lpca_mean_size() */
#define FINE   1e-4  /* finest step, relative to lpca_mean_size() */
#define TRIES  12    /* maximum number of steps that are tried */
#define CLOSE  0.995 /* an error of at least this part of the target is accepted */

/* The state of the search. The checkpoint stores it byte by byte. */
struct packing {
    struct lpca_target target;
    /* n     number of components that is being tried
     * made  1 if the local PCA of n components is computed and in the checkpoint, otherwise 0 */
    gint32 n, made;
    double exact;        /* lpca_error() with n components before rounding */
    double found[TRIES]; /* lpca_error() for each step that was tried; 0 if not tried yet */
};

struct search {
    const struct btf_matrix *btf;
    const struct lpca_options *options;
    const struct lpca_target *target;
    int most;     /* maximum number of components */
    double exact; /* lpca_error() before rounding */
    /* With a target error, the smallest error that was found. With a target size, the size of the
     * last file that was too large. */
    double nearest;
    struct packing packing;
};

double lpca_mean_size(const struct lpca *lpca) {
    const gsize d = btf_layout_values(&lpca->layout);
    double sum = 0;
    for (gsize i = 0; i < d; i++)
        sum += (double)lpca->brdfs[i] * lpca->brdfs[i];
    return sqrt(sum / (double)d);
}

gint64 lpca_packed_bytes(const struct lpca *lpca, GError **error) {
    g_autofree char *path = NULL;
    GStatBuf status = {0};
    const int fd = g_file_open_tmp("mesorig-XXXXXX.exr", &path, error);
    if (fd < 0)
        return 0;
    close(fd);
    struct exr_file *file = lpca_to_exr(lpca);
    if (exr_write(path, file, EXR_ZIP, FALSE, error) && g_stat(path, &status) != 0)
        g_set_error(error, EXR_ERROR, EXR_ERROR_IO,
                    "%s: the size of this temporary file cannot be determined: %s; check the disk",
                    path, g_strerror(errno));
    exr_file_free(file);
    g_unlink(path);
    return status.st_size;
}

/* Returns the next step to try. The squared error is the sum of two parts: one from left-out
 * components, and one from rounding, which is nearly proportional to the squared step. From e² =
 * exact² + (a · step)² follows step' = step · √((target² − exact²) / (found² − exact²)). One call
 * changes the step by at most a factor of 10. */
static double guess_step(const struct search *search, double step, double found) {
    const double target = search->target->error * 0.998, exact = search->exact;
    const double should = sqrt(MAX(target * target - exact * exact, 0));
    const double is = sqrt(MAX(found * found - exact * exact, 0));
    return is > 0 ? step * CLAMP(should / is, 0.1, 10) : step * 10;
}

/* Finds the coarsest step that reaches the error. fine and coarse bracket the step. Returns NULL
 * without an error if no step reaches the target. Returns NULL with an error if the error of a
 * result cannot be measured. */
static struct lpca *by_error(struct search *search, const struct lpca_packer *packer, double mean,
                             GError **error) {
    double fine = mean * FINE, coarse = mean * COARSE;
    double step = 4 * search->target->error * mean;
    g_autoptr(Lpca) best = NULL;
    search->nearest = INFINITY;
    for (int i = 0; i < TRIES && coarse > fine * 1.002; i++) {
        g_autoptr(Lpca) lpca = lpca_packer_round(packer, step);
        lpca->error = search->packing.found[i];
        if (lpca->error <= 0 && !lpca_error_shared(lpca, search->btf, search->options, error))
            return NULL;
        const double found = search->packing.found[i] = lpca->error;
        search->nearest = MIN(search->nearest, found);
        if (found <= search->target->error) {
            fine = step;
            lpca_free(best);
            best = g_steal_pointer(&lpca);
            if (found >= search->target->error * CLOSE)
                break;
        } else {
            coarse = step;
        }
        const double guess = guess_step(search, step, found);
        step = guess > fine * 1.001 && guess < coarse * 0.999 ? guess : sqrt(fine * coarse);
    }
    return g_steal_pointer(&best);
}

/* Finds the finest step whose file is small enough, by bisection of the step's logarithm. Returns
 * NULL without an error if even the coarsest step gives a larger file. */
static struct lpca *by_size(struct search *search, const struct lpca_packer *packer, double mean,
                            GError **error) {
    double fine = log(mean * FINE), coarse = log(mean * COARSE);
    struct lpca *best = NULL;
    gboolean ok = TRUE;
    for (int i = 0; ok && i < TRIES; i++) {
        const double step = i == 0 ? coarse : (fine + coarse) / 2;
        g_autoptr(Lpca) lpca = lpca_packer_round(packer, exp(step));
        const gint64 bytes = lpca_packed_bytes(lpca, error);
        ok = bytes > 0;
        if (ok && bytes <= search->target->bytes) {
            coarse = step;
            lpca_free(best);
            best = g_steal_pointer(&lpca);
        } else if (ok) {
            search->nearest = (double)bytes;
            fine = step;
        }
        if (i == 0 && !best)
            break;
    }
    if (best && (!ok || !lpca_error_shared(best, search->btf, search->options, error)))
        g_clear_pointer(&best, lpca_free);
    return best;
}

/* Returns whether more components would not improve the result. */
static gboolean has_enough(const struct search *search, const struct lpca *exact,
                           const struct lpca *found) {
    if (search->target->error > 0)
        return exact->error <= ENOUGH * search->target->error;
    return found && found->n_components < exact->n_components;
}

/* Returns a packed local PCA of n components. Returns NULL without an error if the target is not
 * reached. *ret_exact is the local PCA before rounding. If it cannot be computed, *ret_exact and
 * the result are NULL, with an error. */
static struct lpca *try_components(struct search *search, int n, struct lpca **ret_exact,
                                   GError **error) {
    struct lpca_options options = *search->options;
    options.n_clusters = 1;
    options.n_components = n;
    options.target = 0;
    options.to_pack = TRUE;
    /* Takes the unrounded local PCA from the checkpoint or computes it, and registers it with the
     * checkpoint. */
    struct packing *packing = &search->packing;
    struct lpca *ret = NULL, *exact = NULL;
    if (options.checkpoint && packing->made)
        exact = lpca_kept_whole(options.checkpoint, "exact", search->btf, 1, n);
    if (exact)
        exact->error = packing->exact;
    else
        exact = lpca_compute(search->btf, &options, error);
    if (exact && options.checkpoint) {
        packing->made = TRUE;
        packing->exact = exact->error;
        lpca_keep_whole(options.checkpoint, "exact", exact);
    }
    *ret_exact = exact;
    if (!exact ||
        (search->target->error > 0 && n < search->most && !has_enough(search, exact, NULL)))
        return NULL;
    search->exact = exact->error;
    struct lpca_packer *packer = lpca_packer_new(exact, options.work.n_threads);
    const double mean = lpca_mean_size(exact);
    if (mean <= 0) /* a black material: any step can be used */
        ret = lpca_packer_round(packer, 1);
    else
        ret = (search->target->error > 0 ? by_error : by_size)(search, packer, mean, error);
    lpca_packer_free(packer);
    return ret;
}

/* Takes the state from the checkpoint if the checkpoint has a state for the same target. Returns
 * the number of components with which to begin. */
static int resume(struct search *search) {
    struct packing *packing = &search->packing;
    Checkpoint *checkpoint = search->options->checkpoint;
    const struct lpca_target *target = search->target;
    *packing = (struct packing){.target = *target, .n = MIN(FIRST, search->most)};
    if (!checkpoint)
        return packing->n;
    g_autofree char *what = g_strdup_printf("pack %.17g, %" G_GINT64_FORMAT ", %d", target->error,
                                            target->bytes, target->n_components);
    btf_checkpoint_begin(checkpoint, search->btf, what);
    const struct packing *found = checkpoint_get(checkpoint, "packing", sizeof *found);
    if (found && found->target.error == target->error && found->target.bytes == target->bytes &&
        found->target.n_components == target->n_components && found->n >= 1 &&
        found->n <= search->most)
        *packing = *found;
    checkpoint_keep(checkpoint, "packing", packing, sizeof *packing);
    return packing->n;
}

/* Doubles the number of components until more would not improve the result. */
static struct lpca *find(struct search *search, GError **error) {
    const struct lpca_target *target = search->target;
    for (int n = resume(search);; n = MIN(2 * n, search->most)) {
        g_autoptr(GError) failed = NULL;
        g_autoptr(Lpca) exact = NULL;
        g_autoptr(Lpca) lpca = try_components(search, n, &exact, &failed);
        const gboolean enough = exact && has_enough(search, exact, lpca);
        const double left = exact ? exact->error : 0;
        search->packing =
            (struct packing){.target = *search->target, .n = MIN(2 * n, search->most)};
        if (search->options->checkpoint) /* drops the saved state of these components */
            lpca_drop_whole(search->options->checkpoint, "exact");
        if (failed) {
            g_propagate_error(error, g_steal_pointer(&failed));
            return NULL;
        }
        if (lpca && (enough || n == search->most))
            return g_steal_pointer(&lpca);
        if (n < search->most)
            continue;
        if (target->error > 0 && !isfinite(search->nearest)) {
            g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                        "an error of %.3g %% is not reached: %d components give %.3g %% even "
                        "without rounding; allow a larger error, or more components if "
                        "--components limits them",
                        100 * target->error, n, 100 * left);
            return NULL;
        }
        if (target->error > 0) {
            g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                        "an error of %.3g %% is not reached: %d components give %.3g %% without "
                        "rounding and %.3g %% with it; allow a larger error, or more components if "
                        "--components limits them",
                        100 * target->error, n, 100 * left, 100 * search->nearest);
            return NULL;
        }
        g_autofree char *wanted = g_format_size((guint64)target->bytes);
        g_autofree char *least = g_format_size((guint64)search->nearest);
        g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                    "a file size of %s is too small: even with the coarsest rounding the file has "
                    "%s; allow a larger size",
                    wanted, least);
        return NULL;
    }
}

struct lpca *lpca_pack(const struct btf_matrix *btf, const struct lpca_options *options,
                       const struct lpca_target *target, GError **error) {
    const gint64 texels = btf_layout_texels(&btf->layout);
    const gint64 values = btf_layout_values(&btf->layout);
    const int asked =
        target->n_components > 0 ? MIN(target->n_components, LPCA_MAX_PACKED) : LPCA_MAX_PACKED;
    struct search search = {btf, options, target, (int)MIN(MIN(texels, values), asked),
                            0,   INFINITY};
    g_return_val_if_fail(options->colours == LPCA_RGB && !options->team, NULL);
    struct lpca *lpca = find(&search, error);
    if (options->checkpoint)
        checkpoint_drop(options->checkpoint, "packing");
    return lpca;
}
