/* The BTF is resampled in three passes:
 * - All views are written to a scratch file [view][texel][light][lane]. The lanes are R, G, B and
 *   the flags.
 * - Blocks of texels are gathered from this file, resampled and written to a second file.
 * - The views of the second file are written as the result.
 * Therefore only some views and blocks are in memory at a time. */
#include "near_field_correction.h"

#include <gio/gio.h>
#include <math.h>
#include <string.h>

#include "base/data_error.h"
#include "base/robust.h"
#include "btf/btf.h"
#include "btf/btf_matrix_private.h"
#include "btf/texel_resampler.h"
#include "formats/import_private.h"

#define LANES   RESAMPLER_LANES
#define COLOURS 3
#define BLOCK   16  /* number of texels that are resampled at a time */
#define BAND    1.0 /* range of θ in degrees that a band covers */

struct job {
    const struct work *work;
    const struct near_field *near;
    const struct btf_directions *to;
    struct resampler resampler;
    /* scratch files of the source and of the result: n_views × texels × lights × lanes */
    struct btf_scratch *measured, *made;
    int n_texels;
    struct resampler_sums **sums; /* sums of each block */
    struct resampler_sums *all;
    GMutex mutex;
    GError *error;             /* error of the first block that failed */
    GCancellable *cancellable; /* cancelled by the user's cancellable, and on the first error */
    const char *source;        /* the session's path */
    const struct near_field_correction_result *result;
    float *rgb;     /* n_lights × texels × 3: values of the view being written */
    guint8 *marks;  /* n_lights × texels: flags of the view being written (enum btf_flag) */
    gboolean *some; /* for each light, whether any texel of the view being written has a flag */
};

void near_field_correction_result_clear(struct near_field_correction_result *result) {
    g_clear_pointer(&result->from, g_array_unref);
    g_clear_pointer(&result->to, g_array_unref);
}

/* Writes a view to job->measured, with values and flags interleaved: R, G, B, flags. */
static gboolean store_view(struct job *job, struct btf_matrix *btf, const struct exr_file *file,
                           int view, const char *path, GError **error) {
    const gsize n_lights = btf->layout.lights.n, n_texels = (gsize)job->n_texels;
    g_autofree float *values = g_new(float, n_texels *n_lights *COLOURS);
    g_autofree float *rows = g_new(float, n_texels *n_lights *LANES);
    if (!btf_check_lights(btf, (int)file->parts->len, path, error) ||
        !btf_take_pictures(btf, file, 0, path, values, n_lights * COLOURS, error) ||
        !btf_take_view_direction(btf, g_ptr_array_index(file->parts, 0), view, path, error))
        return FALSE;
    for (gsize light = 0; light < n_lights; light++) {
        const float *mark = exr_part_plane(g_ptr_array_index(file->parts, (guint)light), "mark");
        for (gsize texel = 0; texel < n_texels; texel++) {
            float *row = rows + (texel * n_lights + light) * LANES;
            memcpy(row, values + (texel * n_lights + light) * COLOURS, sizeof(float) * COLOURS);
            row[COLOURS] = mark && mark[texel] > 0 ? MIN(mark[texel], 15.0f) : 0;
        }
    }
    return btf_scratch_write(job->measured, view, rows, error);
}

static gboolean read_views(struct job *job, struct near_field_correction_result *ret,
                           GError **error) {
    g_autoptr(GPtrArray) paths = NULL;
    struct btf_matrix *btf = btf_open(job->source, TRUE, job->work, &paths, error);
    const gint64 begun = g_get_monotonic_time();
    gboolean ok = btf != NULL;
    if (ok && btf->layout.views.n != job->near->views.n) {
        g_set_error(
            error, DATA_ERROR, DATA_ERROR_INCOMPLETE,
            "%s: its BTF now has %zu views instead of %zu; if the session is being processed, wait "
            "until that has ended, then try again",
            job->source, btf->layout.views.n, job->near->views.n);
        ok = FALSE;
    }
    for (gsize view = 0; ok && view < btf->layout.views.n; view++) {
        const char *path = g_ptr_array_index(paths, (guint)view);
        g_autoptr(ExrFile) file = exr_read(path, error);
        ok = file && (view > 0 || btf_take_lights(btf, file, path, error)) &&
             store_view(job, btf, file, view, path, error) &&
             work_tell(job->work, "read", view + 1, btf->layout.views.n, begun, error);
    }
    ret->holes = btf ? btf->holes : 0;
    ret->bounds = btf ? btf->bounds : 0;
    ret->predicted = btf ? btf->predicted : 0;
    btf_matrix_free(btf);
    return ok;
}

/* Reads n texels of all views. The order [view][texel][light] of the scratch file becomes
 * [texel][view][light] in memory. write_block() does the reverse. rows is a buffer for n texels of
 * one view. */
static gboolean read_block(const struct job *job, int first, int n, float *texels, float *rows,
                           GError **error) {
    const gsize row = job->near->lights.n * LANES;
    for (gsize view = 0; view < job->near->views.n; view++) {
        if (!btf_scratch_read(job->measured, view, first, n, rows, error))
            return FALSE;
        for (gsize i = 0; i < (gsize)n; i++)
            memcpy(texels + (i * job->near->views.n + (gsize)view) * row, rows + i * row,
                   sizeof(float) * row);
    }
    return TRUE;
}

static gboolean write_block(const struct job *job, int first, int n, const float *texels,
                            float *rows, GError **error) {
    const gsize row = job->to->lights.n * LANES;
    for (gsize view = 0; view < job->to->views.n; view++) {
        for (gsize i = 0; i < (gsize)n; i++)
            memcpy(rows + i * row, texels + (i * job->to->views.n + (gsize)view) * row,
                   sizeof(float) * row);
        if (!btf_scratch_write_rows(job->made, view, first, n, rows, error))
            return FALSE;
    }
    return TRUE;
}

/* Resamples one block of texels in a thread of the pool. */
static void resample_block(int block, gpointer data) {
    struct job *job = data;
    const int first = block * BLOCK, n = MIN(BLOCK, job->n_texels - first);
    const gsize from = job->near->views.n * job->near->lights.n * LANES;
    const gsize to = job->to->views.n * job->to->lights.n * LANES;
    g_autofree float *values = g_new(float, BLOCK *from), *made = g_new(float, BLOCK *to);
    g_autofree float *rows =
        g_new(float, BLOCK *LANES *(gsize)MAX(job->near->lights.n, job->to->lights.n));
    g_autoptr(GError) error = NULL;
    job->sums[block] = resampler_sums_new(&job->resampler);
    gboolean ok = read_block(job, first, n, values, rows, &error);
    for (int i = 0; ok && i < n; i++)
        resampler_texel(&job->resampler, first + i, values + (gsize)i * from, made + (gsize)i * to,
                        job->sums[block]);
    if (ok && write_block(job, first, n, made, rows, &error))
        return;
    g_mutex_lock(&job->mutex);
    if (!job->error)
        job->error = g_steal_pointer(&error);
    g_mutex_unlock(&job->mutex);
    g_cancellable_cancel(job->cancellable);
}

static void cancel_too(GCancellable *users, gpointer ours) {
    g_cancellable_cancel(ours);
}

static gboolean resample_texels(struct job *job, GError **error) {
    const int n_blocks = (job->n_texels + BLOCK - 1) / BLOCK;
    GCancellable *users = job->work->cancellable;
    job->cancellable = g_cancellable_new();
    const gulong id =
        users ? g_cancellable_connect(users, G_CALLBACK(cancel_too), job->cancellable, NULL) : 0;
    struct work work = *job->work;
    work.cancellable = job->cancellable;
    job->sums = g_new0(struct resampler_sums *, n_blocks);
    job->all = resampler_sums_new(&job->resampler);
    gboolean ok = work_parallel(&work, "resample", n_blocks, resample_block, job, error);
    if (users)
        g_cancellable_disconnect(users, id);
    if (job->error) { /* the first error is reported, not the cancellation that it caused */
        g_clear_error(error);
        g_propagate_error(error, g_steal_pointer(&job->error));
        ok = FALSE;
    }
    for (int i = 0; i < n_blocks; i++) {
        if (job->sums[i])
            resampler_sums_add(&job->resampler, job->sums[i], job->all);
        resampler_sums_free(job->sums[i]);
    }
    g_clear_pointer(&job->sums, g_free);
    g_clear_object(&job->cancellable);
    return ok;
}

/* Returns the relative error √(Σ d² / Σ v²), or 0 if all values are 0. */
static double relative_error(double error, double norm) {
    return norm > 0 ? sqrt(error / norm) : 0;
}

static void set_from(struct near_field_correction_band *band, const struct resampler_from *sums) {
    band->back = relative_error(sums->back, sums->back_norm);
    band->left_out_view = relative_error(sums->left_view, sums->left_view_norm);
    band->left_out_light = relative_error(sums->left_light, sums->left_light_norm);
}

static void set_to(struct near_field_correction_band *band, const struct resampler_to *sums,
                   double n /* number of texels of all views */, gboolean own) {
    band->moved_deg = sums->moved_deg / n;
    band->max_moved_deg = sums->max_moved_deg;
    band->held = sums->clamped / n;
    band->nominal = own ? relative_error(sums->nominal, sums->norm) : -1;
}

/* Returns the distinct elevations. Elevations that differ by less than BAND count as one. */
static GArray *elevations(const float *theta_deg, int n) {
    GArray *bands = g_array_new(FALSE, TRUE, sizeof(struct near_field_correction_band));
    g_autofree double *sorted = g_new(double, n);
    for (int i = 0; i < n; i++)
        sorted[i] = (double)theta_deg[i];
    qsort(sorted, (gsize)n, sizeof *sorted, robust_by_value);
    for (int i = 0; i < n; i++)
        if (i == 0 ||
            sorted[i] >
                g_array_index(bands, struct near_field_correction_band, bands->len - 1).theta_deg +
                    BAND) {
            const struct near_field_correction_band band = {.theta_deg = sorted[i], .nominal = -1};
            g_array_append_val(bands, band);
        }
    return bands;
}

static gboolean in_band(const struct near_field_correction_band *band, float theta_deg) {
    return (double)theta_deg >= band->theta_deg && (double)theta_deg <= band->theta_deg + BAND;
}

static void fill_from(const struct job *job, struct near_field_correction_result *ret) {
    struct resampler_from whole = {0};
    ret->from = elevations(job->near->views.theta_deg, job->near->views.n);
    for (guint k = 0; k < ret->from->len; k++) {
        struct near_field_correction_band *band =
            &g_array_index(ret->from, struct near_field_correction_band, k);
        struct resampler_from sums = {0};
        for (gsize i = 0; i < job->near->views.n; i++)
            if (in_band(band, job->near->views.theta_deg[i])) {
                resampler_from_add(&job->all->from[i], &sums);
                band->n_views++;
            }
        set_from(band, &sums);
        resampler_from_add(&sums, &whole);
    }
    set_from(&ret->all, &whole);
}

static void fill_to(const struct job *job, struct near_field_correction_result *ret) {
    struct resampler_to whole = {0};
    ret->to = elevations(job->to->views.theta_deg, job->to->views.n);
    for (guint k = 0; k < ret->to->len; k++) {
        struct near_field_correction_band *band =
            &g_array_index(ret->to, struct near_field_correction_band, k);
        struct resampler_to sums = {0};
        for (gsize i = 0; i < job->to->views.n; i++)
            if (in_band(band, job->to->views.theta_deg[i])) {
                resampler_to_add(&job->all->to[i], &sums);
                band->n_views++;
            }
        set_to(band, &sums, (double)job->n_texels * band->n_views, job->resampler.own);
        resampler_to_add(&sums, &whole);
    }
    set_to(&ret->all, &whole, (double)job->n_texels * job->to->views.n, job->resampler.own);
}

/* Callback of import_material(). */
static gboolean give_view(int view, float *ret_rgb, int *ret_holes, gpointer data, GError **error) {
    struct job *job = data;
    const gsize n_lights = job->to->lights.n, n = (gsize)job->n_texels;
    g_autofree float *rows = g_new(float, BLOCK *n_lights *LANES);
    memset(ret_holes, 0, sizeof(int) * n_lights);
    memset(job->some, 0, sizeof(gboolean) * n_lights);
    for (gsize first = 0; first < n; first += BLOCK) {
        const gsize count = MIN(BLOCK, n - first);
        if (!btf_scratch_read(job->made, view, (int)first, (int)count, rows, error))
            return FALSE;
        for (gsize i = 0; i < count; i++)
            for (gsize light = 0; light < n_lights; light++) {
                const float *value = rows + (i * n_lights + light) * LANES;
                const guint8 mark = (guint8)value[COLOURS];
                memcpy(ret_rgb + 3 * (light * n + first + i), value, sizeof(float) * COLOURS);
                job->marks[light * n + first + i] = mark;
                job->some[light] |= mark != 0;
                ret_holes[light] += (mark & BTF_FLAG_HOLE) != 0;
            }
    }
    return TRUE;
}

static const guint8 *give_light(int view, int light, struct exr_part *part, gpointer data) {
    const struct job *job = data;
    const struct near_field_correction_result *result = job->result;
    const guint8 *marks = job->marks + (gsize)light * (gsize)job->n_texels;
    int bounds = 0, shorter = 0, predicted = 0;
    for (int i = 0; job->some[light] && i < job->n_texels; i++) {
        bounds += (marks[i] & BTF_FLAG_BOUND) != 0;
        shorter += (marks[i] & BTF_FLAG_SHORTER) != 0;
        predicted += (marks[i] & BTF_FLAG_PREDICTED) != 0;
    }
    exr_set_int(part, "mesorig.bounds", bounds);
    exr_set_int(part, "mesorig.shorter", shorter);
    exr_set_int(part, "mesorig.predicted", predicted);
    exr_set_string(part, "resample.directions", job->to->name);
    exr_set_string(part, "resample.from", job->source);
    exr_set_int(part, "resample.exact", result->exact);
    exr_set_double(part, "resample.left_out_view", result->all.left_out_view);
    exr_set_double(part, "resample.left_out_light", result->all.left_out_light);
    exr_set_double(part, "resample.back", result->all.back);
    exr_set_double(part, "resample.moved_deg", job->all->to[view].moved_deg / job->n_texels);
    return job->some[light] ? marks : NULL;
}

/* Writes the result as an imported session. */
static gboolean write_session(struct job *job, const char *path,
                              struct near_field_correction_result *ret, GError **error) {
    const gsize n = (gsize)job->n_texels * job->to->lights.n;
    const struct session_grid *grid = &job->near->grid;
    g_autofree char *mdf = g_build_filename(job->source, "products", "mdf.exr", NULL);
    ret->mdf = g_file_test(mdf, G_FILE_TEST_EXISTS);
    if (!session_check_product(mdf, error))
        return FALSE;
    g_autofree char *source =
        g_strdup_printf("%s, resampled to directions “%s”", job->source, job->to->name);
    g_autofree guint8 *marks = job->marks = g_new0(guint8, n);
    g_autofree gboolean *some = job->some = g_new0(gboolean, job->to->lights.n);
    const struct import_material material = {
        .source = source,
        .width = grid->width,
        .height = grid->height,
        .texel_mm = grid->width_mm / grid->width,
        .n_views = job->to->views.n,
        .n_lights = job->to->lights.n,
        .view_theta_deg = job->to->views.theta_deg,
        .view_phi_deg = job->to->views.phi_deg,
        .light_theta_deg = job->to->lights.theta_deg,
        .light_phi_deg = job->to->lights.phi_deg,
        .view = give_view,
        .light = give_light,
        .data = job,
        .grid = grid,
        .mdf = ret->mdf ? mdf : NULL,
    };
    job->result = ret;
    return import_material(path, &material, job->work, &ret->made, error);
}

static struct btf_directions *own_directions(const struct near_field *near) {
    struct btf_directions *ret = g_new0(struct btf_directions, 1);
    *ret = (struct btf_directions){.name = g_strdup("own"),
                                   .views = direction_list_copy(&near->views),
                                   .lights = direction_list_copy(&near->lights)};
    return ret;
}

static gboolean run(struct job *job, const char *path, gboolean own,
                    struct near_field_correction_result *ret, GError **error) {
    if (g_file_test(path, G_FILE_TEST_EXISTS)) {
        g_set_error(error, DATA_ERROR, DATA_ERROR_EXISTS, "%s: exists already; take another name",
                    path);
        return FALSE;
    }
    g_autofree char *absolute = g_canonicalize_filename(path, NULL);
    g_autofree char *folder = g_path_get_dirname(absolute);
    job->measured = btf_scratch_new(folder, (gsize)job->near->lights.n * LANES, job->near->views.n,
                                    job->n_texels, error);
    job->made = job->measured ? btf_scratch_new(folder, (gsize)job->to->lights.n * LANES,
                                                job->to->views.n, job->n_texels, error)
                              : NULL;
    if (!job->made || !read_views(job, ret, error))
        return FALSE;
    resampler_init(&job->resampler, job->near, job->to, own);
    gboolean ok = resample_texels(job, error);
    g_clear_pointer(&job->measured, btf_scratch_free);
    if (ok) {
        ret->exact = job->near->camera_mm != NULL || job->near->lamp_mm != NULL;
        ret->n_views = job->near->views.n;
        ret->n_lights = job->near->lights.n;
        ret->sampled = job->all->sampled;
        ret->light_moved_deg = job->all->light_moved_deg / job->n_texels;
        ret->light_most_moved_deg = job->all->light_most_moved_deg;
        ret->all.theta_deg = -1;
        ret->all.n_views = job->to->views.n;
        fill_from(job, ret);
        fill_to(job, ret);
    }
    ok = ok && write_session(job, path, ret, error);
    resampler_sums_free(job->all);
    resampler_clear(&job->resampler);
    return ok;
}

gboolean near_field_correct(const char *session, const char *path, const struct btf_directions *to,
                            const struct work *work, struct near_field_correction_result *ret,
                            GError **error) {
    *ret = (struct near_field_correction_result){0};
    struct near_field *near = near_field_read(session, error);
    if (!near)
        return FALSE;
    struct btf_directions *own = to ? NULL : own_directions(near);
    struct job job = {.work = work,
                      .near = near,
                      .to = to ? to : own,
                      .n_texels = near->grid.width * near->grid.height,
                      .source = session};
    g_mutex_init(&job.mutex);
    const gboolean ok = run(&job, path, to == NULL, ret, error);
    g_mutex_clear(&job.mutex);
    btf_scratch_free(job.measured);
    btf_scratch_free(job.made);
    btf_directions_free(own);
    near_field_free(near);
    if (!ok)
        near_field_correction_result_clear(ret);
    return ok;
}
