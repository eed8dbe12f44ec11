#include "maps_fit_private.h"

#include <math.h>
#include <string.h>

#define FEATURES 3
#define ROUNDS   20
#define RADIUS   2 /* radius of the window of neighbours, in texels */
/* difference of features at which the weight of a neighbour is e^−½ */
#define APART  0.1F
#define WEIGHT (MAPS_SHAPE - 1) /* index of the specular weight w */

/* 1/σ² of the parameters (maps_fit_private.h). A deviation of σ costs a CIEDE2000 of 1. */
static const float weights[MAPS_REFINE_SIZE] = {0, 0, 0.3F, 0.3F, 0.3F, 0.05F, 0,
                                                0, 0, 1,    1,    1,    0.3F};

static float luminance(const float *rgb) {
    return 0.2126F * rgb[0] + 0.7152F * rgb[1] + 0.0722F * rgb[2];
}

/* Gives the features of a texel: the share of the diffuse part, the width of the lobe, and the
 * square root of the lobe's reflectance. */
static void features(const struct maps_parameters *of, float ret[FEATURES]) {
    const float m = of->x[MAPS_REFINE_METALLIC], base = luminance(of->x + MAPS_REFINE_BASE);
    const float f = of->x[WEIGHT] * luminance(of->x + MAPS_REFINE_F0);
    const float diffuse = (1 - m) * (1 - f) * base, shine = (1 - m) * f + m * base;
    ret[0] = diffuse / MAX(diffuse + shine, 1e-6F);
    ret[1] = of->x[2] / 4;
    ret[2] = sqrtf(shine);
}

static float apart(const float a[FEATURES], const float b[FEATURES]) {
    float ret = 0;
    for (int k = 0; k < FEATURES; k++)
        ret += (a[k] - b[k]) * (a[k] - b[k]);
    return ret;
}

/* Gives each texel the label of the nearest centre. Returns the index of the texel that is farthest
 * from its centre. */
static int assign(const float (*of)[FEATURES], int texels, const float (*centres)[FEATURES], int n,
                  guint8 *labels, float *ret_far) {
    int farthest = 0;
    *ret_far = 0;
    for (int t = 0; t < texels; t++) {
        float least = INFINITY;
        for (int k = 0; k < n; k++) {
            const float now = apart(of[t], centres[k]);
            if (now < least) {
                least = now;
                labels[t] = (guint8)k;
            }
        }
        if (least > *ret_far) {
            *ret_far = least;
            farthest = t;
        }
    }
    return farthest;
}

/* Moves each centre to the mean of its texels. */
static void move_centres(const float (*of)[FEATURES], int texels, const guint8 *labels, int n,
                         float (*centres)[FEATURES]) {
    double sums[MAPS_CLUSTERS][FEATURES] = {{0}};
    int counts[MAPS_CLUSTERS] = {0};
    for (int t = 0; t < texels; t++) {
        counts[labels[t]]++;
        for (int k = 0; k < FEATURES; k++)
            sums[labels[t]][k] += (double)of[t][k];
    }
    for (int k = 0; k < n; k++)
        for (int j = 0; j < FEATURES && counts[k] > 0; j++)
            centres[k][j] = (float)(sums[k][j] / counts[k]);
}

static int by_value(gconstpointer a, gconstpointer b) {
    const float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

static float median(const struct maps_clusters *clusters, int cluster, const float *values,
                    int stride, int texels, float *buffer) {
    int n = 0;
    for (int t = 0; t < texels; t++)
        if (clusters->labels[t] == cluster)
            buffer[n++] = values[(gsize)t * (gsize)stride];
    qsort(buffer, (gsize)n, sizeof *buffer, by_value);
    return n > 0 ? buffer[n / 2] : 0;
}

struct maps_clusters *maps_clusters_new(const struct maps_parameters *texels, int width, int height,
                                        enum maps_model model) {
    const int n = width * height;
    struct maps_clusters *ret = g_new0(struct maps_clusters, 1);
    float(*of)[FEATURES] = g_malloc_n((gsize)n, sizeof *of), centres[MAPS_CLUSTERS][FEATURES], far;
    g_autofree float *buffer = g_new(float, n);
    ret->labels = g_new0(guint8, n);
    for (int t = 0; t < n; t++)
        features(&texels[t], of[t]);
    /* Each further centre begins at the texel that is farthest from the centres so far. */
    memcpy(centres[0], of[0], sizeof centres[0]);
    for (ret->n = 1;; ret->n++) {
        int farthest = 0;
        for (int round = 0; round < ROUNDS; round++) {
            farthest = assign((const float(*)[FEATURES])of, n, (const float(*)[FEATURES])centres,
                              ret->n, ret->labels, &far);
            move_centres((const float(*)[FEATURES])of, n, ret->labels, ret->n, centres);
        }
        if (ret->n == MAPS_CLUSTERS || far < 4 * APART * APART)
            break;
        memcpy(centres[ret->n], of[farthest], sizeof centres[0]);
    }
    for (int k = 0; k < ret->n; k++) {
        for (int j = 0; j < MAPS_REFINE_SIZE; j++)
            ret->medians[k].x[j] = median(ret, k, &texels[0].x[j], MAPS_REFINE_SIZE, n, buffer);
        ret->metal[k] =
            model == MAPS_MODEL_FULL && median(ret, k, &of[0][0], FEATURES, n, buffer) < MAPS_METAL;
    }
    g_free(of);
    return ret;
}

void maps_clusters_free(struct maps_clusters *clusters) {
    if (!clusters)
        return;
    g_free(clusters->labels);
    g_free(clusters);
}

static void set_metal(struct maps_parameters *x) {
    for (int c = 0; c < 3; c++) {
        x->x[MAPS_REFINE_BASE + c] = MIN(x->x[WEIGHT] * x->x[MAPS_REFINE_F0 + c], 1);
        x->x[MAPS_REFINE_F0 + c] = MAPS_DIELECTRIC;
    }
    x->x[WEIGHT] = 1;
    x->x[MAPS_REFINE_METALLIC] = 1;
}

void maps_clusters_set_metals(const struct maps_clusters *clusters, int n,
                              struct maps_parameters *texels) {
    for (int t = 0; t < n; t++)
        if (clusters->metal[clusters->labels[t]])
            set_metal(&texels[t]);
}

struct maps_refine_prior maps_clusters_prior(const struct maps_clusters *clusters,
                                             const struct maps_parameters *texels, int width,
                                             int height, int texel) {
    const int cluster = clusters->labels[texel], x = texel % width, y = texel / width;
    struct maps_refine_prior ret = {.mean = clusters->medians[cluster]};
    float own[FEATURES], sum = 1;
    if (clusters->metal[cluster])
        set_metal(&ret.mean);
    features(&texels[texel], own);
    for (int j = MAX(y - RADIUS, 0); j <= MIN(y + RADIUS, height - 1); j++)
        for (int i = MAX(x - RADIUS, 0); i <= MIN(x + RADIUS, width - 1); i++) {
            const int other = j * width + i;
            float its[FEATURES];
            if (other == texel ||
                clusters->metal[clusters->labels[other]] != clusters->metal[cluster])
                continue;
            features(&texels[other], its);
            const float distance = (float)((i - x) * (i - x) + (j - y) * (j - y));
            const float weight = expf(-distance / 2 - apart(own, its) / (2 * APART * APART));
            sum += weight;
            for (int k = 0; k < MAPS_REFINE_SIZE; k++)
                ret.mean.x[k] += weight * texels[other].x[k];
        }
    for (int k = 0; k < MAPS_REFINE_SIZE; k++) {
        ret.mean.x[k] /= sum;
        ret.weights[k] = weights[k];
    }
    return ret;
}
