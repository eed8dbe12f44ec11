#include "export_brdf.h"

#include <math.h>

#include "base/data_error.h"
#include "base/srgb.h"
#include "btf/btf.h"
#include "formats/rti/rti.h"
#include "session_views.h"

struct export_rti_source {
    const struct session_view_files *files;
    const struct work *work;
    gint64 begun_us;
    float *pictures; /* n_lights × height × width × 3, sRGB; NaN for a hole */
};

static float encode(float linear) {
    return (float)srgb_encode(MAX((double)linear, 0));
}

static gboolean picture(int view G_GNUC_UNUSED, int light, const float *const planes[4],
                        gpointer data, GError **error) {
    const struct export_rti_source *source = data;
    const struct session_grid *grid = &source->files->grid;
    const gsize n = (gsize)grid->width * (gsize)grid->height;
    float *to = source->pictures + 3 * n * (gsize)light;
    for (gsize i = 0; i < n; i++) {
        gboolean hole = planes[3] && ((int)planes[3][i] & BTF_FLAG_HOLE);
        for (int c = 0; c < 3; c++)
            hole = hole || !isfinite(planes[c][i]);
        for (gsize c = 0; c < 3; c++)
            to[3 * i + c] = hole ? NAN : encode(planes[c][i]);
    }
    return work_tell(source->work, "read", light + 1, (int)source->files->lights.n,
                     source->begun_us, error);
}

static gboolean choose(const struct session_view_files *files, const char *session, int wished,
                       int *ret, GError **error) {
    const int n = (int)files->views.n;
    *ret = MAX(wished, 0);
    if (wished >= n)
        return data_error_fail(session, 0, error,
                               "there is no view %d; the session has the views 0 to %d", wished,
                               n - 1);
    for (int v = 0; wished < 0 && v < n; v++)
        if (files->views.theta_deg[v] < files->views.theta_deg[*ret])
            *ret = v;
    return TRUE;
}

static gboolean export_rti_view(const struct session_view_files *files, const char *session,
                                const char *output, const struct export_rti_options *options,
                                const struct work *work, struct export_rti_result *ret,
                                GError **error) {
    const struct session_grid *grid = &files->grid;
    const gsize values = 3 * (gsize)grid->width * (gsize)grid->height * files->lights.n;
    struct export_rti_source source = {files, work, g_get_monotonic_time(),
                                       g_try_new(float, values)};
    g_autofree float *pictures = source.pictures;
    struct rti_fit_result fit;
    if (!pictures)
        return data_error_fail(session, 0, error,
                               "there is no memory for a view of %.1f GiB; process the session "
                               "with fewer texels, or use a computer with more memory",
                               (double)values * sizeof(float) / (1 << 30));
    if (!session_view_files_read(files, ret->view, picture, &source, error))
        return FALSE;
    g_autofree float *lights = direction_list_vectors(&files->lights);
    g_autoptr(Rti) rti = rti_fit(session, pictures, grid->width, grid->height, lights,
                                 (int)files->lights.n, !options->rgb, &fit, error);
    if (!rti)
        return FALSE;
    ret->error = fit.error;
    ret->clipped = fit.clipped;
    ret->holes = fit.holes;
    return options->kind == EXPORT_PTM
               ? rti_write_ptm(output, rti, error)
               : rti_write_relight(output, options->replace, rti, lights, (int)files->lights.n,
                                   grid->width_mm / grid->width, error);
}

gboolean export_rti(const char *session, const char *output,
                    const struct export_rti_options *options, const struct work *work,
                    struct export_rti_result *ret, GError **error) {
    struct session_view_files files;
    *ret = (struct export_rti_result){0};
    gboolean ok = session_view_files_open(&files, session, error) &&
                  choose(&files, session, options->view, &ret->view, error);
    if (ok) {
        ret->width = files.grid.width;
        ret->height = files.grid.height;
        ret->n_lights = (int)files.lights.n;
        ret->theta_deg = (double)files.views.theta_deg[ret->view];
        ok = export_rti_view(&files, session, output, options, work, ret, error);
    }
    session_view_files_clear(&files);
    return ok;
}
