/* Reads a session's views into values[texel][view][light][colour], or into a scratch file
 * [view][texel][light][colour]. Each view is compared with the first view, and its holes are filled
 * (btf_holes.c). */
#include <gio/gio.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/data_error.h"
#include "btf.h"
#include "btf_matrix_private.h"

#define COLOURS 3
#define AGAIN   "; delete the file and process again, or import again"

static const char *const channels[] = {"R", "G", "B"};

char *btf_matrix_session(const char *path) {
    static const char suffix[] = "/products/btf";
    char *absolute = g_canonicalize_filename(path, NULL);
    g_autofree char *database = g_build_filename(absolute, "session.db", NULL);
    if (g_str_has_suffix(absolute, suffix) && !g_file_test(database, G_FILE_TEST_EXISTS))
        absolute[strlen(absolute) - strlen(suffix)] = '\0';
    return absolute;
}

void btf_matrix_free(struct btf_matrix *btf) {
    if (!btf)
        return;
    g_free(btf->name);
    g_free(btf->directory);
    btf_layout_clear(&btf->layout);
    g_free(btf->values);
    btf_scratch_free(btf->scratch);
    g_free(btf);
}

gint64 btf_matrix_bytes(const struct btf_layout *layout) {
    return (gint64)(btf_layout_texels(layout) * btf_layout_values(layout) * sizeof(float));
}

/* In memory, consecutive texels of one view are one whole row (an apparent BRDF) apart. */
const float *btf_matrix_rows(const struct btf_matrix *btf, int view, int first, int n,
                             float *buffer, gsize *ret_stride, GError **error) {
    const gsize row = btf->layout.lights.n * COLOURS;
    if (btf->values) {
        *ret_stride = row * btf->layout.views.n;
        return btf->values + (gsize)first * *ret_stride + (gsize)view * row;
    }
    *ret_stride = row;
    return btf_scratch_read(btf->scratch, view, first, n, buffer, error) ? buffer : NULL;
}

gboolean btf_matrix_place_rows(const struct btf_matrix *btf, int view, int first, int n,
                               const int *indices, float *ret, GError **error) {
    const gsize row = btf->layout.lights.n * COLOURS;
    if (!btf->values)
        return btf_scratch_place_rows(btf->scratch, view, first, n, indices, ret, error);
    const float *from = btf->values + ((gsize)first * btf->layout.views.n + (gsize)view) * row;
    for (int i = 0; i < n; i++)
        memcpy(ret + (gsize)indices[i] * row, from + (gsize)i * btf->layout.views.n * row,
               sizeof(float) * row);
    return TRUE;
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
        g_set_error(error, DATA_ERROR, DATA_ERROR_INCOMPLETE,
                    "%s: there is no BTF yet; “mesorig process” makes it", folder);
        g_clear_pointer(&paths, g_ptr_array_unref);
        return NULL;
    }
    g_ptr_array_sort(paths, by_name);
    return paths;
}

static gboolean direction(const struct exr_part *part, const char *of, const char *path,
                          float *ret_theta_deg, float *ret_phi_deg, GError **error) {
    return btf_direction(part, of, ret_theta_deg, ret_phi_deg) ||
           data_error_fail(
               path, 0, error,
               "in part %s the attribute %s.theta_deg or %s.phi_deg is missing or not a "
               "finite number" AGAIN,
               part->name, of, of);
}

gboolean btf_take_lights(struct btf_matrix *btf, const struct exr_file *first, const char *path,
                         GError **error) {
    if (first->parts->len < 1)
        return data_error_fail(path, 0, error, "the file has no lights" AGAIN);
    btf->layout.lights = direction_list_new(first->parts->len);
    for (gsize i = 0; i < btf->layout.lights.n; i++)
        if (!direction(g_ptr_array_index(first->parts, (guint)i), "light", path,
                       &btf->layout.lights.theta_deg[i], &btf->layout.lights.phi_deg[i], error))
            return FALSE;
    return TRUE;
}

/* Allocates memory for the values of all views. If memory is above 0 and the values need more bytes
 * than that, makes a scratch file instead. The first view gives the number of lights. */
static gboolean begin(struct btf_matrix *btf, gint64 memory, const struct exr_file *first,
                      const char *path, GError **error) {
    if (!btf_take_lights(btf, first, path, error))
        return FALSE;
    const gint64 bytes = btf_matrix_bytes(&btf->layout);
    if (memory > 0 && bytes > memory) {
        g_autofree char *folder = g_build_filename(btf->directory, "products", NULL);
        btf->scratch = btf_scratch_new(folder, btf->layout.lights.n * COLOURS, btf->layout.views.n,
                                       btf_layout_texels(&btf->layout), error);
        return btf->scratch != NULL;
    }
    btf->values = g_try_new0(float, (gsize)bytes / sizeof(float));
    if (!btf->values)
        g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                    "%s: the BTF of %zu × %zu texels, %zu views and %zu lights needs %.1f GiB of "
                    "memory, which the system refused; close other programs, or in “mesorig "
                    "compress” and “mesorig export” set a limit with --memory",
                    btf->directory, btf->layout.width, btf->layout.height, btf->layout.views.n,
                    btf->layout.lights.n, (double)bytes / (1 << 30));
    return btf->values != NULL;
}

/* Checks that a part has the size of the session's grid, all colours, and the direction that this
 * light has in the first view. */
static gboolean check_light(const struct btf_matrix *btf, const struct exr_part *part, int light,
                            const char *path, GError **error) {
    float theta, phi;
    if ((gsize)part->width != btf->layout.width || (gsize)part->height != btf->layout.height)
        return data_error_fail(path, 0, error,
                               "part %s has %d × %d texels, but the session's grid has %zu × "
                               "%zu" AGAIN,
                               part->name, part->width, part->height, btf->layout.width,
                               btf->layout.height);
    for (gsize c = 0; c < COLOURS; c++)
        if (!exr_part_plane(part, channels[c]))
            return data_error_fail(path, 0, error, "part %s lacks channel %s" AGAIN, part->name,
                                   channels[c]);
    if (!direction(part, "light", path, &theta, &phi, error))
        return FALSE;
    if (theta != btf->layout.lights.theta_deg[light] || phi != btf->layout.lights.phi_deg[light])
        return data_error_fail(
            path, 0, error,
            "the light of part %s is at θ %g°, φ %g°, but at θ %g°, φ %g° in the "
            "first view" AGAIN,
            part->name, (double)theta, (double)phi, (double)btf->layout.lights.theta_deg[light],
            (double)btf->layout.lights.phi_deg[light]);
    return TRUE;
}

/* Fills a picture's holes and adds their number to *holes. The channel "mark" says which texels are
 * holes. Imported pictures may lack this channel. Then every black texel is a hole if the
 * attribute mesorig.holes is above 0. NaN is always a hole. Infinite values are an error. A picture
 * that has only holes becomes black. */
static gboolean fill_holes(const struct exr_part *part, float *const planes[COLOURS],
                           const char *path, gint64 *holes, GError **error) {
    const int pixels = part->width * part->height;
    const float *flags = exr_part_plane(part, "mark");
    int n = 0;
    const gboolean black = !flags && exr_get_int(part, "mesorig.holes", &n, NULL) && n > 0;
    for (int i = 0; i < pixels; i++)
        if (flags ? flags[i] >= BTF_FLAG_HOLE && flags[i] < 2 * BTF_FLAG_HOLE
                  : black && planes[0][i] == 0 && planes[1][i] == 0 && planes[2][i] == 0)
            planes[0][i] = NAN;
    n = btf_fill_holes(planes, COLOURS, part->width, part->height);
    *holes += n < 0 ? pixels : n;
    for (int c = 0; c < COLOURS; c++) {
        if (n < 0)
            memset(planes[c], 0, sizeof(float) * (gsize)pixels);
        for (int i = 0; i < pixels; i++)
            if (!isfinite(planes[c][i]))
                return data_error_fail(path, 0, error,
                                       "in part %s the texel in column %d and row %d, counted from "
                                       "0, is not finite" AGAIN,
                                       part->name, i % part->width, i / part->width);
    }
    return TRUE;
}

/* Copies planes[light · 3 + colour][texel] to the rows of the texels: first[texel · stride + light
 * · 3 + colour]. */
gboolean btf_take_pictures(struct btf_matrix *btf, const struct exr_file *file, gsize first_light,
                           const char *path, float *first, gsize stride, GError **error) {
    const gsize n = file->parts->len * COLOURS, texels = btf_layout_texels(&btf->layout);
    g_autofree float **planes = g_new0(float *, n);
    for (guint i = 0; i < file->parts->len; i++) {
        const struct exr_part *part = g_ptr_array_index(file->parts, i);
        if (!check_light(btf, part, (int)(first_light + i), path, error))
            return FALSE;
        for (int c = 0; c < COLOURS; c++)
            planes[i * COLOURS + (guint)c] = exr_part_plane(part, channels[c]);
        if (!fill_holes(part, planes + i * COLOURS, path, &btf->holes, error))
            return FALSE;
        struct btf_flag_counts counts = {0};
        btf_count_flags(part, &counts);
        btf->bounds += counts.bounds;
        btf->shorter += counts.shorter;
        btf->predicted += counts.predicted;
    }
    first += first_light * COLOURS;
    for (gsize texel = 0; texel < texels; texel++)
        for (gsize i = 0; i < n; i++)
            first[texel * stride + i] = planes[i] ? planes[i][texel] : 0;
    return TRUE;
}

gboolean btf_take_view_direction(struct btf_matrix *btf, const struct exr_part *part, int view,
                                 const char *path, GError **error) {
    return direction(part, "view", path, &btf->layout.views.theta_deg[view],
                     &btf->layout.views.phi_deg[view], error);
}

gboolean btf_check_lights(const struct btf_matrix *btf, int n, const char *path, GError **error) {
    return (gsize)n == btf->layout.lights.n ||
           data_error_fail(path, 0, error,
                           "the file has %d lights, but the file of the first view has %zu" AGAIN,
                           n, btf->layout.lights.n);
}

gboolean btf_read_rows(struct btf_matrix *btf, int view, const char *path, int n_threads,
                       float *first, gsize stride, GError **error) {
    g_autoptr(ExrReader) reader = exr_reader_new(path, error);
    if (!reader || !btf_check_lights(btf, exr_reader_parts(reader), path, error))
        return FALSE;
    for (gsize light = 0; light < btf->layout.lights.n; light += BTF_PICTURES) {
        g_autoptr(ExrFile) file = exr_reader_next(reader, BTF_PICTURES, n_threads, error);
        if (!file || !btf_take_pictures(btf, file, light, path, first, stride, error) ||
            (light == 0 &&
             !btf_take_view_direction(btf, g_ptr_array_index(file->parts, 0), view, path, error)))
            return FALSE;
    }
    return TRUE;
}

static gboolean read_views(struct btf_matrix *btf, gint64 memory, const GPtrArray *paths,
                           const struct work *work, GError **error) {
    const gint64 begun_us = g_get_monotonic_time();
    const gsize n_views = btf->layout.views.n, texels = btf_layout_texels(&btf->layout);
    g_autofree float *buffer = NULL; /* values of one view, for the scratch file */
    const int threads = work ? work->n_threads : 0;
    g_autoptr(ExrFile) headers = exr_read_headers(g_ptr_array_index(paths, 0), error);
    if (!headers || !begin(btf, memory, headers, g_ptr_array_index(paths, 0), error))
        return FALSE;
    const gsize n = btf->layout.lights.n * COLOURS;
    gboolean ok = TRUE;
    for (gsize view = 0; ok && view < n_views; view++) {
        const char *path = g_ptr_array_index(paths, view);
        if (btf->values) {
            ok = btf_read_rows(btf, (int)view, path, threads, btf->values + view * n, n * n_views,
                               error);
        } else {
            buffer = buffer ? buffer : g_new(float, texels *n);
            ok = btf_read_rows(btf, (int)view, path, threads, buffer, n, error) &&
                 btf_scratch_write(btf->scratch, (int)view, buffer, error);
        }
        ok = ok && work_tell(work, "read", (int)view + 1, (int)n_views, begun_us, error);
    }
    return ok;
}

struct btf_matrix *btf_open(const char *path, gboolean verify, const struct work *work,
                            GPtrArray **ret_paths, GError **error) {
    struct session_grid grid;
    g_autofree char *directory = btf_matrix_session(path);
    g_autoptr(Session) session = session_open(directory, SESSION_READ, error);
    if (!session || !session_grid(session, &grid, error) ||
        (verify && !session_check_products(session, "products/btf/", work, error)) ||
        !(*ret_paths = list_views(session, error)))
        return NULL;
    struct btf_matrix *btf = g_new0(struct btf_matrix, 1);
    btf->name = g_strdup(session_name(session));
    btf->directory = g_strdup(session_path(session));
    btf->layout = (struct btf_layout){
        .width = (gsize)grid.width,
        .height = (gsize)grid.height,
        .texel_mm = grid.width_mm / grid.width,
        .reference_mm = grid.reference_mm,
        .views = direction_list_new((*ret_paths)->len),
    };
    return btf;
}

struct btf_matrix *btf_matrix_read(const char *path, const struct work *work, GError **error) {
    return btf_matrix_read_within(0, path, work, error);
}

struct btf_matrix *btf_matrix_read_within(gint64 memory, const char *path, const struct work *work,
                                          GError **error) {
    g_autoptr(GPtrArray) paths = NULL;
    struct btf_matrix *btf = btf_open(path, TRUE, work, &paths, error);
    if (btf && !read_views(btf, memory, paths, work, error))
        g_clear_pointer(&btf, btf_matrix_free);
    return btf;
}
