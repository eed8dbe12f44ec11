#include "compare.h"

#include "base/data_error.h"
#include "base/direction.h"
#include "exr/exr.h"
#include "metrics/delta_e.h"

#include <math.h>
#include <string.h>

#define COLOURS 3
#define BLOCKS  64
#define SAME    0.01F /* degrees */

/* Sums over the values of one view, of one light or of all. */
struct compare_totals {
    double residual, all; /* Σ (a − b)², Σ a² over R, G, B */
    double luminance, delta_e, n;
};

struct compare_block {
    struct compare_totals *totals; /* n_views, then n_lights */
    double largest;                /* |a − b| */
    /* the material with values that are infinite or NaN, of which the first is at `texel`;
     * otherwise NULL */
    const Material *damaged;
    int texel;
};

struct compare_run {
    const Material *a, *b;
    const struct btf_layout *layout;
    int n_blocks;
    struct compare_block *blocks;
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
    to->luminance += from->luminance;
    to->delta_e += from->delta_e;
    to->n += from->n;
}

static void do_block(int number, gpointer data) {
    const struct compare_run *run = data;
    struct compare_block *block = &run->blocks[number];
    const gsize views = run->layout->views.n, lights = run->layout->lights.n;
    const gsize n = views * lights * COLOURS;
    const gint64 texels = (gint64)btf_layout_texels(run->layout);
    const int end = (int)(texels * (number + 1) / run->n_blocks);
    g_autofree float *both = g_new0(float, 2 * n);
    block->totals = g_new0(struct compare_totals, views + lights);
    for (int texel = (int)(texels * number / run->n_blocks); texel < end; texel++) {
        const Material *const materials[] = {run->a, run->b};
        for (gsize k = 0; k < 2; k++) {
            material_reconstruct(materials[k], texel, both + k * n);
            if (exr_all_finite(both + k * n, n))
                continue;
            block->damaged = materials[k];
            block->texel = texel;
            return;
        }
        for (gsize i = 0; i < views * lights; i++) {
            const float *a = both + i * COLOURS, *b = a + n;
            struct compare_totals value = {0};
            double lab_a[3], lab_b[3];
            for (int c = 0; c < COLOURS; c++) {
                const double residual = (double)a[c] - b[c];
                value.residual += residual * residual;
                value.all += (double)a[c] * a[c];
                block->largest = MAX(block->largest, fabs(residual));
            }
            value.luminance = fabsf(rgb_luminance(a) - rgb_luminance(b));
            delta_e_lab(a, lab_a);
            delta_e_lab(b, lab_b);
            value.delta_e = delta_e_2000(lab_a, lab_b);
            value.n = 1;
            add(&block->totals[i / lights], &value);
            add(&block->totals[views + i % lights], &value);
        }
    }
}

static struct compare_sums finish(const struct compare_totals *totals) {
    const double ratio = totals->all > 0        ? totals->residual / totals->all
                         : totals->residual > 0 ? INFINITY
                                                : 0;
    return (struct compare_sums){sqrt(ratio), totals->luminance / totals->n,
                                 totals->delta_e / totals->n};
}

/* Returns NULL with an error if a block found damaged values. */
static struct comparison *summarise(const struct compare_run *run, GError **error) {
    const gsize views = run->layout->views.n, lights = run->layout->lights.n;
    const int width = (int)run->layout->width;
    struct compare_totals all = {0};
    for (int k = 0; k < run->n_blocks; k++) {
        const struct compare_block *block = &run->blocks[k];
        if (!block->damaged)
            continue;
        g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                    "%s: its values at texel (%d, %d) are not finite; make "
                    "or compress it again",
                    material_info(block->damaged)->label, block->texel % width,
                    block->texel / width);
        return NULL;
    }
    struct comparison *ret = g_new0(struct comparison, 1);
    ret->n_views = (int)views;
    ret->n_lights = (int)lights;
    ret->views = g_new0(struct compare_sums, views);
    ret->lights = g_new0(struct compare_sums, lights);
    for (gsize i = 0; i < views + lights; i++) {
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

struct comparison *compare_materials(const Material *a, const Material *b, const struct work *work,
                                     GError **error) {
    const struct btf_layout *of_a = material_info(a)->layout, *of_b = material_info(b)->layout;
    const char *what = of_a->width != of_b->width || of_a->height != of_b->height
                           ? "numbers of texels"
                       : !same_directions(&of_a->views, &of_b->views)   ? "views"
                       : !same_directions(&of_a->lights, &of_b->lights) ? "lights"
                                                                        : NULL;
    if (what) {
        g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                    "%s (%zu × %zu texels, %zu views, %zu lights) and %s (%zu × %zu, %zu, %zu) "
                    "cannot be compared: they have different %s",
                    material_info(a)->label, of_a->width, of_a->height, of_a->views.n,
                    of_a->lights.n, material_info(b)->label, of_b->width, of_b->height,
                    of_b->views.n, of_b->lights.n, what);
        return NULL;
    }
    const int n_blocks = (int)MIN(BLOCKS, btf_layout_texels(of_a));
    g_autofree struct compare_block *blocks = g_new0(struct compare_block, n_blocks);
    struct compare_run run = {a, b, of_a, n_blocks, blocks};
    struct comparison *ret = NULL;
    if (work_parallel(work, "compare", n_blocks, do_block, &run, error))
        ret = summarise(&run, error);
    for (int k = 0; k < n_blocks; k++)
        g_free(blocks[k].totals);
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
