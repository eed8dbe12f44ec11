/* Examines the pictures of a set while they are imported. Finds which tone curves were used, which
 * lamps gave no light, and whether another tone curve or a black level fits the pictures better.
 *
 * A texel with the normal n and the reflectance ρ has the value z_l = b + E_l max(0, g·l) under the
 * light l of irradiance E_l, with g = ρ n and b = 0 (Lambert). g is fitted to each texel for four
 * candidates:
 *   - the values as they are
 *   - the values encoded again, in case they were decoded from sRGB by mistake
 *   - the values decoded, in case decoding was omitted by mistake
 *   - the values with a constant level b.
 * Cast shadows and highlights are outliers. A residual r has the weight 1 / (1 + (r/s)²), where s
 * is 1.5 times the median of |r|. The misfit is the RMS of the smallest three quarters of the
 * residuals, relative to the RMS of the values. Residuals are always converted back to the scale of
 * the original values. A curve that only compresses contrast therefore gains nothing. A candidate's
 * misfit is the median over all texels. */
#include "import_private.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/direction.h"
#include "base/plural.h"
#include "base/robust.h"
#include "base/srgb.h"

#define SAMPLES    400 /* number of texels to which g is fitted */
#define MIN_LIGHTS 6
#define WHITE      0.98 /* values from WHITE on are saturated */
/* a light is dark if the mean of its picture is below this share of the upper quartile of all
 * means */
#define DARK    0.02
#define MIN_COS 0.1 /* minimum cos θ by which the mean of a picture is divided */
/* A texel is used if its largest value is above this share of the largest value of all texels. */
#define MIN_VALUE 0.02
/* number of fits of a texel; each fit uses the weights that follow from the fit before */
#define STEPS      10
#define MIN_MISFIT 0.05 /* minimum misfit for which another tone curve is reported */
/* minimum misfit for which a level is reported. It is smaller than MIN_MISFIT because the weights
 * already reject most values that a level raises, as if they were shadows. */
#define MIN_LIFTED 0.015
#define BETTER     3.0  /* factor by which another candidate must reduce the misfit */
#define MIN_LEVEL  0.02 /* minimum level that is reported, relative to the largest value */
/* minimum standard deviation of cos θ over the lights; below it, a level cannot be determined */
#define MIN_SPREAD 0.08

enum { AS_IS, DECODED_WRONGLY, TO_BE_DECODED, WITH_LEVEL, CANDIDATES };

struct import_look {
    enum picture_tones transfer;
    /* number of pictures for each tone curve that was used; the key is its description */
    GHashTable *tones;
    int n_views, n_lights;
    float *theta_deg, *phi_deg; /* directions of the lights */
    double *light;              /* unit vector (x, y, z) of each light */
    double *means; /* mean of each picture, view × light; NaN if there is no picture */
    int view;      /* the view to which g is fitted */
    float *values; /* texel × light of that view; NaN means unknown */
    float *gains;  /* irradiance E_l of each light in that view */
};

struct import_look *import_look_new(enum picture_tones transfer, int n_views, int n_lights,
                                    const float *theta_deg, const float *phi_deg, int view) {
    struct import_look *look = g_new0(struct import_look, 1);
    look->transfer = transfer;
    look->tones = g_hash_table_new_full(g_str_hash, g_str_equal, g_free, NULL);
    look->n_views = n_views;
    look->n_lights = n_lights;
    look->view = view;
    look->theta_deg = g_memdup2(theta_deg, sizeof(float) * (gsize)n_lights);
    look->phi_deg = g_memdup2(phi_deg, sizeof(float) * (gsize)n_lights);
    look->light = g_new(double, 3 * n_lights);
    look->means = g_new(double, n_views *n_lights);
    look->values = g_new(float, SAMPLES *n_lights);
    look->gains = g_new(float, n_lights);
    for (int i = 0; i < n_views * n_lights; i++)
        look->means[i] = NAN;
    for (int i = 0; i < SAMPLES * n_lights; i++)
        look->values[i] = NAN;
    for (int l = 0; l < n_lights; l++) {
        const double theta = (double)theta_deg[l] * G_PI / 180,
                     phi = (double)phi_deg[l] * G_PI / 180;
        look->gains[l] = 1;
        look->light[3 * l] = sin(theta) * cos(phi);
        look->light[3 * l + 1] = sin(theta) * sin(phi);
        look->light[3 * l + 2] = cos(theta);
    }
    return look;
}

void import_look_free(struct import_look *look) {
    if (!look)
        return;
    g_hash_table_unref(look->tones);
    g_free(look->theta_deg);
    g_free(look->phi_deg);
    g_free(look->light);
    g_free(look->means);
    g_free(look->values);
    g_free(look->gains);
    g_free(look);
}

void import_look_count(struct import_look *look, const struct import_picture *picture) {
    char *told = picture_tone_describe(&picture->tone, picture->bits, look->transfer);
    const int n = GPOINTER_TO_INT(g_hash_table_lookup(look->tones, told));
    g_hash_table_insert(look->tones, told, GINT_TO_POINTER(n + 1));
}

void import_look_add(struct import_look *look, int view, int light, const float *const rgb[3],
                     gsize step, gsize n, double gain) {
    double sum = 0;
    gsize known = 0;
    look->gains[light] = view == look->view ? (float)gain : look->gains[light];
    for (gsize k = 0; k < SAMPLES && n > 0; k++) {
        const gsize i = (gsize)((double)k * (double)n / SAMPLES);
        if ((k > 0 && i == (gsize)((double)(k - 1) * (double)n / SAMPLES)))
            continue;
        const float v[3] = {rgb[0][i * step], rgb[1][i * step], rgb[2][i * step]};
        if (!isfinite(v[0]) || !isfinite(v[1]) || !isfinite(v[2]))
            continue;
        const float y = rgb_luminance(v);
        sum += (double)y;
        known++;
        if (view == look->view && (double)MAX(MAX(v[0], v[1]), v[2]) < WHITE)
            look->values[k * (gsize)look->n_lights + (gsize)light] = y;
    }
    if (known > 0)
        look->means[view * look->n_lights + light] = sum / (double)known / gain;
}

static double forth(int candidate, double v) {
    return candidate == DECODED_WRONGLY ? srgb_encode(v)
           : candidate == TO_BE_DECODED ? srgb_decode(v)
                                        : v;
}

static double back(int candidate, double v) {
    return candidate == DECODED_WRONGLY ? srgb_decode(v)
           : candidate == TO_BE_DECODED ? srgb_encode(MAX(v, 0))
                                        : v;
}

/* Solves a symmetric system of n ≤ 4 equations by Gaussian elimination. Column n of a is the
 * right-hand side. A small number is added to the diagonal. */
static void solve(double a[4][5], int n, double *ret) {
    for (int i = 0; i < n; i++)
        a[i][i] += 1e-9 * (a[0][0] + a[1][1] + a[2][2]);
    for (int i = 0; i < n; i++)
        for (int k = i + 1; k < n; k++) {
            const double factor = a[i][i] != 0 ? a[k][i] / a[i][i] : 0;
            for (int j = i; j <= n; j++)
                a[k][j] -= factor * a[i][j];
        }
    for (int i = n - 1; i >= 0; i--) {
        double sum = a[i][n];
        for (int j = i + 1; j < n; j++)
            sum -= a[i][j] * ret[j];
        ret[i] = a[i][i] != 0 ? sum / a[i][i] : 0;
    }
}

struct texel {
    int n;
    const double *light[256]; /* the direction of the light of each value */
    double value[256], gain[256];
};

/* Fits g to a texel and returns the misfit. For the candidate WITH_LEVEL, fits b too and sets
 * *ret_level to b. For other candidates, *ret_level is 0. */
static double fit_texel(const struct texel *t, int candidate, double *ret_level) {
    const int n = candidate == WITH_LEVEL ? 4 : 3;
    double p[4] = {0}, weight[256], residual[256], square = 0;
    for (int i = 0; i < t->n; i++)
        weight[i] = 1;
    for (int step = 0; step < STEPS; step++) {
        double a[4][5] = {{0}};
        for (int i = 0; i < t->n; i++) {
            const double *l = t->light[i];
            const gboolean lit = step == 0 || p[0] * l[0] + p[1] * l[1] + p[2] * l[2] > 0;
            const double e = lit ? t->gain[i] : 0;
            const double row[5] = {e * l[0], e * l[1], e * l[2], 1, forth(candidate, t->value[i])};
            for (int r = 0; r < n; r++) {
                for (int c = 0; c < n; c++)
                    a[r][c] += weight[i] * row[r] * row[c];
                a[r][n] += weight[i] * row[r] * row[4];
            }
        }
        solve(a, n, p);
        for (int i = 0; i < t->n; i++) {
            const double *l = t->light[i];
            const double z =
                MAX(p[0] * l[0] + p[1] * l[1] + p[2] * l[2], 0) * t->gain[i] + (n == 4 ? p[3] : 0);
            residual[i] = fabs(back(candidate, z) - t->value[i]);
            weight[i] = residual[i];
        }
        const double scale = MAX(1.5 * robust_median(residual, t->n), 1e-9);
        for (int i = 0; i < t->n; i++)
            weight[i] = 1 / (1 + weight[i] * weight[i] / (scale * scale));
    }
    /* The misfit leaves out the quarter of the values that fit worst. */
    qsort(residual, (gsize)t->n, sizeof *residual, robust_by_value);
    double all = 0;
    const int most = (3 * t->n + 3) / 4;
    for (int i = 0; i < most; i++)
        all += residual[i] * residual[i];
    for (int i = 0; i < t->n; i++)
        square += t->value[i] * t->value[i];
    *ret_level = n == 4 ? p[3] : 0;
    return square > 0 ? sqrt(all / most / (square / t->n)) : 0;
}

/* Collects the known values of a texel. Returns FALSE if there are fewer than MIN_LIGHTS, or if
 * none is above least. */
static gboolean take_texel(const struct import_look *look, int k, double least, struct texel *ret) {
    double most = 0;
    ret->n = 0;
    for (int l = 0; l < look->n_lights && ret->n < 256; l++) {
        const double value = (double)look->values[k * look->n_lights + l];
        if (!isfinite(value))
            continue;
        ret->light[ret->n] = look->light + 3 * l;
        ret->gain[ret->n] = (double)look->gains[l];
        ret->value[ret->n++] = value;
        most = MAX(most, value);
    }
    return ret->n >= MIN_LIGHTS && most > least;
}

static double spread_of_heights(const struct import_look *look) {
    double sum = 0, squares = 0;
    for (int l = 0; l < look->n_lights; l++) {
        sum += look->light[3 * l + 2];
        squares += look->light[3 * l + 2] * look->light[3 * l + 2];
    }
    const double mean = sum / look->n_lights;
    return sqrt(MAX(squares / look->n_lights - mean * mean, 0));
}

/* Adds a sentence if another tone curve or a level fits much better. */
static void look_at_tones(const struct import_look *look, GPtrArray *ret) {
    g_autofree double *misfit = g_new(double, CANDIDATES *SAMPLES),
                      *levels = g_new(double, SAMPLES);
    double medians[CANDIDATES], most = 0, level;
    int n = 0, positive = 0;
    for (int i = 0; i < SAMPLES * look->n_lights; i++)
        most = isfinite(look->values[i]) ? MAX(most, (double)look->values[i]) : most;
    for (int k = 0; k < SAMPLES; k++) {
        struct texel texel;
        if (!take_texel(look, k, MIN_VALUE * most, &texel))
            continue;
        for (int c = 0; c < CANDIDATES; c++)
            misfit[c * SAMPLES + n] = fit_texel(&texel, c, &level);
        positive += level > 0;
        levels[n++] = level;
    }
    if (n < MIN_LIGHTS)
        return;
    for (int c = 0; c < CANDIDATES; c++)
        medians[c] = robust_median(misfit + c * SAMPLES, n);
    level = robust_median(levels, n);
    if (level < MIN_LEVEL * most || positive < 9 * n / 10 || spread_of_heights(look) < MIN_SPREAD)
        medians[WITH_LEVEL] = medians[AS_IS];
    int best = AS_IS;
    for (int c = 1; c < CANDIDATES; c++)
        best = medians[c] < medians[best] ? c : best;
    if (medians[AS_IS] < (best == WITH_LEVEL ? MIN_LIFTED : MIN_MISFIT) ||
        medians[best] * BETTER > medians[AS_IS])
        return;
    if (best == WITH_LEVEL)
        g_ptr_array_add(
            ret,
            g_strdup_printf(
                "all values seem to contain a constant level of %.3g of white: without this level, "
                "they differ from a matt surface under the same lights by %.2g %% instead of %.2g "
                "%%; subtract the camera's black level from the pictures, or keep out other light",
                level, 100 * medians[best], 100 * medians[AS_IS]));
    else
        g_ptr_array_add(
            ret, g_strdup_printf("read as %s, the pictures differ from a matt surface under the "
                                 "same lights by only %.2g %%; read as %s, by %.2g %%. Import them "
                                 "with --transfer %s if that is their tone curve",
                                 best == DECODED_WRONGLY ? "linear" : "sRGB", 100 * medians[best],
                                 best == DECODED_WRONGLY ? "sRGB" : "linear", 100 * medians[AS_IS],
                                 best == DECODED_WRONGLY ? "linear" : "srgb"));
}

/* Adds a sentence about the lights under which the sample is dark. The means of the pictures,
 * divided by cos θ, are compared with their upper quartile over all lights. The upper quartile is
 * right even if half of the lamps gave no light. */
static void look_at_lamps(const struct import_look *look, GPtrArray *ret) {
    g_autofree double *shown = g_new(double, look->n_lights);
    g_autofree guint8 *dark = g_new0(guint8, look->n_lights);
    int n_dark = 0, first = -1;
    double share = 0;
    for (int v = 0; v < look->n_views; v++) {
        int n = 0;
        for (int l = 0; l < look->n_lights; l++) {
            const double mean = look->means[v * look->n_lights + l];
            if (isfinite(mean))
                shown[n++] = mean / MAX(look->light[3 * l + 2], MIN_COS);
        }
        if (n < 3)
            continue;
        qsort(shown, (gsize)n, sizeof *shown, robust_by_value);
        const double usual = shown[3 * n / 4];
        for (int l = 0; l < look->n_lights; l++) {
            const double mean = look->means[v * look->n_lights + l];
            if (!(mean / MAX(look->light[3 * l + 2], MIN_COS) < DARK * usual) || dark[l])
                continue;
            dark[l] = 1;
            n_dark++;
            if (first < 0) {
                first = l;
                share = mean / MAX(look->light[3 * l + 2], MIN_COS) / usual;
            }
        }
    }
    if (n_dark > 0)
        g_ptr_array_add(
            ret, g_strdup_printf(
                     "%d of %d lights are dark. Under the first one, at θ %.4g° φ %.4g°, the "
                     "sample shows %.2g %% of what it shows under the others. Check whether the "
                     "lamp was on, and take these pictures again or leave them out",
                     n_dark, look->n_lights, (double)look->theta_deg[first],
                     (double)look->phi_deg[first], 100 * share));
}

static int by_text(gconstpointer a, gconstpointer b) {
    return strcmp(*(char *const *)a, *(char *const *)b);
}

gboolean import_look_tell(const struct import_look *look, Session *session, GPtrArray *notes,
                          GError **error) {
    g_autoptr(GPtrArray) tones = g_ptr_array_new(), wrong = g_ptr_array_new_with_free_func(g_free);
    GHashTableIter iter;
    gpointer told, n;
    g_hash_table_iter_init(&iter, look->tones);
    while (g_hash_table_iter_next(&iter, &told, &n))
        g_ptr_array_add(tones, told);
    g_ptr_array_sort(tones, by_text);
    for (guint i = 0; notes && i < tones->len; i++) {
        const int n_pictures = GPOINTER_TO_INT(g_hash_table_lookup(look->tones, tones->pdata[i]));
        g_ptr_array_add(notes, g_strdup_printf("tones of %d %s: %s", PLURAL(n_pictures, "picture"),
                                               (char *)tones->pdata[i]));
    }
    look_at_lamps(look, wrong);
    if (look->n_lights >= MIN_LIGHTS)
        look_at_tones(look, wrong);
    for (guint i = 0; i < wrong->len; i++) {
        if (notes)
            g_ptr_array_add(notes, g_strdup_printf("warning: %s", (char *)wrong->pdata[i]));
        if (!session_suspect(session, wrong->pdata[i], error))
            return FALSE;
    }
    return TRUE;
}
