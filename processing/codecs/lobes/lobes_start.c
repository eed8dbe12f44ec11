#include "lobes_private.h"

#include <cblas.h>
#include <lapacke.h>
#include <math.h>
#include <string.h>

#define MIN_SPACING 0.02F /* radians: lights that are closer than this count as one */
/* minimum initial amplitude of a lobe, relative to the brightest value */
#define NARROW   0.05F
#define TANGENTS 2 /* number of initial directions of the tangent: along x and along y */

struct lobes_start {
    const struct lobes_fit *fit;
    float spacing;    /* mean angle between a light and the nearest other light, radians */
    float *planes;    /* 3 × n_lights: pseudo-inverse of the lights' directions */
    float *high_pass; /* n_lights²: matrix of high_pass() */
};

static float angle(const float *a, const float *b) {
    return acosf(CLAMP(cblas_sdot(3, a, 1, b, 1), -1, 1));
}

/* Returns the mean angle between a light and the nearest other light that is more than MIN_SPACING
 * away, in radians. The angle of a light without such a light is π/2. */
static float spacing(const struct lobes_fit *fit) {
    float sum = 0;
    for (int i = 0; i < fit->n_lights; i++) {
        float nearest = (float)G_PI_2;
        for (int j = 0; j < fit->n_lights; j++) {
            const float away = angle(fit->lights + 3 * i, fit->lights + 3 * j);
            if (j != i && away > MIN_SPACING)
                nearest = MIN(nearest, away);
        }
        sum += nearest;
    }
    return sum / (float)fit->n_lights;
}

/* Returns the matrix 1 − K (n_lights²), which subtracts from each light's value the weighted mean
 * of the lights around it. K_ij = exp(−(α_ij / width)²) / Σ_j exp(−(α_ij / width)²), where α_ij is
 * the angle between the lights i and j. */
static float *high_pass(const struct lobes_fit *fit, float width) {
    const int n = fit->n_lights;
    float *matrix = g_new(float, n *n);
    for (int i = 0; i < n; i++) {
        float sum = 0;
        for (int j = 0; j < n; j++) {
            const float away = angle(fit->lights + 3 * i, fit->lights + 3 * j) / width;
            sum += matrix[i * n + j] = expf(-away * away);
        }
        for (int j = 0; j < n; j++)
            matrix[i * n + j] = (i == j ? 1.0F : 0.0F) - matrix[i * n + j] / sum;
    }
    return matrix;
}

/* Returns (LᵀL)⁻¹Lᵀ (3 × n_lights) of the directions L of the lights (n_lights × 3). A small number
 * is added to the diagonal of LᵀL, which lights in one plane would make singular. */
static float *planes(const struct lobes_fit *fit) {
    const int n = fit->n_lights;
    float squares[9], *inverse = g_memdup2(fit->lights, sizeof(float) * 3 * (gsize)n);
    cblas_sgemm(CblasRowMajor, CblasTrans, CblasNoTrans, 3, 3, n, 1, fit->lights, 3, fit->lights, 3,
                0, squares, 3);
    for (int i = 0; i < 3; i++)
        squares[4 * i] += 1e-4F * (float)n;
    LAPACKE_sposv(LAPACK_COL_MAJOR, 'U', 3, n, squares, 3, inverse, 3);
    return inverse; /* 3 × n in column-major order */
}

struct lobes_start *lobes_start_new(const struct lobes_fit *fit) {
    struct lobes_start *start = g_new0(struct lobes_start, 1);
    start->fit = fit;
    start->spacing = spacing(fit);
    start->high_pass = high_pass(fit, 1.5F * start->spacing);
    start->planes = planes(fit);
    return start;
}

void lobes_start_free(struct lobes_start *start) {
    if (!start)
        return;
    g_free(start->planes);
    g_free(start->high_pass);
    g_free(start);
}

int lobes_start_variants(const struct lobes_fit *fit) {
    return fit->model == LOBES_FIELDS || fit->model == LOBES_LAFORTUNE ? 2 : TANGENTS;
}

/* Computes the mean of each light's values over the views. A light without values gets the mean of
 * all values. Returns the mean of all values, 0 if there are none. */
static float mean_lights(const struct lobes_fit *fit, const float *row, float *ret) {
    double all = 0;
    int n_all = 0;
    for (int light = 0; light < fit->n_lights; light++) {
        double sum = 0;
        int n = 0;
        for (int view = 0; view < fit->n_views; view++) {
            const float value = row[view * fit->n_lights + light];
            sum += isnan(value) ? 0 : value;
            n += !isnan(value);
        }
        ret[light] = n ? (float)(sum / n) : NAN;
        all += sum;
        n_all += n;
    }
    const float mean = n_all ? (float)(all / n_all) : 0;
    for (int light = 0; light < fit->n_lights; light++)
        ret[light] = isnan(ret[light]) ? mean : ret[light];
    return mean;
}

/* Finds n lobes in addition to the diffuse lobe. Each lobe points towards a light whose value
 * exceeds the values of the lights around it. The lights are taken in the order of this excess, the
 * largest first. The first `skip` lights of this order get no lobe. `lights` has a value for each
 * light. */
static void find_lobes(const struct lobes_start *start, const float *lights, int skip, int n,
                       float *ret) {
    const int count = start->fit->n_lights;
    g_autofree float *left = g_new(float, count);
    /* A lobe with this exponent falls to a half at the angle start->spacing. */
    const float exponent =
        CLAMP(-logf(2) / logf(cosf(MIN(start->spacing, 1.5F))), 1.5F, LOBES_MAX_EXPONENT / 2);
    float brightest = 0;
    cblas_sgemv(CblasRowMajor, CblasNoTrans, count, count, 1, start->high_pass, count, lights, 1, 0,
                left, 1);
    for (int i = 0; i < count; i++)
        brightest = MAX(brightest, lights[i]);
    for (int i = 0; i < skip + n; i++) {
        int best = 0;
        for (int j = 1; j < count; j++)
            best = left[j] > left[best] ? j : best;
        const float *direction = start->fit->lights + 3 * best;
        const float peak = MAX(left[best], NARROW * brightest);
        for (int k = 0; i >= skip && k < 3; k++)
            ret[4 * (i - skip) + k] = peak * direction[k];
        if (i >= skip)
            ret[4 * (i - skip) + 3] = logf(exponent);
        for (int j = 0; j < count; j++)
            if (angle(direction, start->fit->lights + 3 * j) < 1.5F * start->spacing)
                left[j] = -G_MAXFLOAT;
    }
}

/* Finds the diffuse lobe g by least squares: the products g · l are nearest to the values of the
 * lights l. If g is small or points below the horizon, it becomes (0, 0, mean). */
static void find_diffuse(const struct lobes_start *start, const float *lights, float mean,
                         float ret[3]) {
    cblas_sgemv(CblasColMajor, CblasNoTrans, 3, start->fit->n_lights, 1, start->planes, 3, lights,
                1, 0, ret, 1);
    if (!(cblas_snrm2(3, ret, 1) > 0.1F * mean) || ret[2] < 0) {
        ret[0] = ret[1] = 0;
        ret[2] = mean;
    }
}

static void start_facet(const struct lobes_start *start, int variant, const float *lights,
                        float mean, float *ret) {
    const gboolean ward = start->fit->model == LOBES_WARD;
    float normal[3];
    find_diffuse(start, lights, mean, normal);
    const float size = cblas_snrm2(3, normal, 1), up = MAX(normal[2], 0.3F * size + 1e-6F);
    ret[0] = -normal[0] / up;
    ret[1] = -normal[1] / up;
    ret[2] = (float)G_PI / TANGENTS * (float)variant;
    ret[3] = logf(ward ? 0.25F : 30);
    ret[4] = logf(ward ? 0.5F : 8);
    ret[5] = 0.7F * size;
    ret[6] = 0.3F * size;
}

void lobes_start_rows(const struct lobes_start *start, int variant, const float *rows, int n,
                      float *ret_parameters) {
    /* (X, Y, Z, N) of a mirror reflection, of a reflection back to the light, and of a broad
     * lobe. */
    static const float shapes[3][4] = {{-1, -1, 1, 8}, {1, 1, 1, 3}, {-0.5F, -0.5F, 1, 2}};
    const struct lobes_fit *fit = start->fit;
    const int parameters = lobes_fit_parameters(fit), k = fit->n_lobes;
    g_autofree float *lights = g_new(float, fit->n_lights);
    memset(ret_parameters, 0, sizeof(float) * (gsize)(n * parameters));
    for (int i = 0; i < n; i++) {
        const float *row = rows + (gsize)i * (gsize)(fit->n_views * fit->n_lights);
        float *to = ret_parameters + (gsize)i * (gsize)parameters;
        const float mean = mean_lights(fit, row, lights);
        if (fit->model == LOBES_FIELDS) {
            find_diffuse(start, lights, mean, to);
            to[3] = variant ? logf(2) : 0;
            if (k > 1)
                find_lobes(start, lights, variant, k - 1, to + 4);
            /* The second variant begins with broader lobes in the next directions. */
            for (int lobe = 1; variant && lobe < k; lobe++)
                to[4 * lobe + 3] = logf(2);
        } else if (fit->model == LOBES_LAFORTUNE) {
            for (int lobe = 0; lobe < k; lobe++) {
                const float *shape = shapes[(lobe + variant) % 3];
                for (int j = 0; j < 3; j++)
                    to[4 * lobe + j] = 0.5F * mean * shape[j];
                to[4 * lobe + 3] = logf(shape[3]);
            }
            to[4 * k] = mean;
        } else {
            start_facet(start, variant, lights, mean, to);
        }
    }
}
