#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "exr.h"
#include "lpca.h"

#define COLOURS 3

/* The session a path belongs to: itself, or what its products/btf lies in. */
static Session *open_session(const char *path, GError **error) {
    g_autofree char *absolute = g_canonicalize_filename(path, NULL);
    g_autofree char *database = g_build_filename(absolute, "session.db", NULL);
    if (g_str_has_suffix(absolute, "/products/btf") && !g_file_test(database, G_FILE_TEST_EXISTS)) {
        g_autofree char *products = g_path_get_dirname(absolute);
        g_autofree char *session = g_path_get_dirname(products);
        return session_open(session, SESSION_READ, error);
    }
    return session_open(absolute, SESSION_READ, error);
}

static int by_name(gconstpointer a, gconstpointer b) {
    return strcmp(*(const char *const *)a, *(const char *const *)b);
}

static GPtrArray *list_views(const Session *session, GError **error) {
    g_autofree char *folder = session_file(session, "products/btf");
    g_autoptr(GDir) dir = g_dir_open(folder, 0, NULL);
    GPtrArray *paths = g_ptr_array_new_with_free_func(g_free);
    const char *name;
    while (dir && (name = g_dir_read_name(dir)))
        if (g_str_has_prefix(name, "view_") && g_str_has_suffix(name, ".exr"))
            g_ptr_array_add(paths, g_build_filename(folder, name, NULL));
    if (paths->len == 0) {
        g_set_error(error, PIPELINE_ERROR, PIPELINE_ERROR_INCOMPLETE,
                    "%s: there is no BTF yet; “mesorig process” makes it", folder);
        g_clear_pointer(&paths, g_ptr_array_unref);
        return NULL;
    }
    g_ptr_array_sort(paths, by_name);
    return paths;
}

static gboolean view_error(const char *path, GError **error, const char *what) {
    g_set_error(error, PIPELINE_ERROR, PIPELINE_ERROR_DATA,
                "%s: %s; delete the file and process again", path, what);
    return FALSE;
}

static gboolean direction(const struct exr_part *part, const char *of, const char *path,
                          float *ret_theta_deg, float *ret_phi_deg, GError **error) {
    g_autofree char *theta_name = g_strconcat(of, ".theta_deg", NULL);
    g_autofree char *phi_name = g_strconcat(of, ".phi_deg", NULL);
    double theta = NAN, phi = NAN;
    exr_get_double(part, theta_name, &theta, NULL);
    exr_get_double(part, phi_name, &phi, NULL);
    *ret_theta_deg = (float)theta;
    *ret_phi_deg = (float)phi;
    return (isfinite(theta) && isfinite(phi)) ||
           view_error(path, error, "a direction is missing or not a number");
}

/* Memory for all views, once the first says how many lights there are. */
static gboolean begin(struct btf_matrix *btf, const struct exr_file *first, const char *path,
                      GError **error) {
    btf->n_lights = (int)first->parts->len;
    if (btf->n_lights < 1)
        return view_error(path, error, "there are no lights in it");
    btf->light_theta_deg = g_new0(float, btf->n_lights);
    btf->light_phi_deg = g_new0(float, btf->n_lights);
    for (int i = 0; i < btf->n_lights; i++)
        if (!direction(g_ptr_array_index(first->parts, (guint)i), "light", path,
                       &btf->light_theta_deg[i], &btf->light_phi_deg[i], error))
            return FALSE;
    const gsize row = (gsize)btf->n_views * (gsize)btf->n_lights * COLOURS;
    const gsize texels = (gsize)btf->width * (gsize)btf->height;
    btf->values = g_try_new0(float, texels *row);
    if (!btf->values)
        g_set_error(error, PIPELINE_ERROR, PIPELINE_ERROR_DATA,
                    "a BTF of %d × %d texels, %d views and %d lights needs %.1f GiB of memory",
                    btf->width, btf->height, btf->n_views, btf->n_lights,
                    (double)(texels * row) * sizeof(float) / (1 << 30));
    return btf->values != NULL;
}

static gboolean check_light(const struct btf_matrix *btf, const struct exr_part *part, int light,
                            const char *path, GError **error) {
    float theta, phi;
    if (part->width != btf->width || part->height != btf->height)
        return view_error(path, error, "its texels are not those of the session");
    if (!exr_part_plane(part, "R") || !exr_part_plane(part, "G") || !exr_part_plane(part, "B"))
        return view_error(path, error, "a colour is missing");
    if (!direction(part, "light", path, &theta, &phi, error))
        return FALSE;
    if (theta != btf->light_theta_deg[light] || phi != btf->light_phi_deg[light])
        return view_error(path, error, "its lights are not those of the first view");
    return TRUE;
}

static gboolean add_view(struct btf_matrix *btf, const struct exr_file *file, int view,
                         const char *path, GError **error) {
    static const char *const channels[] = {"R", "G", "B"};
    const gsize n = (gsize)btf->n_lights * COLOURS, row = n * (gsize)btf->n_views;
    g_autofree const float **planes = g_new0(const float *, n);
    if ((int)file->parts->len != btf->n_lights)
        return view_error(path, error, "its lights are not as many as those of the first view");
    for (int light = 0; light < btf->n_lights; light++) {
        const struct exr_part *part = g_ptr_array_index(file->parts, (guint)light);
        int holes = 0;
        if (!check_light(btf, part, light, path, error))
            return FALSE;
        for (int c = 0; c < COLOURS; c++)
            planes[light * COLOURS + c] = exr_part_plane(part, channels[c]);
        if (exr_get_int(part, "mesorig.holes", &holes, NULL))
            btf->holes += MAX(holes, 0);
    }
    for (gsize texel = 0; texel < (gsize)btf->width * (gsize)btf->height; texel++) {
        float *to = btf->values + texel * row + (gsize)view * n;
        for (int i = 0; i < btf->n_lights * COLOURS; i++) {
            to[i] = planes[i] ? planes[i][texel] : NAN;
            if (!isfinite(to[i]))
                return view_error(path, error, "a value is not a number");
        }
    }
    return direction(g_ptr_array_index(file->parts, 0), "view", path, &btf->view_theta_deg[view],
                     &btf->view_phi_deg[view], error);
}

static gboolean read_views(struct btf_matrix *btf, const GPtrArray *paths, PipelineFunc progress,
                           gpointer data, GCancellable *cancellable, GError **error) {
    const gint64 begun = g_get_monotonic_time();
    gboolean ok = TRUE;
    for (int view = 0; ok && view < btf->n_views; view++) {
        const char *path = g_ptr_array_index(paths, (guint)view);
        if (g_cancellable_set_error_if_cancelled(cancellable, error))
            return FALSE;
        struct exr_file *file = exr_read(path, error);
        ok = file && (view > 0 || begin(btf, file, path, error)) &&
             add_view(btf, file, view, path, error);
        exr_file_free(file);
        const double spent = (double)(g_get_monotonic_time() - begun) / G_USEC_PER_SEC;
        const struct pipeline_progress now = {"read", view + 1, btf->n_views,
                                              spent / (view + 1) * (btf->n_views - view - 1)};
        if (ok && progress)
            progress(&now, data);
    }
    return ok;
}

struct btf_matrix *btf_matrix_read(const char *path, PipelineFunc progress, gpointer data,
                                   GCancellable *cancellable, GError **error) {
    struct session_grid grid;
    g_autoptr(Session) session = open_session(path, error);
    if (!session || !session_grid(session, &grid, error))
        return NULL;
    g_autoptr(GPtrArray) paths = list_views(session, error);
    if (!paths)
        return NULL;
    struct btf_matrix *btf = g_new0(struct btf_matrix, 1);
    btf->name = g_strdup(session_name(session));
    btf->directory = g_strdup(session_path(session));
    btf->width = grid.width;
    btf->height = grid.height;
    btf->texel_mm = grid.width_mm / grid.width;
    btf->reference_mm = grid.reference_mm;
    btf->n_views = (int)paths->len;
    btf->view_theta_deg = g_new0(float, btf->n_views);
    btf->view_phi_deg = g_new0(float, btf->n_views);
    if (!read_views(btf, paths, progress, data, cancellable, error))
        g_clear_pointer(&btf, btf_matrix_free);
    return btf;
}
