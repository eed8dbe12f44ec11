#include "rti.h"

#include <math.h>
#include <string.h>

#include "base/data_error.h"

#define TERMS RTI_PTM_TERMS
/* minimum of a pivot, relative to the largest diagonal element; below it, the lights do not
 * determine all terms */
#define MIN_PIVOT 1e-6

struct normal {
    double a[TERMS][TERMS], b[TERMS];
};

/* Solves the normal equations by Cholesky's method. Returns FALSE if a is not positive definite. */
static gboolean solve(const struct normal *normal, double ret[TERMS]) {
    double l[TERMS][TERMS] = {{0}}, largest = 0;
    for (int i = 0; i < TERMS; i++)
        largest = MAX(largest, normal->a[i][i]);
    for (int i = 0; i < TERMS; i++)
        for (int j = 0; j <= i; j++) {
            double sum = normal->a[i][j];
            for (int k = 0; k < j; k++)
                sum -= l[i][k] * l[j][k];
            if (i != j)
                l[i][j] = sum / l[j][j];
            else if (sum > MIN_PIVOT * largest)
                l[i][i] = sqrt(sum);
            else
                return FALSE;
        }
    for (int i = 0; i < TERMS; i++) {
        ret[i] = normal->b[i];
        for (int k = 0; k < i; k++)
            ret[i] -= l[i][k] * ret[k];
        ret[i] /= l[i][i];
    }
    for (int i = TERMS - 1; i >= 0; i--) {
        for (int k = i + 1; k < TERMS; k++)
            ret[i] -= l[k][i] * ret[k];
        ret[i] /= l[i][i];
    }
    return TRUE;
}

struct fitting {
    const float *pictures;
    gsize texels, n;      /* n is the number of lights */
    float *basis;         /* values of the basis at each light: n × TERMS */
    struct normal *whole; /* normal equations of a texel without NaN; only the matrix is set */
};

/* Fits the terms to one value per light by least squares. Values that are NaN are left out. Returns
 * FALSE if the remaining lights do not determine the terms. */
static gboolean rti_fit_terms(const struct fitting *fitting, const double *values,
                              double ret[TERMS]) {
    struct normal normal = {.b = {0}};
    gboolean all = TRUE;
    for (gsize l = 0; l < fitting->n; l++)
        all = all && !isnan(values[l]);
    if (all)
        normal = *fitting->whole;
    for (gsize l = 0; l < fitting->n; l++) {
        const float *b = fitting->basis + l * TERMS;
        if (isnan(values[l]))
            continue;
        for (int i = 0; i < TERMS; i++) {
            normal.b[i] += (double)b[i] * values[l];
            for (int j = 0; j < TERMS && !all; j++)
                normal.a[i][j] += (double)b[i] * (double)b[j];
        }
    }
    return solve(&normal, ret);
}

/* Gives the mean colour of a texel as bytes, scaled so that its brightest channel is 1. A black
 * texel gets white. */
static void rti_colour(const struct fitting *fitting, gsize texel, guint8 ret[3]) {
    double sums[3] = {0}, most = 0;
    for (gsize l = 0; l < fitting->n; l++)
        for (gsize c = 0; c < 3; c++) {
            const float value = fitting->pictures[3 * (l * fitting->texels + texel) + c];
            sums[c] += isnan(value) ? 0 : MAX((double)value, 0);
        }
    for (int c = 0; c < 3; c++)
        most = MAX(most, sums[c]);
    for (int c = 0; c < 3; c++)
        ret[c] = most > 0 ? (guint8)lround(255 * sums[c] / most) : 255;
}

/* Gives the values to be fitted, one per light. If colour is NULL, a value is that of channel c.
 * Otherwise, a value is the brightness s for which s C is nearest to the pixel's R, G, B, where C
 * is the colour: s = Σ C_k RGB_k / Σ C_k². */
static void observed(const struct fitting *fitting, gsize texel, gsize c, const guint8 *colour,
                     double *ret) {
    for (gsize l = 0; l < fitting->n; l++) {
        const float *rgb = fitting->pictures + 3 * (l * fitting->texels + texel);
        double product = 0, square = 0;
        for (int k = 0; colour && k < 3; k++) {
            product += colour[k] / 255.0 * (double)rgb[k];
            square += colour[k] / 255.0 * colour[k] / 255.0;
        }
        ret[l] = colour ? product / square : (double)rgb[c];
    }
}

/* Converts the terms to bytes. Chooses scale and bias of each term so that the bytes cover the
 * range from the term's minimum to its maximum. The range always includes 0, because the bias must
 * be a byte. */
static void quantise(struct rti *rti, const float *terms, gsize n) {
    for (int j = 0; j < TERMS; j++) {
        double least = 0, most = 0;
        for (gsize i = 0; i < n; i++) {
            least = MIN(least, (double)terms[i * TERMS + (gsize)j]);
            most = MAX(most, (double)terms[i * TERMS + (gsize)j]);
        }
        /* The range takes 254 of the 255 steps of a byte. The last step is spare, because the
         * rounded bias may shift the range by up to half a step. */
        rti->scale[j] = most > least ? (most - least) / 254 : 1 / 255.0;
        rti->bias[j] = (double)lround(-least / rti->scale[j]);
        for (gsize i = 0; i < n; i++)
            rti->bytes[i * TERMS + (gsize)j] = (guint8)CLAMP(
                lround((double)terms[i * TERMS + (gsize)j] / rti->scale[j] + rti->bias[j]), 0, 255);
    }
}

static void compare(const struct fitting *fitting, const struct rti *rti,
                    struct rti_fit_result *ret) {
    double squares = 0, n = 0;
    for (gsize l = 0; l < fitting->n; l++)
        for (gsize t = 0; t < fitting->texels; t++) {
            float rgb[3];
            rti_evaluate(rti, t, fitting->basis + l * TERMS, rgb);
            for (gsize c = 0; c < 3; c++) {
                const float wanted = fitting->pictures[3 * (l * fitting->texels + t) + c];
                if (isnan(wanted)) {
                    ret->holes++;
                    continue;
                }
                ret->clipped += wanted > 1;
                squares += ((double)rgb[c] - (double)wanted) * ((double)rgb[c] - (double)wanted);
                n++;
            }
        }
    ret->error = n > 0 ? sqrt(squares / n) : 0;
}

struct rti *rti_fit(const char *name, const float *pictures, int width, int height,
                    const float *lights, int n, gboolean lrgb, struct rti_fit_result *ret,
                    GError **error) {
    struct normal whole = {.b = {0}};
    struct fitting fitting = {.pictures = pictures,
                              .texels = (gsize)width * (gsize)height,
                              .n = (gsize)n,
                              .whole = &whole};
    double solution[TERMS];
    g_autofree float *basis = fitting.basis = g_new(float, fitting.n *TERMS);
    *ret = (struct rti_fit_result){0};
    for (gsize l = 0; l < fitting.n; l++) {
        rti_ptm_basis(lights + 3 * l, basis + l * TERMS);
        for (int i = 0; i < TERMS * TERMS; i++)
            whole.a[i / TERMS][i % TERMS] += (double)basis[l * TERMS + (gsize)(i / TERMS)] *
                                             (double)basis[l * TERMS + (gsize)(i % TERMS)];
    }
    if (!solve(&whole, solution)) {
        data_error_set(name, 0, error,
                       "the %d lights do not determine the six terms of a PTM; at least six lights "
                       "are needed that do not lie on one ring",
                       n);
        return NULL;
    }
    const gsize sums = fitting.texels * (lrgb ? 1 : 3);
    g_autofree float *terms = g_new0(float, sums *TERMS);
    g_autofree double *values = g_new(double, fitting.n);
    struct rti *rti = g_new0(struct rti, 1);
    rti->width = width;
    rti->height = height;
    rti->lrgb = lrgb;
    rti->n_terms = TERMS;
    rti->bytes = g_new(guint8, sums * TERMS);
    rti->colours = lrgb ? g_new(guint8, 3 * fitting.texels) : NULL;
    for (gsize i = 0; i < sums; i++) {
        const gsize texel = lrgb ? i : i / 3;
        guint8 *colour = lrgb ? rti->colours + 3 * texel : NULL;
        if (lrgb)
            rti_colour(&fitting, texel, colour);
        observed(&fitting, texel, i % 3, colour, values);
        if (rti_fit_terms(&fitting, values, solution))
            for (gsize j = 0; j < TERMS; j++)
                terms[i * TERMS + j] = (float)solution[j];
    }
    quantise(rti, terms, sums);
    compare(&fitting, rti, ret);
    return rti;
}
