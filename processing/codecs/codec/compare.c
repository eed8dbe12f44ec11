#include "compare_private.h"

#include "base/data_error.h"
#include "base/direction.h"
#include "exr/exr.h"
#include "metrics/delta_e.h"
#include "metrics/flip.h"
#include "metrics/psnr.h"
#include "metrics/ssim.h"
#include "place.h"

#include <math.h>
#include <string.h>

#define COLOURS 3
#define BLOCKS  64
/* two directions count as the same if the angle between them is below SAME, in degrees */
#define SAME       0.01F
#define MAX_FLOATS (32 << 20) /* maximum number of values of the pictures of a material */
#define TIMED_US   50000      /* duration of the measurement of compare_evaluation_ns() */
/* number of evaluations in a round of compare_evaluation_ns(), each of one texel for one view and
 * one light */
#define TIMED 256

/* Sums over the values of one view, of one light or of all views and lights. a and b are the values
 * of the two forms of the material. */
struct compare_totals {
    double residual, all; /* residual: Σ (a − b)², all: Σ a², over R, G, B */
    double shown;         /* Σ of the squared differences of R, G, B as shown (metrics/psnr.h) */
    /* luminance  Σ |Y_a − Y_b|
     * delta_e    Σ CIEDE2000
     * n          number of terms of both sums */
    double luminance, delta_e, n;
};

struct compare_block {
    struct compare_totals *totals; /* one for each view, then one for each light */
    double largest;                /* maximum of |a − b| */
    /* NULL, or the source that has an infinite value or a NaN at `texel`. The block stops there */
    const struct compare_source *damaged;
    int texel;
};

/* A view and a light as a picture of the sample, in both forms of the material. */
struct compare_picture {
    int pair;      /* view · n_lights + light */
    float *rgb[2]; /* n_texels × 3, in each form */
    double ssim, flip;
};

struct compare_run {
    const struct compare_source *sources[2];
    const struct compare_size *size;
    int n_texels, n_blocks, n_pictures;
    struct compare_block *blocks;
    struct compare_picture *pictures;
};

void comparison_free(struct comparison *comparison) {
    if (!comparison)
        return;
    g_free(comparison->views);
    g_free(comparison->lights);
    g_free(comparison);
}

static void add(struct compare_totals *to, const struct compare_totals *from) {
    to->residual += from->residual;
    to->all += from->all;
    to->shown += from->shown;
    to->luminance += from->luminance;
    to->delta_e += from->delta_e;
    to->n += from->n;
}

static struct compare_totals difference(const float *a, const float *b, double *largest) {
    struct compare_totals ret = {.n = 1};
    double lab_a[3], lab_b[3];
    for (int c = 0; c < COLOURS; c++) {
        const double residual = (double)a[c] - b[c];
        ret.residual += residual * residual;
        ret.all += (double)a[c] * a[c];
        *largest = MAX(*largest, fabs(residual));
    }
    ret.shown = COLOURS * psnr_mean_square(a, b, 1, 1);
    ret.luminance = fabsf(rgb_luminance(a) - rgb_luminance(b));
    delta_e_lab(a, lab_a);
    delta_e_lab(b, lab_b);
    ret.delta_e = delta_e_2000(lab_a, lab_b);
    return ret;
}

static void do_block(int number, gpointer data) {
    const struct compare_run *run = data;
    struct compare_block *block = &run->blocks[number];
    const gsize views = (gsize)run->size->n_views, lights = (gsize)run->size->n_lights;
    const gsize n = views * lights * COLOURS;
    const gint64 texels = run->n_texels;
    const int end = (int)(texels * (number + 1) / run->n_blocks);
    g_autofree float *both = g_new0(float, 2 * n);
    block->totals = g_new0(struct compare_totals, views + lights);
    for (int texel = (int)(texels * number / run->n_blocks); texel < end; texel++) {
        for (gsize k = 0; k < 2; k++) {
            run->sources[k]->values(run->sources[k]->data, texel, both + k * n);
            if (exr_all_finite(both + k * n, n))
                continue;
            block->damaged = run->sources[k];
            block->texel = texel;
            return;
        }
        for (gsize i = 0; i < views * lights; i++) {
            const float *a = both + i * COLOURS, *b = a + n;
            const struct compare_totals value = difference(a, b, &block->largest);
            add(&block->totals[i / lights], &value);
            add(&block->totals[views + i % lights], &value);
        }
        for (int i = 0; i < run->n_pictures; i++)
            for (gsize k = 0; k < 2; k++)
                memcpy(run->pictures[i].rgb[k] + COLOURS * (gsize)texel,
                       both + k * n + COLOURS * (gsize)run->pictures[i].pair,
                       sizeof(float) * COLOURS);
    }
}

static void do_picture(int number, gpointer data) {
    const struct compare_run *run = data;
    struct compare_picture *picture = &run->pictures[number];
    const int width = run->size->width, height = run->size->height;
    picture->ssim = ssim(picture->rgb[0], picture->rgb[1], width, height);
    picture->flip =
        flip_ldr(picture->rgb[0], picture->rgb[1], width, height, FLIP_PIXELS_PER_DEGREE, NULL);
}

static int by_pair(gconstpointer a, gconstpointer b) {
    return ((const struct compare_picture *)a)->pair - ((const struct compare_picture *)b)->pair;
}

/* Draws distinct pairs of a view and a light at random, sorts them by `pair` and allocates their
 * pictures. */
static void choose_pictures(struct compare_run *run) {
    const int pairs = run->size->n_views * run->size->n_lights;
    const gsize floats = COLOURS * (gsize)run->n_texels;
    const int most = MIN(run->size->max_pictures, (int)MAX(MAX_FLOATS / floats, 1));
    g_autofree int *order = g_new(int, pairs);
    GRand *random = g_rand_new_with_seed(1);
    for (int i = 0; i < pairs; i++)
        order[i] = i;
    run->n_pictures = MIN(pairs, most);
    run->pictures = g_new0(struct compare_picture, run->n_pictures);
    for (int i = 0; i < run->n_pictures; i++) {
        const int other = g_rand_int_range(random, i, pairs), pair = order[other];
        order[other] = order[i];
        run->pictures[i] = (struct compare_picture){
            .pair = pair, .rgb = {g_new0(float, floats), g_new0(float, floats)}};
    }
    g_rand_free(random);
    if (run->n_pictures > 0)
        qsort(run->pictures, (gsize)run->n_pictures, sizeof *run->pictures, by_pair);
}

static struct compare_sums finish(const struct compare_totals *totals) {
    const double ratio = totals->all > 0        ? totals->residual / totals->all
                         : totals->residual > 0 ? INFINITY
                                                : 0;
    return (struct compare_sums){sqrt(ratio), totals->luminance / totals->n,
                                 totals->delta_e / totals->n,
                                 psnr_decibels(totals->shown / (COLOURS * totals->n))};
}

/* Returns FALSE with an error if a block found damaged values. */
static gboolean check(const struct compare_run *run, GError **error) {
    for (int k = 0; k < run->n_blocks; k++) {
        const struct compare_block *block = &run->blocks[k];
        if (!block->damaged)
            continue;
        g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                    "%s: the texel in column %d and row %d, counted from 0, has a value that is "
                    "infinite or not a number; make or compress this material again",
                    block->damaged->label, block->texel % run->size->width,
                    block->texel / run->size->width);
        return FALSE;
    }
    return TRUE;
}

static struct comparison *summarise(const struct compare_run *run) {
    const int views = run->size->n_views, lights = run->size->n_lights;
    struct compare_totals all = {0};
    struct comparison *ret = g_new0(struct comparison, 1);
    ret->n_views = views;
    ret->n_lights = lights;
    ret->views = g_new0(struct compare_sums, views);
    ret->lights = g_new0(struct compare_sums, lights);
    for (int i = 0; i < views + lights; i++) {
        struct compare_totals one = {0};
        for (int k = 0; k < run->n_blocks; k++)
            add(&one, &run->blocks[k].totals[i]);
        if (i < views)
            add(&all, &one);
        *(i < views ? &ret->views[i] : &ret->lights[i - views]) = finish(&one);
    }
    ret->all = finish(&all);
    for (int k = 0; k < run->n_blocks; k++)
        ret->largest = MAX(ret->largest, run->blocks[k].largest);
    ret->n_pictures = run->n_pictures;
    for (int i = 0; i < run->n_pictures; i++) {
        ret->ssim += run->pictures[i].ssim / run->n_pictures;
        ret->flip += run->pictures[i].flip / run->n_pictures;
    }
    return ret;
}

struct comparison *compare_sources(const struct compare_source *a, const struct compare_source *b,
                                   const struct compare_size *size, const struct work *work,
                                   GError **error) {
    const int n_texels = size->width * size->height, n_blocks = MIN(BLOCKS, n_texels);
    g_autofree struct compare_block *blocks = g_new0(struct compare_block, n_blocks);
    struct compare_run run = {.sources = {a, b},
                              .size = size,
                              .n_texels = n_texels,
                              .n_blocks = n_blocks,
                              .blocks = blocks};
    struct comparison *ret = NULL;
    choose_pictures(&run);
    if (work_parallel(work, "compare", n_blocks, do_block, &run, error) && check(&run, error) &&
        work_parallel(work, "pictures", run.n_pictures, do_picture, &run, error))
        ret = summarise(&run);
    for (int k = 0; k < n_blocks; k++)
        g_free(blocks[k].totals);
    for (int i = 0; i < run.n_pictures; i++)
        for (int k = 0; k < 2; k++)
            g_free(run.pictures[i].rgb[k]);
    g_free(run.pictures);
    return ret;
}

static gboolean same_directions(const struct direction_list *of_a,
                                const struct direction_list *of_b) {
    gboolean same = of_a->n == of_b->n;
    for (gsize i = 0; same && i < of_a->n; i++) {
        float a[3], b[3];
        direction_from_deg(of_a->theta_deg[i], of_a->phi_deg[i], a);
        direction_from_deg(of_b->theta_deg[i], of_b->phi_deg[i], b);
        const float away = hypotf(hypotf(a[0] - b[0], a[1] - b[1]), a[2] - b[2]);
        same = away < SAME * (float)G_PI / 180;
    }
    return same;
}

static void reconstruct(gconstpointer material, int texel, float *ret) {
    material_reconstruct(material, texel, ret);
}

static struct comparison *compare_pair(const Material *a, const Material *b, int max_pictures,
                                       const struct work *work, GError **error) {
    const struct btf_layout *of_a = material_info(a)->layout, *of_b = material_info(b)->layout;
    const char *what = of_a->width != of_b->width || of_a->height != of_b->height
                           ? "numbers of texels"
                       : !same_directions(&of_a->views, &of_b->views)   ? "views"
                       : !same_directions(&of_a->lights, &of_b->lights) ? "lights"
                                                                        : NULL;
    if (what) {
        g_set_error(
            error, DATA_ERROR, DATA_ERROR_INVALID,
            "%s (%zu × %zu texels, %zu views, %zu lights) and %s (%zu × %zu, %zu, %zu) cannot be "
            "compared, because they have different %s; give two forms of the same BTF",
            material_info(a)->label, of_a->width, of_a->height, of_a->views.n, of_a->lights.n,
            material_info(b)->label, of_b->width, of_b->height, of_b->views.n, of_b->lights.n,
            what);
        return NULL;
    }
    const struct compare_size size = {(int)of_a->width, (int)of_a->height, (int)of_a->views.n,
                                      (int)of_a->lights.n, max_pictures};
    return compare_sources(&(struct compare_source){material_info(a)->label, a, reconstruct},
                           &(struct compare_source){material_info(b)->label, b, reconstruct}, &size,
                           work, error);
}

struct comparison *compare_materials(const Material *a, const Material *b, const struct work *work,
                                     GError **error) {
    return compare_pair(a, b, COMPARE_PICTURES, work, error);
}

gboolean compare_model(const struct codec *codec, gconstpointer model, const struct btf_matrix *btf,
                       const struct work *work, double *ret_error, double *ret_luminance_error,
                       GError **error) {
    g_autoptr(Material) of_btf = material_borrow("the BTF", &material_btf_codec, btf);
    g_autoptr(Material) of_model = material_borrow(codec->title, codec, model);
    struct comparison *comparison = compare_pair(of_btf, of_model, 0, work, error);
    if (!comparison)
        return FALSE;
    *ret_error = comparison->all.error;
    *ret_luminance_error = comparison->all.luminance_error;
    comparison_free(comparison);
    return TRUE;
}

/* Gives a random direction whose angle to the normal is at most 78.5°. The directions are
 * distributed evenly over that part of the sphere. */
static void random_direction(GRand *random, float ret[3]) {
    const double z = g_rand_double_range(random, 0.2, 1), r = sqrt(1 - z * z);
    const double phi = g_rand_double_range(random, 0, 2 * G_PI);
    ret[0] = (float)(r * cos(phi));
    ret[1] = (float)(r * sin(phi));
    ret[2] = (float)z;
}

gboolean compare_evaluation_ns(const Material *material, double *ret_ns, GError **error) {
    const struct codec *codec = material_codec(material);
    gconstpointer model = material_model(material);
    const int n_texels = (int)btf_layout_texels(material_info(material)->layout);
    struct codec_tables tables = {0};
    if (!codec_tables_init(&tables, codec, model, error)) {
        codec_tables_clear(&tables);
        return FALSE;
    }
    const gsize n_views = codec_place_views(&tables), n_lights = codec_place_lights(&tables);
    g_autofree int *indices = g_new(int, n_views + n_lights);
    g_autofree float *weights = g_new(float, n_views + n_lights);
    struct codec_place place = {.views = indices,
                                .lights = indices + n_views,
                                .view_weights = weights,
                                .light_weights = weights + n_views};
    float directions[TIMED][2][3];
    int texels[TIMED];
    GRand *random = g_rand_new_with_seed(1);
    for (int i = 0; i < TIMED; i++) {
        random_direction(random, directions[i][0]);
        random_direction(random, directions[i][1]);
        texels[i] = g_rand_int_range(random, 0, n_texels);
    }
    g_rand_free(random);
    const gint64 begun_us = g_get_monotonic_time();
    const float one = 1;
    gint64 least_us = G_MAXINT64;
    for (gint64 now_us = begun_us; now_us - begun_us < TIMED_US;) {
        const gint64 round_us = now_us;
        for (int i = 0; i < TIMED; i++) {
            float rgb[COLOURS] = {0};
            codec_place_set(&tables, directions[i][0], directions[i][1], &place);
            codec->evaluate(model, &place.query, &(struct codec_texels){1, &texels[i], &one}, rgb);
        }
        now_us = g_get_monotonic_time();
        least_us = MIN(least_us, now_us - round_us);
    }
    *ret_ns = 1e3 * (double)least_us / TIMED;
    codec_tables_clear(&tables);
    return TRUE;
}
