#include "curve.h"

#include "codecs/codec/compare.h"
#include "codecs/codecs.h"

#include <string.h>

struct curve {
    const struct btf_matrix *btf;
    /* directions that are left out; NULL for the errors at the measured directions */
    const struct held_out *held;
    GArray *points;
    struct work quiet; /* can be cancelled, reports nothing */
};

void curve_free(GArray *points) {
    for (guint i = 0; points && i < points->len; i++) {
        g_free(g_array_index(points, struct plot_point, i).series);
        g_free(g_array_index(points, struct plot_point, i).label);
    }
    if (points)
        g_array_unref(points);
}

static gboolean measure(const struct curve *curve, const struct codec *codec,
                        const struct codec_point *point, double *ret_error, GError **error) {
    double luminance;
    if (curve->held)
        return held_out_error(curve->btf, curve->held, codec, point->model, &curve->quiet,
                              ret_error, error);
    *ret_error = point->error;
    return point->error >= 0 || compare_model(codec, point->model, curve->btf, &curve->quiet,
                                              ret_error, &luminance, error);
}

static gboolean add_point(const struct codec *codec, const struct codec_point *point, gpointer data,
                          GError **error) {
    struct curve *curve = data;
    double found;
    if (!measure(curve, codec, point, &found, error)) {
        g_free(point->label);
        return FALSE;
    }
    const struct plot_point added = {g_strdup(point->series), point->label, (double)point->bytes,
                                     found};
    g_array_append_val(curve->points, added);
    return TRUE;
}

static int by_series_and_size(gconstpointer a, gconstpointer b) {
    const struct plot_point *p = a, *q = b;
    const int series = strcmp(p->series, q->series);
    return series ? series : (p->bytes > q->bytes) - (p->bytes < q->bytes);
}

/* Removes each point that is not better than a smaller one: its series has a point of smaller size
 * whose error is not larger. */
static void keep_best(GArray *points) {
    struct plot_point *list = &g_array_index(points, struct plot_point, 0);
    guint kept = 0;
    for (guint i = 0; i < points->len; i++) {
        const gboolean same = kept > 0 && g_str_equal(list[kept - 1].series, list[i].series);
        if (!same || list[i].error < list[kept - 1].error) {
            list[kept++] = list[i];
            continue;
        }
        g_free(list[i].series);
        g_free(list[i].label);
    }
    g_array_set_size(points, kept);
}

GArray *curve_measure(const struct btf_matrix *btf, const struct held_out *held,
                      const struct work *work, GError **error) {
    static const struct work none;
    struct curve curve = {btf, held, g_array_new(FALSE, TRUE, sizeof(struct plot_point)), {0}};
    struct btf_matrix *rest = held ? held_out_rest(btf, held) : NULL;
    struct codec_geometry *rest_geometry =
        held && held->geometry ? held_out_rest_geometry(held->geometry, held) : NULL;
    gboolean ok = TRUE;
    work = work ? work : &none;
    curve.quiet.cancellable = work->cancellable;
    const struct codec_job job = {
        .btf = held ? rest : btf, .work = work, .geometry = rest_geometry};
    for (gsize i = 0; ok && codecs[i]; i++)
        ok = codecs[i]->curve(codecs[i], &job, add_point, &curve, error);
    btf_matrix_free(rest);
    codec_geometry_free(rest_geometry);
    if (!ok) {
        curve_free(curve.points);
        return NULL;
    }
    g_array_sort(curve.points, by_series_and_size);
    keep_best(curve.points);
    return curve.points;
}
