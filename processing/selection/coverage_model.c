#include "coverage_model.h"

#include <math.h>
#include <string.h>

#define TILTS      7  /* number of tilts of axes, spread evenly in the cosine over 0 … TILT_DEG */
#define AZIMUTHS   24 /* number of azimuths of axes */
#define OPENINGS   7  /* number of half-angles of the cones */
#define TILT_DEG   60.0 /* largest angle of an axis from the normal */
#define NARROW_DEG 25.0 /* narrowest half-angle of a cone */
#define WIDE_DEG   85.0
/* Probability that a prediction of the model is wrong for a sweep: the sweep saw something where
 * the model predicts nothing, or the reverse. */
#define MISLED    0.05
#define SETTLES   0.03 /* s = SETTLES + BY_WEIGHT · q */
#define BY_WEIGHT 0.5
#define RAD(deg)  ((deg) * (G_PI / 180))
#define MAX_CONES (TILTS * AZIMUTHS * OPENINGS)

struct CoverageModel {
    int n_cones, n_sweeps;
    /* for each cone that the camera sees, the set of sweeps that light it */
    guint64 lights[MAX_CONES];
    double settles[COVERAGE_MAX_SWEEPS];
};

/* A cone with the axis v and the half-angle α contains the direction d if v·d > c, c = cos α. */
CoverageModel *coverage_model_new(struct vec3 camera, const struct vec3 *lasers,
                                  const double *quality, int n) {
    g_return_val_if_fail(n >= 0 && n <= COVERAGE_MAX_SWEEPS, NULL);
    CoverageModel *model = g_new0(CoverageModel, 1);
    model->n_sweeps = n;
    for (int i = 0; i < n; i++)
        model->settles[i] = SETTLES + BY_WEIGHT * CLAMP(quality[i], 0, 1);
    for (int k = 0; k < MAX_CONES; k++) {
        const int tilt = k / (AZIMUTHS * OPENINGS), turn = k / OPENINGS % AZIMUTHS;
        const double cosine = 1 - (1 - cos(RAD(TILT_DEG))) * (tilt + 0.5) / TILTS;
        const double sine = sqrt(1 - cosine * cosine), phi = 2 * G_PI * turn / AZIMUTHS;
        const struct vec3 axis = vec3(sine * cos(phi), sine * sin(phi), cosine);
        const double least =
            cos(RAD(NARROW_DEG + (WIDE_DEG - NARROW_DEG) * (k % OPENINGS) / (OPENINGS - 1)));
        guint64 lit = 0;
        if (!(vec3_dot(axis, camera) > least))
            continue;
        for (int i = 0; i < n; i++)
            if (vec3_dot(axis, lasers[i]) > least)
                lit |= (guint64)1 << i;
        model->lights[model->n_cones++] = lit;
    }
    return model;
}

void coverage_model_free(CoverageModel *model) {
    g_free(model);
}

double coverage_model_adds(const CoverageModel *model, guint64 taken, int sweep) {
    double sum = 0;
    for (int k = 0; k < model->n_cones; k++) {
        double open = 1; /* Π (1 − s) */
        if (!(model->lights[k] >> sweep & 1))
            continue;
        for (int i = 0; i < model->n_sweeps; i++)
            if (model->lights[k] & taken & (guint64)1 << i)
                open *= 1 - model->settles[i];
        sum += open * model->settles[sweep];
    }
    return model->n_cones > 0 ? sum / model->n_cones : 0;
}

/* Returns the share of the cones' weight that the sweep lights, Σ_k p_k [sweep lights k] / Σ_k p_k.
 * The weight of a cone is p_k = MISLED^m, where m is the number of taken sweeps for which the
 * prediction of cone k differs from the observation. */
double coverage_model_lights(const CoverageModel *model, guint64 taken, guint64 lit, int sweep) {
    double sum = 0, all = 0;
    for (int k = 0; k < model->n_cones; k++) {
        const int m = __builtin_popcountll((model->lights[k] ^ lit) & taken);
        const double p = pow(MISLED, m);
        all += p;
        sum += model->lights[k] >> sweep & 1 ? p : 0;
    }
    return all > 0 ? sum / all : 0;
}
