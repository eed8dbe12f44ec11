#include "maps_fit_private.h"

#include <math.h>
#include <string.h>

#define SIZE         MAPS_REFINE_SIZE
#define LANES        16               /* SIZE, rounded up to whole vectors of a processor */
#define WEIGHT       (MAPS_SHAPE - 1) /* index of the specular weight w */
#define STEP         1e-3F            /* step of the finite differences of the lobes */
#define FLOOR        0.5F /* f in the loss √(|difference|² + f²), in units of CIEDE2000 */
#define ENOUGH       2e-4 /* relative decrease below which the search ends */
#define TRIES        4    /* number of dampings that are tried in a step */
#define MOVING_SHAPE 5    /* normal and widths; the lobes do not depend on w */

struct maps_refiner {
    const struct maps_pairs *pairs;
    const struct maps_layers *layers;
    int n;       /* number of pairs with a value */
    int *used;   /* Index in `pairs` of each of the n pairs. The arrays below have this order. */
    double area; /* Σ a_i */
    /* For each pair with a value:
     *   lab      L*, a* and b* of the value
     *   scales   factors by which differences of L*, a* and b* are multiplied
     *   weights  the weight a_i
     *   left     share of the light that the layers leave
     *   added    light that the layers add */
    float *lab[3], *scales[3], *weights, *left, *added[3];
    /* The two lobes of the shape. Then, for each of the first MOVING_SHAPE values of the shape, the
     * two lobes of the shape in which this value has moved by STEP. */
    float *lobes[2 * (MOVING_SHAPE + 1)];
    float *trial[2];
    float *colours[3]; /* the differences r_i */
    float *moved[3];
};

#define PLANES (3 + 3 + 1 + 1 + 3 + 2 * (MOVING_SHAPE + 1) + 2 + 3 + 3)

static void planes(struct maps_refiner *refiner, float **ret[PLANES]) {
    int n = 0;
    for (int k = 0; k < 3; k++) {
        ret[n++] = &refiner->lab[k];
        ret[n++] = &refiner->scales[k];
        ret[n++] = &refiner->added[k];
        ret[n++] = &refiner->colours[k];
        ret[n++] = &refiner->moved[k];
    }
    ret[n++] = &refiner->weights;
    ret[n++] = &refiner->left;
    for (int k = 0; k < 2 * (MOVING_SHAPE + 1); k++)
        ret[n++] = &refiner->lobes[k];
    for (int k = 0; k < 2; k++)
        ret[n++] = &refiner->trial[k];
    g_assert(n == PLANES);
}

struct maps_refiner *maps_refiner_new(const struct maps_pairs *pairs,
                                      const struct maps_layers *layers) {
    struct maps_refiner *ret = g_new0(struct maps_refiner, 1);
    float **all[PLANES];
    ret->pairs = pairs;
    ret->layers = layers;
    ret->used = g_new(int, pairs->n);
    planes(ret, all);
    for (int k = 0; k < PLANES; k++)
        *all[k] = g_new0(float, pairs->n);
    return ret;
}

void maps_refiner_free(struct maps_refiner *refiner) {
    float **all[PLANES];
    if (!refiner)
        return;
    planes(refiner, all);
    for (int k = 0; k < PLANES; k++)
        g_free(*all[k]);
    g_free(refiner->used);
    g_free(refiner);
}

/* XYZ of linear sRGB, relative to white (as in metrics/delta_e.c). */
static const float xyz[3][3] = {
    {0.4124564F / 0.95047F, 0.3575761F / 0.95047F, 0.1804375F / 0.95047F},
    {0.2126729F, 0.7151522F, 0.0721750F},
    {0.0193339F / 1.08883F, 0.1191920F / 1.08883F, 0.9503041F / 1.08883F}};

/* Gives L*, a* and b* of a colour, and the derivatives f' of CIE's curve at X, Y and Z. */
static inline void lab_of(const float rgb[3], float ret[3], float slopes[3]) {
    float f[3];
    for (int k = 0; k < 3; k++) {
        const float t = MAX(xyz[k][0] * rgb[0] + xyz[k][1] * rgb[1] + xyz[k][2] * rgb[2], 0);
        const gboolean root = t > 216.0F / 24389;
        f[k] = root ? cbrtf(t) : (24389.0F / 27 * t + 16) / 116;
        slopes[k] = root ? 1 / (3 * f[k] * f[k]) : 24389.0F / 27 / 116;
    }
    ret[0] = 116 * f[1] - 16;
    ret[1] = 500 * (f[0] - f[1]);
    ret[2] = 200 * (f[1] - f[2]);
}

/* Gives the factors by which differences of L*, a* and b* from a colour are multiplied. */
static void tolerances(const float lab[3], float ret[3]) {
    const float chroma = hypotf(lab[1], lab[2]), l = (lab[0] - 50) * (lab[0] - 50);
    const float seventh = powf(chroma / 25, 7), g = 0.5F * (1 - sqrtf(seventh / (seventh + 1)));
    const float sc = 1 + 0.045F * chroma;
    ret[0] = 1 / (1 + 0.015F * l / sqrtf(20 + l));
    ret[1] = (1 + g) / sc;
    ret[2] = 1 / sc;
}

/* Sets `left` and `added` of the i-th pair with a value, by the formulas of maps_model.h. p is the
 * index of this pair in refiner->pairs. */
static void layer(struct maps_refiner *refiner, const struct maps_texel *texel, int i, int p) {
    float *const *planes_of = refiner->pairs->planes;
    const struct maps_layers *layers = refiner->layers;
    const float extra = planes_of[MAPS_EXTRA][p];
    const double vz = (double)planes_of[MAPS_VZ][p], lz = (double)planes_of[MAPS_LZ][p];
    const float most = MAX(MAX(texel->sheen[0], texel->sheen[1]), texel->sheen[2]);
    refiner->left[i] = 1;
    for (int c = 0; c < 3; c++)
        refiner->added[c][i] = 0;
    if (layers->coat_roughness > 0)
        refiner->left[i] -= texel->coat * (float)(0.04 + 0.96 * pow(1 - vz, 5));
    if (layers->sheen_roughness > 0)
        refiner->left[i] *=
            1 - most * (float)MAX(maps_sheen_albedo(layers, vz), maps_sheen_albedo(layers, lz));
    for (int c = 0; c < 3; c++)
        refiner->added[c][i] =
            extra * (layers->sheen_roughness > 0 ? texel->sheen[c] : texel->coat);
}

gboolean maps_refiner_take(struct maps_refiner *refiner, const float *rgb,
                           const struct maps_texel *texel, gboolean half) {
    refiner->n = 0;
    refiner->area = 0;
    for (int p = 0; p < refiner->pairs->n; p++) {
        const float *value = rgb + 3 * (gsize)p;
        float lab[3], scales[3], slopes[3];
        const int i = refiner->n;
        if (half && (guint32)p * 0x9e3779b1U >> 31) /* scattered over views and lights */
            continue;
        if (!isfinite(value[0]) || !isfinite(value[1]) || !isfinite(value[2]))
            continue;
        const float positive[3] = {MAX(value[0], 0), MAX(value[1], 0), MAX(value[2], 0)};
        lab_of(positive, lab, slopes);
        tolerances(lab, scales);
        for (int k = 0; k < 3; k++) {
            refiner->lab[k][i] = lab[k];
            refiner->scales[k][i] = scales[k];
        }
        refiner->weights[i] = refiner->pairs->planes[MAPS_VZ][p];
        refiner->area += (double)refiner->weights[i];
        layer(refiner, texel, i, p);
        refiner->used[refiner->n++] = p;
    }
    return refiner->n > 0;
}

/* The factors of a pair's value that do not depend on its lobes. */
struct share {
    float f5, most;             /* most is the largest F_d of the colours */
    float below, edge, m1;      /* below is 1 − w most; m1 is 1 − m */
    float diffuse[3], shine[3]; /* the derivatives of the value by the two lobes */
};

static inline struct share share_of(const struct maps_refiner *refiner, const float *x, float f0,
                                    int i) {
    struct share ret;
    const float w = x[WEIGHT], m = x[MAPS_REFINE_METALLIC], left = refiner->left[i];
    ret.f5 = refiner->pairs->planes[MAPS_F5][refiner->used[i]];
    ret.most = f0 + (1 - f0) * ret.f5;
    ret.below = 1 - w * ret.most;
    ret.m1 = 1 - m;
    for (int c = 0; c < 3; c++) {
        const float base = x[MAPS_REFINE_BASE + c], f = x[MAPS_REFINE_F0 + c];
        ret.diffuse[c] = left * ret.m1 * ret.below * base;
        ret.shine[c] =
            left * (ret.m1 * w * (f + (1 - f) * ret.f5) + m * (base + (1 - base) * ret.f5));
    }
    return ret;
}

/* Returns the index of the largest of the three reflectances. */
static int largest(const float *x) {
    int ret = 0;
    for (int c = 1; c < 3; c++)
        if (x[MAPS_REFINE_F0 + c] > x[MAPS_REFINE_F0 + ret])
            ret = c;
    return ret;
}

/* Computes the lobes of a shape for all pairs with a value. */
static void lobes(struct maps_refiner *refiner, const float *shape, float *diffuse, float *lobe) {
    const struct maps_frame frame = maps_frame_of(shape);
    maps_frame_lobes(&frame, refiner->pairs, diffuse, lobe);
    for (int i = 0; i < refiner->n; i++) { /* used[i] is at least i */
        diffuse[i] = diffuse[refiner->used[i]];
        lobe[i] = lobe[refiner->used[i]];
    }
}

static double prior_cost(const struct maps_refine_prior *prior, const float *x) {
    double ret = 0;
    for (int k = 0; k < SIZE; k++) {
        const double off = (double)(x[k] - prior->mean.x[k]);
        ret += (double)prior->weights[k] * off * off;
    }
    return ret;
}

/* Computes the differences r_i of parameters whose lobes are known. Returns the cost. */
static double differences(const struct maps_refiner *refiner, const struct maps_refine_prior *prior,
                          const float *x, const float *diffuse, const float *lobe,
                          float *const ret[3]) {
    const float f0 = x[MAPS_REFINE_F0 + largest(x)];
    double sum = 0;
    for (int i = 0; i < refiner->n; i++) {
        const struct share share = share_of(refiner, x, f0, i);
        float value[3], lab[3], slopes[3], squares = FLOOR * FLOOR;
        for (int c = 0; c < 3; c++)
            value[c] =
                diffuse[i] * share.diffuse[c] + lobe[i] * share.shine[c] + refiner->added[c][i];
        lab_of(value, lab, slopes);
        for (int k = 0; k < 3; k++) {
            ret[k][i] = (lab[k] - refiner->lab[k][i]) * refiner->scales[k][i];
            squares += ret[k][i] * ret[k][i];
        }
        sum += (double)(refiner->weights[i] * sqrtf(squares));
    }
    return sum / refiner->area + prior_cost(prior, x);
}

/* Gives the derivatives of the three differences of pair i by all parameters. */
static inline void derivatives(const struct maps_refiner *refiner, const float *x, int top, int i,
                               float ret[3][LANES]) {
    const struct share share = share_of(refiner, x, x[MAPS_REFINE_F0 + top], i);
    const float diffuse = refiner->lobes[0][i], lobe = refiner->lobes[1][i];
    const float w = x[WEIGHT], m = x[MAPS_REFINE_METALLIC], left = refiner->left[i];
    const float rest = 1 - share.f5;
    float value[3], lab[3], slopes[3], by[3][SIZE] = {{0}};
    for (int c = 0; c < 3; c++) {
        const float base = x[MAPS_REFINE_BASE + c], f = x[MAPS_REFINE_F0 + c];
        const float fd = f + (1 - f) * share.f5, fm = base + (1 - base) * share.f5;
        value[c] = diffuse * share.diffuse[c] + lobe * share.shine[c] + refiner->added[c][i];
        for (int k = 0; k < MOVING_SHAPE; k++)
            by[c][k] = refiner->lobes[2 * k + 2][i] * share.diffuse[c] +
                       refiner->lobes[2 * k + 3][i] * share.shine[c];
        by[c][WEIGHT] = left * share.m1 * (lobe * fd - share.most * base * diffuse);
        by[c][MAPS_REFINE_BASE + c] = left * (share.m1 * share.below * diffuse + m * lobe * rest);
        by[c][MAPS_REFINE_F0 + c] += left * share.m1 * w * lobe * rest;
        by[c][MAPS_REFINE_F0 + top] -= left * share.m1 * w * rest * base * diffuse;
        by[c][MAPS_REFINE_METALLIC] =
            left * (lobe * fm - share.below * base * diffuse - w * lobe * fd);
    }
    lab_of(value, lab, slopes);
    for (int k = 0; k < SIZE; k++) {
        float f[3];
        for (int j = 0; j < 3; j++)
            f[j] = slopes[j] * (xyz[j][0] * by[0][k] + xyz[j][1] * by[1][k] + xyz[j][2] * by[2][k]);
        ret[0][k] = refiner->scales[0][i] * 116 * f[1];
        ret[1][k] = refiner->scales[1][i] * 500 * (f[0] - f[1]);
        ret[2][k] = refiner->scales[2][i] * 200 * (f[1] - f[2]);
    }
}

/* Computes half of the gradient and of the approximate second derivatives of the cost. */
static void slopes_of(struct maps_refiner *refiner, const struct maps_refine_prior *prior,
                      const float *x, double normal[SIZE][SIZE], double right[SIZE]) {
    const int top = largest(x);
    float sums[SIZE][LANES] = {{0}}, to[SIZE] = {0};
    for (int k = 0; k < MOVING_SHAPE; k++) {
        float shape[MAPS_SHAPE];
        float *const diffuse = refiner->lobes[2 * k + 2], *const lobe = refiner->lobes[2 * k + 3];
        memcpy(shape, x, sizeof shape);
        shape[k] += STEP;
        lobes(refiner, shape, diffuse, lobe);
        for (int i = 0; i < refiner->n; i++) {
            diffuse[i] = (diffuse[i] - refiner->lobes[0][i]) / STEP;
            lobe[i] = (lobe[i] - refiner->lobes[1][i]) / STEP;
        }
    }
    for (int i = 0; i < refiner->n; i++) {
        float by[3][LANES] = {{0}}, squares = FLOOR * FLOOR;
        derivatives(refiner, x, top, i, by);
        for (int c = 0; c < 3; c++)
            squares += refiner->colours[c][i] * refiner->colours[c][i];
        const float weight = refiner->weights[i] / sqrtf(squares);
        for (int c = 0; c < 3; c++)
            for (int j = 0; j < SIZE; j++) {
                const float scaled = weight * by[c][j];
                to[j] += scaled * refiner->colours[c][i];
                for (int k = 0; k < LANES; k++)
                    sums[j][k] += scaled * by[c][k];
            }
    }
    /* The cost has √(r² + ½²), whose second derivative is about 1 / (2 √…) of that of r². */
    for (int j = 0; j < SIZE; j++) {
        for (int k = 0; k < SIZE; k++)
            normal[j][k] = (double)sums[j][k] / refiner->area / 2;
        right[j] = -(double)to[j] / refiner->area / 2;
        normal[j][j] += (double)prior->weights[j];
        right[j] -= (double)prior->weights[j] * (double)(x[j] - prior->mean.x[j]);
    }
}

/* Bounds of the parameters. */
static void bounds(float least[SIZE], float most[SIZE]) {
    static const float low[MAPS_SHAPE] = {-0.85F, -0.85F, MAPS_MIN_LOG_ALPHA, -2, -2, 0.02F};
    static const float high[MAPS_SHAPE] = {0.85F, 0.85F, 0, 2, 2, 1};
    for (int k = 0; k < SIZE; k++) {
        least[k] = k < MAPS_SHAPE ? low[k] : 0;
        most[k] = k < MAPS_SHAPE ? high[k] : 1;
    }
}

/* Solves A x = b for the parameters in `free`, by Cholesky's method. Other parameters do not move.
 * Returns FALSE if A is not positive definite. */
static gboolean solve(const double normal[SIZE][SIZE], const double right[SIZE], guint free,
                      double damping, double ret[SIZE]) {
    double a[SIZE][SIZE], b[SIZE];
    int index[SIZE], n = 0;
    memset(ret, 0, sizeof(double) * SIZE);
    for (int k = 0; k < SIZE; k++)
        if (free >> k & 1)
            index[n++] = k;
    for (int j = 0; j < n; j++) {
        b[j] = right[index[j]];
        for (int k = 0; k < n; k++)
            a[j][k] = normal[index[j]][index[k]];
        a[j][j] = a[j][j] * (1 + damping) + 1e-9;
    }
    if (!maps_cholesky(n, SIZE, &a[0][0], b))
        return FALSE;
    for (int i = 0; i < n; i++)
        ret[index[i]] = b[i];
    return TRUE;
}

double maps_refiner_run(struct maps_refiner *refiner, const struct maps_refine_prior *prior,
                        guint moving, int steps, struct maps_parameters *x) {
    float least[SIZE], most[SIZE];
    double damping = 1e-2;
    bounds(least, most);
    for (int k = 0; k < SIZE; k++)
        x->x[k] = CLAMP(x->x[k], least[k], most[k]);
    lobes(refiner, x->x, refiner->lobes[0], refiner->lobes[1]);
    double cost =
        differences(refiner, prior, x->x, refiner->lobes[0], refiner->lobes[1], refiner->colours);
    for (int step = 0; step < steps; step++) {
        double normal[SIZE][SIZE], right[SIZE], next = cost;
        guint free = moving;
        slopes_of(refiner, prior, x->x, normal, right);
        for (int k = 0; k < SIZE; k++) /* not beyond a bound */
            if ((x->x[k] <= least[k] && right[k] < 0) || (x->x[k] >= most[k] && right[k] > 0))
                free &= ~(1U << k);
        for (int again = 0; again < TRIES; again++) {
            struct maps_parameters moved = *x;
            double by[SIZE];
            if (!solve((const double(*)[SIZE])normal, right, free, damping, by))
                return cost;
            for (int k = 0; k < SIZE; k++)
                moved.x[k] = CLAMP(x->x[k] + (float)CLAMP(by[k], -0.5, 0.5), least[k], most[k]);
            lobes(refiner, moved.x, refiner->trial[0], refiner->trial[1]);
            next = differences(refiner, prior, moved.x, refiner->trial[0], refiner->trial[1],
                               refiner->moved);
            if (next < cost) {
                *x = moved;
                for (int k = 0; k < 2; k++)
                    memcpy(refiner->lobes[k], refiner->trial[k], sizeof(float) * (gsize)refiner->n);
                for (int k = 0; k < 3; k++)
                    memcpy(refiner->colours[k], refiner->moved[k],
                           sizeof(float) * (gsize)refiner->n);
                damping *= 0.2;
                break;
            }
            damping *= 6;
        }
        const double decrease = cost - next;
        if (!(decrease > 0))
            return cost;
        cost = next;
        if (decrease < ENOUGH * cost)
            return cost;
    }
    return cost;
}

struct maps_parameters maps_parameters_of(const struct maps_texel *texel) {
    const float ab = MAX(texel->roughness * texel->roughness, expf(MAPS_MIN_LOG_ALPHA));
    const float at = ab + (1 - ab) * texel->anisotropy * texel->anisotropy;
    const float spread = logf(at / ab) / 2;
    const float angle = 2 * atan2f(texel->direction[1], texel->direction[0]);
    struct maps_parameters ret = {{texel->normal[0], texel->normal[1], logf(at * ab) / 2,
                                   spread * cosf(angle), spread * sinf(angle), texel->specular}};
    for (int c = 0; c < 3; c++) {
        ret.x[MAPS_REFINE_BASE + c] = texel->base[c];
        ret.x[MAPS_REFINE_F0 + c] = MIN(MAPS_DIELECTRIC * texel->specular_colour[c], 1);
    }
    ret.x[MAPS_REFINE_METALLIC] = texel->metallic;
    return ret;
}

void maps_parameters_store(const struct maps_parameters *from, struct maps_texel *ret) {
    const struct maps_frame frame = maps_frame_of(from->x);
    for (int c = 0; c < 3; c++) {
        ret->base[c] = from->x[MAPS_REFINE_BASE + c];
        ret->specular_colour[c] = from->x[MAPS_REFINE_F0 + c] / MAPS_DIELECTRIC;
    }
    ret->metallic = from->x[MAPS_REFINE_METALLIC];
    ret->specular = from->x[WEIGHT];
    ret->roughness = sqrtf(frame.ab);
    ret->anisotropy = frame.ab < 0.999F ? sqrtf((frame.at - frame.ab) / (1 - frame.ab)) : 0;
    memcpy(ret->direction, frame.direction, sizeof ret->direction);
    memcpy(ret->normal, frame.n, sizeof ret->normal);
}
