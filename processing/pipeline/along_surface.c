/* Makes the new views in two steps. First, the distances of all new views are predicted, because
 * the new session takes the whole MDF when it is made. Then the values are computed, one view after
 * the other. */
#include "along_surface.h"

#include <gio/gio.h>
#include <glib/gstdio.h>
#include <math.h>
#include <string.h>

#include "base/data_error.h"
#include "base/direction.h"
#include "btf/btf.h"
#include "btf/btf_matrix.h"
#include "btf/near_field.h"
#include "directions/directions.h"
#include "mdf/reprojection.h"
#include "mdf_product.h"

#define COLOURS 3
#define BLOCKS  64  /* the texels of a view are given to threads in this number of parts */
#define FAR_MM  1e6 /* distance from the sample to the camera of a new view */

struct along {
    const struct work *work;
    const char *source;
    const struct btf_directions *to;
    const struct near_field *near;
    struct btf_matrix *btf;
    Reprojection *reprojection;
    struct direction_weights *lights; /* the weights of the measured lights for each new light */
    float *fade;                      /* directions_fade_weights() of each new light */
    /* the measured lights; the mean of their values is the value at the pole */
    const int *pole;
    int n_pole;
    int n_texels;
    struct mdf_result **mdf; /* MDF of each new view */

    /* The view that is being made. */
    int view;
    struct reprojection_tap (*taps)[REPROJECTION_MAX_TAPS]; /* taps of each texel */
    int *n_taps;
    guint8 *marks;     /* flags (enum btf_flag) of each texel */
    const float *from; /* the measured view that is being added */
    gsize stride;
    int from_view;
    float *sums; /* for each texel and measured light, three mixed values (mix()) */
};

static struct vec3 direction(const struct along *a, int view) {
    float v[3];
    direction_from_deg((double)a->to->views.theta_deg[view], (double)a->to->views.phi_deg[view], v);
    return vec3((double)v[0], (double)v[1], (double)v[2]);
}

static void trace(int block, gpointer data) {
    struct along *a = data;
    const struct vec3 v = direction(a, a->view);
    float *const *planes = a->mdf[a->view]->planes;
    const gint64 n = a->n_texels;
    for (int i = (int)(n * block / BLOCKS); i < (int)(n * (block + 1) / BLOCKS); i++) {
        struct reprojection_hit hit;
        double at_mm[2];
        reprojection_texel_mm(a->reprojection, i, at_mm);
        a->n_taps[i] = reprojection_taps(a->reprojection, at_mm, v, &hit, a->taps[i]);
        a->marks[i] = hit.seen ? 0 : BTF_FLAG_PREDICTED;
        planes[0][i] = hit.seen ? (float)hit.mm : -1;
        planes[1][i] = planes[3][i] = planes[5][i] = -1;
        planes[2][i] = 0;
        planes[4][i] = hit.seen ? MDF_PREDICTED : MDF_UNSEEN;
    }
}

static struct mdf_result *new_mdf(const struct along *a, int view) {
    struct mdf_result *ret = g_new0(struct mdf_result, 1);
    const struct vec3 v = direction(a, view);
    ret->index = view;
    ret->theta_deg = (double)a->to->views.theta_deg[view];
    ret->phi_deg = (double)a->to->views.phi_deg[view];
    ret->centre_mm[0] = v.x * FAR_MM;
    ret->centre_mm[1] = v.y * FAR_MM;
    ret->centre_mm[2] = v.z * FAR_MM + a->near->grid.reference_mm;
    ret->inputs = g_strdup_printf("predicted along the surface of %s", a->source);
    ret->agreed = g_strdup("");
    ret->lines.worst_position = -1;
    for (guint i = 0; i < G_N_ELEMENTS(ret->planes); i++)
        ret->planes[i] = g_new0(float, a->n_texels);
    return ret;
}

static void add(int block, gpointer data) {
    struct along *a = data;
    const gsize row = a->btf->layout.lights.n * COLOURS;
    const gint64 n = a->n_texels;
    for (gint64 i = n * block / BLOCKS; i < n * (block + 1) / BLOCKS; i++)
        for (int k = 0; k < a->n_taps[i]; k++) {
            const struct reprojection_tap *tap = &a->taps[i][k];
            if (tap->view != a->from_view)
                continue;
            const float *from = a->from + (gsize)tap->texel * a->stride;
            float *to = a->sums + (gsize)i * row;
            for (gsize c = 0; c < row; c++)
                to[c] += tap->weight * from[c];
        }
}

/* Sets a->sums: for each texel of the view that is being made, and for each measured light, the
 * weighted sum of the values of the texel's taps. Fails if the scratch file of the BTF cannot be
 * read. */
static gboolean mix(struct along *a, float *buffer, GError **error) {
    const int n_views = (int)a->btf->layout.views.n;
    const gsize row = a->btf->layout.lights.n * COLOURS;
    g_autofree gboolean *used = g_new0(gboolean, n_views);
    for (int i = 0; i < a->n_texels; i++)
        for (int k = 0; k < a->n_taps[i]; k++)
            used[a->taps[i][k].view] = TRUE;
    memset(a->sums, 0, sizeof(float) * row * (gsize)a->n_texels);
    for (int view = 0; view < n_views; view++) {
        if (!used[view])
            continue;
        a->from_view = view;
        a->from = btf_matrix_rows(a->btf, view, 0, a->n_texels, buffer, &a->stride, error);
        if (!a->from)
            return FALSE;
        work_for_each(a->work->n_threads, BLOCKS, add, a);
    }
    return TRUE;
}

/* Adds the mixed picture under the measured light `from`, times share, to the picture under a new
 * light. */
static void add_light(const struct along *a, int from, float share, float *ret_rgb) {
    const gsize row = a->btf->layout.lights.n * COLOURS;
    for (gsize i = 0; i < (gsize)a->n_texels; i++)
        for (gsize c = 0; c < COLOURS; c++)
            ret_rgb[COLOURS * i + c] += share * a->sums[i * row + COLOURS * (gsize)from + c];
}

/* Callback of import_material(): computes the values of a view. Negative values, which bicubic
 * interpolation may produce, are set to 0. */
static gboolean give_view(int view, float *ret_rgb, int *ret_holes, gpointer data, GError **error) {
    struct along *a = data;
    const gsize row = a->btf->layout.lights.n * COLOURS;
    const gsize n_lights = a->to->lights.n, n = (gsize)a->n_texels;
    g_autofree float *buffer = a->btf->values ? NULL : g_new(float, row *n);
    memset(ret_holes, 0, sizeof(int) * n_lights);
    memset(ret_rgb, 0, sizeof(float) * COLOURS * n * n_lights);
    a->view = view;
    work_for_each(a->work->n_threads, BLOCKS, trace, a);
    if (!mix(a, buffer, error))
        return FALSE;
    for (gsize light = 0; light < n_lights; light++) {
        const struct direction_weights *weights = &a->lights[light];
        float *rgb = ret_rgb + COLOURS * n * light;
        for (int k = 0; k < 4; k++) {
            const float share = weights->weight[k] * a->fade[light];
            if (share == 0)
                continue;
            if (weights->index[k] < (int)a->btf->layout.lights.n)
                add_light(a, weights->index[k], share, rgb);
            else
                for (int i = 0; i < a->n_pole; i++)
                    add_light(a, a->pole[i], share / (float)a->n_pole, rgb);
        }
        for (gsize i = 0; i < COLOURS * n; i++)
            rgb[i] = MAX(rgb[i], 0);
    }
    return TRUE;
}

static const guint8 *give_light(int view, int light, struct exr_part *part, gpointer data) {
    const struct along *a = data;
    int unseen = 0;
    for (int i = 0; i < a->n_texels; i++)
        unseen += a->marks[i] != 0;
    exr_set_int(part, "mesorig.bounds", 0);
    exr_set_int(part, "mesorig.shorter", 0);
    exr_set_int(part, "mesorig.predicted", unseen);
    exr_set_string(part, "resample.directions", a->to->name);
    exr_set_string(part, "resample.from", a->source);
    exr_set_int(part, "resample.along_surface", 1);
    return unseen > 0 ? a->marks : NULL;
}

static gboolean find_distances(struct along *a, struct along_surface_result *ret, GError **error) {
    const int n_views = (int)a->to->views.n;
    const gint64 begun = g_get_monotonic_time();
    for (a->view = 0; a->view < n_views; a->view++) {
        a->mdf[a->view] = new_mdf(a, a->view);
        work_for_each(a->work->n_threads, BLOCKS, trace, a);
        for (int i = 0; i < a->n_texels; i++)
            ret->unseen += a->marks[i] != 0;
        ret->texels += a->n_texels;
        if (!work_tell(a->work, "surface", a->view + 1, n_views, begun, error))
            return FALSE;
    }
    return TRUE;
}

static gboolean import(struct along *a, const char *path, const char *mdf,
                       struct along_surface_result *ret, GError **error) {
    const struct session_grid *grid = &a->near->grid;
    g_autofree char *source = g_strdup_printf("%s, predicted along the surface in directions “%s”",
                                              a->source, a->to->name);
    const struct import_material material = {
        .source = source,
        .width = grid->width,
        .height = grid->height,
        .texel_mm = grid->width_mm / grid->width,
        .n_views = (int)a->to->views.n,
        .n_lights = (int)a->to->lights.n,
        .view_theta_deg = a->to->views.theta_deg,
        .view_phi_deg = a->to->views.phi_deg,
        .light_theta_deg = a->to->lights.theta_deg,
        .light_phi_deg = a->to->lights.phi_deg,
        .view = give_view,
        .light = give_light,
        .data = a,
        .grid = grid,
        .mdf = mdf,
    };
    return import_material(path, &material, a->work, &ret->made, error);
}

static gboolean run(struct along *a, const char *path, struct along_surface_result *ret,
                    GError **error) {
    const gsize row = a->btf->layout.lights.n * COLOURS;
    const int n_lights = (int)a->to->lights.n;
    g_autoptr(Directions) lights =
        directions_new(a->btf->layout.lights.theta_deg, a->btf->layout.lights.phi_deg,
                       (int)a->btf->layout.lights.n, error);
    if (!lights)
        return FALSE;
    g_autofree struct direction_weights *weights = g_new(struct direction_weights, n_lights);
    g_autofree float *fade = g_new(float, n_lights), *sums = g_new(float, row * a->n_texels);
    g_autofree int *n_taps = g_new(int, a->n_texels);
    g_autofree guint8 *marks = g_new0(guint8, a->n_texels);
    g_autofree gpointer taps = g_malloc(sizeof *a->taps * (gsize)a->n_texels);
    for (int k = 0; k < n_lights; k++) {
        float l[3];
        direction_from_deg((double)a->to->lights.theta_deg[k], (double)a->to->lights.phi_deg[k], l);
        fade[k] = (float)directions_fade_weights(
            lights, vec3((double)l[0], (double)l[1], (double)l[2]), &weights[k]);
    }
    a->lights = weights;
    a->fade = fade;
    a->pole = directions_pole(lights, &a->n_pole);
    a->sums = sums;
    a->n_taps = n_taps;
    a->marks = marks;
    a->taps = taps;
    if (!find_distances(a, ret, error))
        return FALSE;
    g_autofree char *mdf = g_strdup_printf("%s.mdf-XXXXXX", path);
    const int file = g_mkstemp(mdf);
    if (file < 0)
        return data_error_fail(path, 0, error,
                               "no temporary file can be made next to the new session: %s; free "
                               "some space or make the folder writable",
                               g_strerror(errno));
    g_close(file, NULL);
    const gboolean ok = mdf_write(mdf, a->mdf, (int)a->to->views.n, &a->near->grid, error) &&
                        import(a, path, mdf, ret, error);
    g_unlink(mdf);
    return ok;
}

static gboolean along_open(struct along *a, gint64 memory, struct along_surface_result *ret,
                           GError **error) {
    g_autofree char *mdf = g_build_filename(a->source, "products", "mdf.exr", NULL);
    if (!g_file_test(mdf, G_FILE_TEST_EXISTS)) {
        g_set_error(error, DATA_ERROR, DATA_ERROR_INCOMPLETE,
                    "%s: the session has no MDF (products/mdf.exr) with the position of the "
                    "surface; capture the session with lasers, or resample without --along-surface",
                    a->source);
        return FALSE;
    }
    a->btf = session_check_product(mdf, error)
                 ? btf_matrix_read_within(memory, a->source, a->work, error)
                 : NULL;
    if (!a->btf)
        return FALSE;
    const struct btf_layout *layout = &a->btf->layout;
    a->reprojection = reprojection_read(mdf, layout->views.theta_deg, layout->views.phi_deg,
                                        (int)layout->views.n, FALSE, error);
    if (!a->reprojection)
        return FALSE;
    const struct mdf_plane *plane = reprojection_plane(a->reprojection);
    if ((gsize)plane->width != layout->width || (gsize)plane->height != layout->height)
        return data_error_fail(
            mdf, 0, error,
            "the MDF has %d × %d texels, but the BTF has %zu × %zu; process the session again",
            plane->width, plane->height, layout->width, layout->height);
    a->n_texels = plane->width * plane->height;
    ret->n_views = (int)layout->views.n;
    ret->n_lights = (int)layout->lights.n;
    ret->holes = a->btf->holes;
    ret->bounds = a->btf->bounds;
    ret->predicted = a->btf->predicted;
    return TRUE;
}

gboolean along_surface_predict(const char *session, const char *path,
                               const struct btf_directions *to, gint64 memory,
                               const struct work *work, struct along_surface_result *ret,
                               GError **error) {
    *ret = (struct along_surface_result){0};
    if (g_file_test(path, G_FILE_TEST_EXISTS)) {
        g_set_error(error, DATA_ERROR, DATA_ERROR_EXISTS, "%s: exists already; take another name",
                    path);
        return FALSE;
    }
    struct near_field *near = near_field_read(session, error);
    if (!near)
        return FALSE;
    char own_name[] = "own";
    const struct btf_directions own = {own_name, near->views, near->lights};
    struct along along = {.work = work, .source = session, .to = to ? to : &own, .near = near};
    along.mdf = g_new0(struct mdf_result *, along.to->views.n);
    const gboolean ok = along_open(&along, memory, ret, error) && run(&along, path, ret, error);
    for (gsize k = 0; k < along.to->views.n; k++)
        mdf_result_free(along.mdf[k]);
    g_free(along.mdf);
    reprojection_free(along.reprojection);
    btf_matrix_free(along.btf);
    near_field_free(near);
    return ok;
}
