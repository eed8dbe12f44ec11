#include "compare.h"

#include "base/data_error.h"
#include "base/direction.h"
#include "exr/exr.h"

#include <math.h>
#include <string.h>

#define COLOURS 3
#define BLOCKS  64
#define SAME    0.01F /* degrees */

/* Of one view, one light or everything: squares of the difference and of A, |ΔY|, ΔE, how many. */
struct sums {
    double rest, all, luminance, delta_e, n;
};

/* A texel of which a material gives values that are infinite or no numbers. */
struct damage {
    const Material *of; /* NULL: there is none */
    int texel;
};

struct run {
    const Material *a, *b;
    const struct material_info *info;
    int n_blocks;
    struct sums *sums;     /* n_views, then n_lights, a block */
    double *largest;       /* one a block */
    struct damage *damage; /* one a block: the first */
};

void comparison_free(struct comparison *comparison) {
    if (!comparison)
        return;
    g_free(comparison->views);
    g_free(comparison->lights);
    g_free(comparison);
}

static double lab_curve(double t) {
    return t > 216.0 / 24389 ? cbrt(t) : (24389.0 / 27 * t + 16) / 116;
}

void compare_lab(const float rgb[3], double ret[3]) {
    const double r = MAX(rgb[0], 0), g = MAX(rgb[1], 0), b = MAX(rgb[2], 0);
    const double x = lab_curve((0.4124564 * r + 0.3575761 * g + 0.1804375 * b) / 0.95047);
    const double y = lab_curve(0.2126729 * r + 0.7151522 * g + 0.0721750 * b);
    const double z = lab_curve((0.0193339 * r + 0.1191920 * g + 0.9503041 * b) / 1.08883);
    ret[0] = 116 * y - 16;
    ret[1] = 500 * (x - y);
    ret[2] = 200 * (y - z);
}

static double hue_deg(double a, double b) {
    const double hue = a == 0 && b == 0 ? 0 : atan2(b, a) * 180 / G_PI;
    return hue < 0 ? hue + 360 : hue;
}

static double sin_deg(double angle) {
    return sin(angle * G_PI / 180);
}

static double cos_deg(double angle) {
    return cos(angle * G_PI / 180);
}

/* Difference and mean of two hues, the shorter way round; grey has none. */
static void compare_hues(double h1, double h2, gboolean grey, double *ret_difference,
                         double *ret_mean) {
    double difference = grey ? 0 : h2 - h1, mean = grey ? h1 + h2 : (h1 + h2) / 2;
    if (!grey && fabs(h1 - h2) > 180) {
        difference += difference > 0 ? -360 : 360;
        mean += h1 + h2 < 360 ? 180 : -180;
    }
    *ret_difference = difference;
    *ret_mean = mean;
}

double compare_delta_e(const double lab1[3], const double lab2[3]) {
    const double chroma = (hypot(lab1[1], lab1[2]) + hypot(lab2[1], lab2[2])) / 2;
    const double g = 0.5 * (1 - sqrt(pow(chroma, 7) / (pow(chroma, 7) + pow(25, 7))));
    const double a1 = lab1[1] * (1 + g), a2 = lab2[1] * (1 + g);
    const double c1 = hypot(a1, lab1[2]), c2 = hypot(a2, lab2[2]), c = (c1 + c2) / 2;
    double dh, h;
    compare_hues(hue_deg(a1, lab1[2]), hue_deg(a2, lab2[2]), c1 * c2 == 0, &dh, &h);
    const double dhue = 2 * sqrt(c1 * c2) * sin_deg(dh / 2), l = (lab1[0] + lab2[0]) / 2;
    const double t = 1 - 0.17 * cos_deg(h - 30) + 0.24 * cos_deg(2 * h) +
                     0.32 * cos_deg(3 * h + 6) - 0.20 * cos_deg(4 * h - 63);
    const double turn = 30 * exp(-pow((h - 275) / 25, 2));
    const double rc = 2 * sqrt(pow(c, 7) / (pow(c, 7) + pow(25, 7)));
    const double sl = 1 + 0.015 * (l - 50) * (l - 50) / sqrt(20 + (l - 50) * (l - 50));
    const double sc = 1 + 0.045 * c, sh = 1 + 0.015 * c * t;
    const double dl = (lab2[0] - lab1[0]) / sl, dc = (c2 - c1) / sc, dhs = dhue / sh;
    return sqrt(MAX(dl * dl + dc * dc + dhs * dhs - sin_deg(2 * turn) * rc * dc * dhs, 0));
}

static void compare_add_value(struct sums *to, const float *a, const float *b, double *largest) {
    double lab_a[3], lab_b[3];
    for (int c = 0; c < COLOURS; c++) {
        const double rest = (double)a[c] - b[c];
        to->rest += rest * rest;
        to->all += (double)a[c] * a[c];
        *largest = MAX(*largest, fabs(rest));
    }
    to->luminance += fabsf(rgb_luminance(a) - rgb_luminance(b));
    compare_lab(a, lab_a);
    compare_lab(b, lab_b);
    to->delta_e += compare_delta_e(lab_a, lab_b);
    to->n++;
}

static void compare_add_sums(struct sums *to, const struct sums *from) {
    to->rest += from->rest;
    to->all += from->all;
    to->luminance += from->luminance;
    to->delta_e += from->delta_e;
    to->n += from->n;
}

static gboolean compare_reconstruct(const struct run *run, const Material *of, int texel,
                                    float *ret, struct damage *ret_damage) {
    const gsize n = run->info->layout->views.n * run->info->layout->lights.n * COLOURS;
    material_reconstruct(of, texel, ret);
    if (exr_all_finite(ret, n))
        return TRUE;
    *ret_damage = (struct damage){of, texel};
    return FALSE;
}

static gboolean check_damage(const struct run *run, GError **error) {
    const int width = run->info->layout->width;
    for (int block = 0; block < run->n_blocks; block++) {
        const struct damage *damage = &run->damage[block];
        if (!damage->of)
            continue;
        g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                    "%s: its values at texel (%d, %d) are not finite: its numbers make no sense "
                    "together; make or compress it again",
                    material_info(damage->of)->label, damage->texel % width, damage->texel / width);
        return FALSE;
    }
    return TRUE;
}

static void compare_do_block(int block, gpointer data) {
    const struct run *run = data;
    const int views = run->info->layout->views.n, lights = run->info->layout->lights.n;
    const gint64 texels = (gint64)run->info->layout->width * run->info->layout->height;
    const int end = (int)(texels * (block + 1) / run->n_blocks);
    struct sums *sums = run->sums + (gsize)block * (gsize)(views + lights);
    g_autofree float *a = g_new0(float, views *lights *COLOURS);
    g_autofree float *b = g_new0(float, views *lights *COLOURS);
    for (int texel = (int)(texels * block / run->n_blocks); texel < end; texel++) {
        if (!compare_reconstruct(run, run->a, texel, a, &run->damage[block]) ||
            !compare_reconstruct(run, run->b, texel, b, &run->damage[block]))
            return;
        for (gsize i = 0; i < (gsize)views * (gsize)lights; i++) {
            struct sums value = {0};
            compare_add_value(&value, a + i * COLOURS, b + i * COLOURS, &run->largest[block]);
            compare_add_sums(&sums[i / (gsize)lights], &value);
            compare_add_sums(&sums[(gsize)views + i % (gsize)lights], &value);
        }
    }
}

static struct compare_sums compare_finish(const struct sums *sums) {
    const double ratio = sums->all > 0 ? sums->rest / sums->all : sums->rest > 0 ? INFINITY : 0;
    return (struct compare_sums){sqrt(ratio), sums->luminance / sums->n, sums->delta_e / sums->n};
}

static struct comparison *compare_summarise(const struct run *run) {
    const int views = run->info->layout->views.n, lights = run->info->layout->lights.n,
              n = views + lights;
    struct comparison *ret = g_new0(struct comparison, 1);
    struct sums all = {0};
    ret->n_views = views;
    ret->n_lights = lights;
    ret->views = g_new0(struct compare_sums, views);
    ret->lights = g_new0(struct compare_sums, lights);
    for (int i = 0; i < n; i++) {
        struct sums one = {0};
        for (int block = 0; block < run->n_blocks; block++)
            compare_add_sums(&one, &run->sums[block * n + i]);
        if (i < views)
            compare_add_sums(&all, &one);
        *(i < views ? &ret->views[i] : &ret->lights[i - views]) = compare_finish(&one);
    }
    ret->all = compare_finish(&all);
    for (int block = 0; block < run->n_blocks; block++)
        ret->largest = MAX(ret->largest, run->largest[block]);
    return ret;
}

static gboolean compare_same_directions(const float *theta_a, const float *phi_a,
                                        const float *theta_b, const float *phi_b, int n) {
    for (int i = 0; i < n; i++) {
        float a[3], b[3];
        direction_from_deg(theta_a[i], phi_a[i], a);
        direction_from_deg(theta_b[i], phi_b[i], b);
        const float away = hypotf(hypotf(a[0] - b[0], a[1] - b[1]), a[2] - b[2]);
        if (!(away < SAME * (float)G_PI / 180))
            return FALSE;
    }
    return TRUE;
}

static gboolean compare_check(const struct material_info *a, const struct material_info *b,
                              GError **error) {
    const char *what = NULL;
    if (a->layout->width != b->layout->width || a->layout->height != b->layout->height)
        what = "they have different texels";
    else if (a->layout->views.n != b->layout->views.n ||
             !compare_same_directions(a->layout->views.theta_deg, a->layout->views.phi_deg,
                                      b->layout->views.theta_deg, b->layout->views.phi_deg,
                                      a->layout->views.n))
        what = "they have different views";
    else if (a->layout->lights.n != b->layout->lights.n ||
             !compare_same_directions(a->layout->lights.theta_deg, a->layout->lights.phi_deg,
                                      b->layout->lights.theta_deg, b->layout->lights.phi_deg,
                                      a->layout->lights.n))
        what = "they have different lights";
    if (what)
        g_set_error(
            error, DATA_ERROR, DATA_ERROR_INVALID,
            "%s (%zu × %zu texels, %zu views, %zu lights) and %s (%zu × %zu, %zu, %zu) cannot be "
            "compared: %s",
            a->label, a->layout->width, a->layout->height, a->layout->views.n, a->layout->lights.n,
            b->label, b->layout->width, b->layout->height, b->layout->views.n, b->layout->lights.n,
            what);
    return what == NULL;
}

struct comparison *compare_materials(const Material *a, const Material *b, const struct work *work,
                                     GError **error) {
    struct run run = {a, b, material_info(a)};
    struct comparison *ret = NULL;
    if (!compare_check(run.info, material_info(b), error))
        return NULL;
    run.n_blocks = MIN(BLOCKS, run.info->layout->width * run.info->layout->height);
    run.sums = g_new0(struct sums,
                      run.n_blocks * (run.info->layout->views.n + run.info->layout->lights.n));
    run.largest = g_new0(double, run.n_blocks);
    run.damage = g_new0(struct damage, run.n_blocks);
    if (work_parallel(work, "compare", run.n_blocks, compare_do_block, &run, error) &&
        check_damage(&run, error))
        ret = compare_summarise(&run);
    g_free(run.sums);
    g_free(run.largest);
    g_free(run.damage);
    return ret;
}

gboolean compare_model(const struct codec *codec, gconstpointer model, const struct btf_matrix *btf,
                       const struct work *work, double *ret_error, double *ret_luminance_error,
                       GError **error) {
    g_autoptr(Material) of_btf = material_borrow("the BTF", &material_btf_codec, btf);
    g_autoptr(Material) of_model = material_borrow(codec->title, codec, model);
    struct comparison *comparison = compare_materials(of_btf, of_model, work, error);
    if (!comparison)
        return FALSE;
    *ret_error = comparison->all.error;
    *ret_luminance_error = comparison->all.luminance_error;
    comparison_free(comparison);
    return TRUE;
}
