/* This file chooses a lens model by cross-validation. Whole pictures are left out, because the
 * residuals of one picture have errors in common, and neighbouring corners predict each other. */
#include "cameras_private.h"

#include <string.h>

#define FOLDS      5
#define WIDE_SIGMA 1   /* prior standard deviation of k1 … k6 of rational and fisheye lenses */
#define ROBUST     3   /* threshold of Huber's loss, in units of the noise */
#define MAX_LOSS   4.5 /* larger residuals count as this value, in units of the noise */
/* A model is better if it lowers the sum of losses by more than this many standard errors of the
 * differences. For a bend, one standard error is sufficient. */
#define SIGNIFICANT 2
/* prior standard deviation of z at a distance of half the longer side from the centre, relative to
 * this distance */
#define BENT 0.02

void cameras_set_lens(struct bundle_camera *camera, enum rig_lens lens) {
    static const int distortion[] = {4, 5, 6, 9, 10, 11}; /* k1 … k6 */
    if (lens != camera->lens)
        memset(camera->intrinsics + 4, 0, sizeof *camera->intrinsics * (BUNDLE_INTRINSICS - 4));
    camera->lens = lens;
    memcpy(camera->prior + 4, camera->intrinsics + 4,
           sizeof *camera->prior * (BUNDLE_INTRINSICS - 4));
    for (gsize i = 0; lens != RIG_LENS_POLYNOMIAL && i < G_N_ELEMENTS(distortion); i++)
        camera->prior_sigma[distortion[i]] = WIDE_SIGMA;
}

/* A fit of one model to all pictures. It has copies of the parts of the bundle that it changes. */
struct trial {
    struct bundle bundle;
    gboolean ok;
    /* Loss of each picture. A lens that was fitted to the other folds predicts the corners of the
     * picture. */
    double *loss;
};

static void copy_bundle(struct bundle *to, const struct bundle *from) {
    *to = *from;
    to->cameras = g_memdup2(from->cameras, sizeof *to->cameras);
    to->lays = g_memdup2(from->lays, sizeof *to->lays * (gsize)from->n_lays);
    to->stops = g_memdup2(from->stops, sizeof *to->stops * (gsize)from->n_stops);
    to->observations =
        g_memdup2(from->observations, sizeof *to->observations * (gsize)from->n_observations);
}

static void free_bundle(struct bundle *bundle) {
    g_free(bundle->cameras);
    g_free(bundle->lays);
    g_free(bundle->stops);
    g_free(bundle->observations);
}

static gboolean fit_all(struct trial *ret) {
    ret->bundle.robust = ROBUST;
    ret->bundle.coarse = TRUE;
    for (int round = 0; round < 2; round++) { /* Huber's threshold depends on the noise */
        if (!bundle_solve(&ret->bundle, NULL))
            return FALSE;
        cameras_estimate_noise(&ret->bundle);
    }
    return TRUE;
}

/* Adds Σ min((r / noise)², MAX_LOSS²) to the loss of each picture of a fold. Returns FALSE if a fit
 * fails. The lens is fitted to the pictures of all other folds, and then only the poses of the
 * boards in this fold are fitted. */
static gboolean predict(const struct trial *trial, int fold, double noise, double *loss) {
    struct bundle b;
    double d[2];
    copy_bundle(&b, &trial->bundle);
    b.cameras[0].noise = noise;
    for (int i = 0; i < b.n_observations; i++)
        b.observations[i].rejected = b.observations[i].picture % FOLDS == fold;
    gboolean ok = bundle_solve(&b, NULL);
    for (int i = 0; i < b.n_observations; i++)
        b.observations[i].rejected = !b.observations[i].rejected;
    b.cameras[0].fixed_lens = TRUE;
    b.bend_sigma = 0;
    ok = ok && bundle_solve(&b, NULL);
    for (int i = 0; ok && i < b.n_observations; i++) {
        const double r = cameras_residual(&b, &b.observations[i], d) / noise;
        if (!b.observations[i].rejected)
            loss[b.observations[i].picture] += MIN(r * r, MAX_LOSS * MAX_LOSS);
    }
    free_bundle(&b);
    return ok;
}

/* Returns whether model b predicts better than model a: Σ d > errors · √(Σ d²), where d is the loss
 * of a picture with a minus the loss of this picture with b. */
static gboolean is_better(const double *a, const double *b, int n, double errors) {
    double sum = 0, squares = 0;
    for (int i = 0; i < n; i++) {
        sum += a[i] - b[i];
        squares += (a[i] - b[i]) * (a[i] - b[i]);
    }
    return sum > errors * sqrt(squares);
}

/* Fits a bend that all pictures have in common. The bundle of `flat` is replaced by this fit if the
 * bend improves the prediction of corners. */
static void try_bend(const struct cameras_work *work, struct trial *flat) {
    const int n = work->task->n_pictures;
    struct trial trials[2] = {*flat};
    double size_mm[2];
    board_size_mm(&work->task->board, size_mm);
    copy_bundle(&trials[1].bundle, &flat->bundle);
    trials[1].bundle.bend_sigma = BENT * 2 / MAX(size_mm[0], size_mm[1]);
    gboolean ok = fit_all(&trials[1]);
    const double noise = MIN(flat->bundle.cameras[0].noise, trials[1].bundle.cameras[0].noise);
    for (int i = 0; i < 2; i++) {
        trials[i].loss = g_new0(double, n + 1);
        for (int fold = 0; ok && fold < FOLDS; fold++)
            ok = predict(&trials[i], fold, noise, trials[i].loss);
    }
    const gboolean bent = ok && is_better(trials[0].loss, trials[1].loss, n, 1);
    if (bent)
        flat->bundle = trials[1].bundle;
    free_bundle(&trials[bent ? 0 : 1].bundle);
    g_free(trials[0].loss);
    g_free(trials[1].loss);
}

/* The polynomial is the default. The fisheye and then the rational lens, which has more parameters,
 * are compared with the best model so far. If the lens model is given, only this model is fitted,
 * as a start of the refinement. The refinement needs this start, because from a lens without
 * distortion it may end at a minimum where the parameters of a rational lens are undetermined. */
gboolean cameras_choose_lens(struct cameras_work *work, GError **error) {
    static const enum rig_lens order[] = {RIG_LENS_POLYNOMIAL, RIG_LENS_FISHEYE, RIG_LENS_RATIONAL};
    const int n = work->task->n_pictures;
    struct trial trials[RIG_LENSES] = {0}, *best = NULL;
    double noise = G_MAXDOUBLE, scale_px = 0, d[2];
    cameras_set_observations(work);
    for (int i = 0; i < RIG_LENSES; i++) {
        trials[i].loss = g_new0(double, n + 1);
        if (work->task->lens_given && work->task->lens != (enum rig_lens)i)
            continue;
        copy_bundle(&trials[i].bundle, &work->bundle);
        cameras_set_lens(&trials[i].bundle.cameras[0], (enum rig_lens)i);
        trials[i].ok = fit_all(&trials[i]);
        if (trials[i].ok)
            noise = MIN(noise, trials[i].bundle.cameras[0].noise);
    }
    for (gsize k = 0; k < G_N_ELEMENTS(order); k++) {
        struct trial *trial = &trials[order[k]];
        for (int fold = 0; trial->ok && !work->task->lens_given && fold < FOLDS; fold++)
            trial->ok = predict(trial, fold, noise, trial->loss);
        if (trial->ok && (!best || is_better(best->loss, trial->loss, n, SIGNIFICANT)))
            best = trial;
    }
    if (!best) /* no model could be fitted; the refinement will report why */
        best = &trials[work->task->lens_given ? work->task->lens : RIG_LENS_POLYNOMIAL];
    /* Computes how many pixels one unit of the whitened residual is, as a median over the corners.
     * It converts losses to pixels for display. */
    g_autoptr(GArray) ratios = g_array_new(FALSE, FALSE, sizeof(double));
    for (int i = 0; best->ok && i < best->bundle.n_observations; i++) {
        const double r = cameras_residual(&best->bundle, &best->bundle.observations[i], d);
        const double ratio = r > 0 && r < G_MAXDOUBLE ? hypot(d[0], d[1]) / r : 0;
        g_array_append_val(ratios, ratio);
    }
    if (ratios->len)
        scale_px = noise * cameras_median(ratios);
    for (int i = 0; i < RIG_LENSES; i++) {
        double sum = 0;
        for (int k = 0; k < n; k++)
            sum += trials[i].loss[k];
        if (trials[i].ok && sum > 0)
            work->held_out_px[i] = scale_px * sqrt(sum / work->bundle.n_observations);
    }
    if (best->ok) {
        struct bundle *to = &work->bundle;
        try_bend(work, best);
        memcpy(to->bend, best->bundle.bend, sizeof to->bend);
        to->bend_sigma = best->bundle.bend_sigma;
        *to->cameras = *best->bundle.cameras;
        to->cameras->noise = 1;
        memcpy(to->lays, best->bundle.lays, sizeof *to->lays * (gsize)to->n_lays);
    }
    for (int i = 0; i < RIG_LENSES; i++) {
        free_bundle(&trials[i].bundle);
        g_free(trials[i].loss);
    }
    return cameras_progress(work, error);
}
