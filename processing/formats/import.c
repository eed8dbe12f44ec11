#include "import_private.h"

#include <errno.h>
#include <fcntl.h>
#include <gio/gio.h>
#include <glib/gstdio.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "base/data_error.h"
#include "base/output_file.h"
#include "btf/btf.h"
#include "codecs/eigenmaps/eigenmaps.h"
#include "exr/exr.h"

#define EIGENMAPS 4
/* Eigen-maps that take more memory than this are kept in a file while they are computed. */
#define MAPS_MEMORY ((gsize)512 << 20)

static gboolean fail_errno(const char *path, GError **error) {
    const int saved = errno;
    const gboolean exists = saved == EEXIST || saved == ENOTEMPTY;
    if (exists)
        g_set_error(error, DATA_ERROR, DATA_ERROR_EXISTS, "%s: exists already; take another name",
                    path);
    else
        g_set_error(error, DATA_ERROR, DATA_ERROR_IO,
                    "%s: the session cannot be made: %s; give a path in a folder with free space "
                    "in which you may write",
                    path, g_strerror(saved));
    return FALSE;
}

gboolean import_place_begin(struct import_place *place, const char *path, GError **error) {
    g_autofree char *absolute = g_canonicalize_filename(path, NULL);
    g_autofree char *parent = g_path_get_dirname(absolute), *base = g_path_get_basename(absolute);
    *place = (struct import_place){0};
    if (g_file_test(absolute, G_FILE_TEST_EXISTS)) {
        errno = EEXIST;
        return fail_errno(path, error);
    }
    g_autofree char *folder = g_strdup_printf("%s/.%s.XXXXXX", parent, base);
    if (!g_mkdtemp_full(folder, 0777))
        return fail_errno(path, error);
    if (g_str_has_suffix(base, ".session"))
        base[strlen(base) - strlen(".session")] = '\0';
    place->session = g_build_filename(folder, "session", NULL);
    place->name = g_steal_pointer(&base);
    place->folder = g_steal_pointer(&folder);
    place->path = g_steal_pointer(&absolute);
    return TRUE;
}

/* Removes a directory with its content. It must be a directory that this process has made. */
static void remove_tree(const char *path) {
    g_autoptr(GDir) dir = g_dir_open(path, 0, NULL);
    const char *name;
    while (dir && (name = g_dir_read_name(dir))) {
        g_autofree char *inside = g_build_filename(path, name, NULL);
        if (g_file_test(inside, G_FILE_TEST_IS_DIR) && !g_file_test(inside, G_FILE_TEST_IS_SYMLINK))
            remove_tree(inside);
        else
            g_unlink(inside);
    }
    g_rmdir(path);
}

gboolean import_place_end(struct import_place *place, Session *session, gboolean good,
                          GError **error) {
    session_close(session);
    if (good && !output_file_move_folder(place->session, place->path, error)) {
        g_rmdir(place->folder); /* g_rmdir() leaves the folder if the session is still in it */
        g_clear_pointer(&place->folder, g_free);
        good = FALSE;
    }
    if (place->folder)
        remove_tree(place->folder);
    g_free(place->folder);
    g_free(place->session);
    g_free(place->path);
    g_free(place->name);
    *place = (struct import_place){0};
    return good;
}

struct import {
    const struct import_material *material;
    const struct work *work;
    struct import_region region;
    struct session_grid grid;
    Session *session;
    gint64 begun_us;
    gint64 holes;
    int *lights; /* the indices of all lights, 0 … n_lights − 1, for btf_read_view() */
    int asked;   /* number of calls of give_column(), for the progress */
};

static gboolean check(struct import *import, GError **error) {
    const struct import_material *material = import->material;
    struct import_region *region = &import->region;
    *region = material->region;
    if (region->width == 0 && region->height == 0)
        *region = (struct import_region){0, 0, material->width, material->height};
    if (region->x < 0 || region->y < 0 || region->width < 1 || region->height < 1 ||
        region->width > material->width - region->x ||
        region->height > material->height - region->y)
        return data_error_fail(
            material->source, 0, error,
            "the region of %d × %d texels from column %d, row %d does not lie within the %d × %d "
            "texels of the file; give a region within the file",
            region->width, region->height, region->x, region->y, material->width, material->height);
    import->grid = (struct session_grid){.width = region->width,
                                         .height = region->height,
                                         .width_mm = region->width * material->texel_mm,
                                         .height_mm = region->height * material->texel_mm};
    if (material->grid)
        import->grid = *material->grid;
    return TRUE;
}

static struct session_direction *directions(const float *theta_deg, const float *phi_deg, int n) {
    struct session_direction *list = g_new0(struct session_direction, n);
    for (int i = 0; i < n; i++)
        list[i] = (struct session_direction){
            .index = i, .theta_deg = (double)theta_deg[i], .phi_deg = (double)phi_deg[i]};
    return list;
}

static struct exr_part *light_part(const struct import *import, int view, int light, int holes) {
    static const char *const channels[] = {"B", "G", "R", "mark", NULL};
    const struct import_material *m = import->material;
    const struct import_region *r = &import->region;
    g_autofree char *name = g_strdup_printf("light_%04d", light);
    struct exr_part *part = exr_part_new(name, r->width, r->height, channels, EXR_HALF);
    exr_set_double(part, "view.theta_deg", (double)m->view_theta_deg[view]);
    exr_set_double(part, "view.phi_deg", (double)m->view_phi_deg[view]);
    exr_set_double(part, "light.theta_deg", (double)m->light_theta_deg[light]);
    exr_set_double(part, "light.phi_deg", (double)m->light_phi_deg[light]);
    exr_set_string(part, "mesorig.inputs", m->source);
    exr_set_int(part, "mesorig.holes", holes);
    const guint8 *marks = m->light ? m->light(view, light, part, m->data) : NULL;
    for (int i = 0; marks && i < r->width * r->height; i++)
        part->planes[3][i] = marks[i];
    /* A part has the channel "mark" only if a texel has a flag. */
    if (!marks && !(m->picture && !m->black_holes && holes > 0)) {
        part->n_channels = 3;
        g_clear_pointer(&part->channels[3], g_free);
        g_clear_pointer(&part->planes[3], g_free);
    }
    return part;
}

static void copy_region(const struct import *import, const float *rgb, struct exr_part *part) {
    const struct import_region *r = &import->region;
    for (int y = 0; y < r->height; y++)
        for (int x = 0; x < r->width; x++) {
            const float *from =
                rgb + 3 * ((gsize)(r->y + y) * (gsize)import->material->width + (gsize)(r->x + x));
            for (int c = 0; c < 3; c++)
                part->planes[2 - c][y * r->width + x] = from[c];
        }
}

static char *view_relative(int view) {
    return g_strdup_printf("products/btf/view_%04d.exr", view);
}

static gboolean check_holes(const struct import_material *m, int view, int light, int holes,
                            GError **error) {
    const gsize n = (gsize)m->width * (gsize)m->height;
    return (double)holes <= IMPORT_MAX_HOLES * (double)n ||
           data_error_fail(m->source, 0, error,
                           "%d of %zu texels of view %d under light %d, both counted from 0, are "
                           "missing or not numbers, but at most half may be; check the pictures "
                           "of this view",
                           holes, n, view, light);
}

static gboolean write_view(struct import *import, int view, float *rgb, int *holes,
                           GError **error) {
    const struct import_material *m = import->material;
    const gsize n = (gsize)m->width * (gsize)m->height;
    g_autofree char *relative = view_relative(view);
    g_autofree char *path = session_file(import->session, relative);
    if (!m->view(view, rgb, holes, m->data, error))
        return FALSE;
    g_autoptr(ExrFile) file = exr_file_new();
    gboolean ok = TRUE;
    for (int light = 0; ok && light < m->n_lights; light++) {
        import->holes += holes[light];
        ok = check_holes(m, view, light, holes[light], error);
        struct exr_part *part = light_part(import, view, light, holes[light]);
        copy_region(import, rgb + 3 * n * (gsize)light, part);
        exr_file_add(file, part);
    }
    return ok && exr_write(path, file, EXR_PIZ, FALSE, error) &&
           session_add_product(import->session, relative, m->source, error);
}

/* A view that is written picture by picture. */
struct import_view {
    struct import *import;
    int view;
};

static gboolean fill_picture(struct exr_part *part, gpointer data, GError **error) {
    const struct import_view *filled = data;
    struct import *import = filled->import;
    const struct import_material *m = import->material;
    float *const planes[4] = {part->planes[2], part->planes[1], part->planes[0],
                              part->n_channels > 3 ? part->planes[3] : NULL};
    int light = 0, holes;
    sscanf(part->name, "light_%d", &light);
    if (m->n_together > 0 ? g_cancellable_set_error_if_cancelled(import->work->cancellable, error)
                          : !work_tell(import->work, "import", filled->view * m->n_lights + light,
                                       m->n_views * m->n_lights, import->begun_us, error))
        return FALSE;
    return m->picture(filled->view, light, &import->region, planes, &holes, m->data, error);
}

/* Writes a view as write_view() does, but with only one picture in memory. The number of holes of a
 * part is written before its pixels. All pictures are therefore first read for their numbers of
 * holes. */
static gboolean write_view_by_pictures(struct import *import, int view, gint64 *ret_holes,
                                       GError **error) {
    const struct import_material *m = import->material;
    g_autofree char *relative = view_relative(view);
    g_autofree char *path = session_file(import->session, relative);
    g_autoptr(ExrFile) file = exr_file_new();
    struct import_view filled = {import, view};
    *ret_holes = 0;
    for (int light = 0; light < m->n_lights; light++) {
        int holes = 0;
        if (g_cancellable_set_error_if_cancelled(import->work->cancellable, error) ||
            !m->picture(view, light, &import->region, NULL, &holes, m->data, error) ||
            (m->black_holes && !check_holes(m, view, light, holes, error)))
            return FALSE;
        struct exr_part *part = light_part(import, view, light, holes);
        exr_part_drop_planes(part);
        exr_file_add(file, part);
        *ret_holes += holes;
    }
    return exr_write_filled(path, file, EXR_PIZ, FALSE, fill_picture, &filled, error);
}

static gboolean add_view(struct import *import, int view, gint64 holes, GError **error) {
    g_autofree char *relative = view_relative(view);
    import->holes += holes;
    return session_add_product(import->session, relative, import->material->source, error);
}

/* Views that are written at the same time, each by one thread. */
struct import_group {
    struct import *import;
    int first;
    gint64 *holes;   /* for each view, like errors */
    GError **errors; /* NULL if the view was written */
};

static void write_one_of_group(int i, gpointer data) {
    const struct import_group *group = data;
    write_view_by_pictures(group->import, group->first + i, &group->holes[i], &group->errors[i]);
}

static gboolean write_group(struct import *import, int first, int n, GError **error) {
    const struct import_material *m = import->material;
    g_autofree gint64 *holes = g_new0(gint64, n);
    g_autofree GError **errors = g_new0(GError *, n);
    struct import_group group = {import, first, holes, errors};
    gboolean ok = m->load(first, n, m->data, error);
    if (ok)
        work_for_each(import->work->n_threads, n, write_one_of_group, &group);
    for (int i = 0; i < n; i++)
        if (errors[i] && ok) {
            g_propagate_error(error, errors[i]);
            ok = FALSE;
        } else {
            g_clear_error(&errors[i]);
            ok = ok && add_view(import, first + i, holes[i], error);
        }
    return ok && work_tell(import->work, "import", first + n, m->n_views, import->begun_us, error);
}

/* Fills the eigen-map of a light if there is only one view: copies the picture of the BTF under
 * this light. */
static gboolean fill_map(struct exr_part *part, gpointer data, GError **error) {
    struct import *import = data;
    const int n_lights = import->material->n_lights;
    g_autofree char *relative = view_relative(0);
    g_autofree char *path = session_file(import->session, relative);
    int light = 0;
    sscanf(part->name, "E000_light_%d", &light);
    g_autofree char *name = g_strdup_printf("light_%04d", light);
    if (!work_tell(import->work, "eigenmaps", light, n_lights, import->begun_us, error))
        return FALSE;
    g_autoptr(ExrPart) from = exr_read_part(path, name, error);
    for (int c = 0; from && c < 3; c++) {
        float *plane = part->planes[c];
        part->planes[c] = from->planes[c];
        from->planes[c] = plane;
    }
    return from != NULL;
}

static gboolean give_column(int view, float *ret_column, gpointer data, GError **error) {
    struct import *import = data;
    const int n_views = import->material->n_views;
    g_autofree char *relative = view_relative(view);
    g_autofree char *path = session_file(import->session, relative);
    import->asked++;
    return work_tell(import->work, "eigenmaps", MIN(import->asked, n_views), n_views,
                     import->begun_us, error) &&
           btf_read_view(path, import->lights, import->material->n_lights, &import->grid,
                         import->work->n_threads, ret_column, error);
}

/* Gives the pictures of n lights of a view. */
static gboolean give_lights(int view, gsize first, gsize n, float *ret, gpointer data,
                            GError **error) {
    struct import *import = data;
    g_autofree char *relative = view_relative(view);
    g_autofree char *path = session_file(import->session, relative);
    return !g_cancellable_set_error_if_cancelled(import->work->cancellable, error) &&
           btf_read_view(path, import->lights + first, (int)n, &import->grid,
                         import->work->n_threads, ret, error);
}

static struct eigenmaps *new_eigenmaps(const struct import *import) {
    const struct import_material *m = import->material;
    struct eigenmaps *maps = g_new0(struct eigenmaps, 1);
    *maps = (struct eigenmaps){
        .name = g_strdup(session_name(import->session)),
        .layout.width = import->grid.width,
        .layout.height = import->grid.height,
        .layout.texel_mm = m->texel_mm,
        .layout.reference_mm = import->grid.reference_mm,
        .layout.views.n = m->n_views,
        .layout.lights.n = m->n_lights,
        .n_terms = MIN(EIGENMAPS, m->n_views),
        .layout.views.theta_deg = g_memdup2(m->view_theta_deg, sizeof(float) * (gsize)m->n_views),
        .layout.views.phi_deg = g_memdup2(m->view_phi_deg, sizeof(float) * (gsize)m->n_views),
        .layout.lights.theta_deg =
            g_memdup2(m->light_theta_deg, sizeof(float) * (gsize)m->n_lights),
        .layout.lights.phi_deg = g_memdup2(m->light_phi_deg, sizeof(float) * (gsize)m->n_lights)};
    return maps;
}

static gboolean write_computed(struct import *import, const char *path, struct eigenmaps *maps,
                               double *ret_error, GError **error) {
    const gsize bytes = sizeof(float) * 3 * btf_layout_texels(&maps->layout) *
                        maps->layout.lights.n * (gsize)maps->n_terms;
    g_autofree char *products = session_file(import->session, "products");
    const struct eigenmaps_options options = {
        .folder = bytes > MAPS_MEMORY ? products : NULL, .part = give_lights, .lights = TRUE};
    if (!eigenmaps_compute_with(maps, &options, give_column, import, ret_error, error))
        return FALSE;
    *ret_error = eigenmaps_rounded_error(maps, *ret_error);
    return eigenmaps_write(path, maps, error);
}

static gboolean write_eigenmaps(struct import *import, double *ret_error, GError **error) {
    g_autofree char *path = session_file(import->session, "products/eigenmaps.exr");
    struct eigenmaps *maps = new_eigenmaps(import);
    import->begun_us = g_get_monotonic_time();
    *ret_error = 0;
    const gboolean ok = (maps->layout.views.n == 1
                             ? eigenmaps_write_view(path, maps, fill_map, import, error) &&
                                   work_tell(import->work, "eigenmaps", import->material->n_lights,
                                             import->material->n_lights, import->begun_us, error)
                             : write_computed(import, path, maps, ret_error, error)) &&
                        session_add_product(import->session, "products/eigenmaps.exr",
                                            import->material->source, error);
    eigenmaps_free(maps);
    return ok;
}

static gboolean copy_mdf(const struct import *import, GError **error) {
    static const char relative[] = "products/mdf.exr";
    if (!import->material->mdf)
        return TRUE;
    g_autofree char *path = session_file(import->session, relative);
    g_autoptr(GFile) from = g_file_new_for_path(import->material->mdf);
    g_autoptr(GFile) to = g_file_new_for_path(path);
    if (!g_file_copy(from, to, G_FILE_COPY_TARGET_DEFAULT_PERMS, import->work->cancellable, NULL,
                     NULL, error)) {
        g_prefix_error(error, "%s: cannot be copied: ", import->material->mdf);
        return FALSE;
    }
    return session_add_product(import->session, relative, import->material->source, error);
}

static gboolean write_views(struct import *import, GError **error) {
    const struct import_material *m = import->material;
    for (int view = 0; m->n_together > 0 && view < m->n_views; view += m->n_together)
        if (!write_group(import, view, MIN(m->n_together, m->n_views - view), error))
            return FALSE;
    if (m->n_together > 0)
        return TRUE;
    for (int view = 0; m->picture && view < m->n_views; view++) {
        gint64 holes;
        if (!write_view_by_pictures(import, view, &holes, error) ||
            !add_view(import, view, holes, error))
            return FALSE;
    }
    if (m->picture)
        return work_tell(import->work, "import", m->n_views * m->n_lights, m->n_views * m->n_lights,
                         import->begun_us, error);
    const gsize n = (gsize)m->width * (gsize)m->height * (gsize)m->n_lights;
    g_autofree float *rgb = g_try_new(float, 3 * n);
    g_autofree int *holes = g_new0(int, m->n_lights);
    if (!rgb)
        return data_error_fail(
            m->source, 0, error,
            "there is no memory for a view of %.1f GiB; import fewer texels or fewer lights",
            3 * (double)n * sizeof(float) / (1 << 30));
    for (int view = 0; view < m->n_views; view++)
        if (!write_view(import, view, rgb, holes, error) ||
            !work_tell(import->work, "import", view + 1, m->n_views, import->begun_us, error))
            return FALSE;
    return TRUE;
}

static gboolean fill(struct import *import, struct import_result *ret, GError **error) {
    const struct import_material *m = import->material;
    g_autofree int *lights = import->lights = g_new(int, m->n_lights);
    for (int i = 0; i < m->n_lights; i++)
        lights[i] = i;
    if (!write_views(import, error) || !write_eigenmaps(import, &ret->eigenmaps_error, error) ||
        !copy_mdf(import, error))
        return FALSE;
    ret->n_views = m->n_views;
    ret->n_lights = m->n_lights;
    ret->width = import->grid.width;
    ret->height = import->grid.height;
    ret->holes = import->holes;
    return (!m->filled || m->filled(import->session, m->data, error)) &&
           session_set_value(import->session, "imported", m->source, error) &&
           session_set_value(import->session, "state", "done", error);
}

gboolean import_material(const char *path, const struct import_material *material,
                         const struct work *work, struct import_result *ret, GError **error) {
    const struct work none = {0};
    struct import import = {
        .material = material, .work = work ? work : &none, .begun_us = g_get_monotonic_time()};
    struct import_place place;
    *ret = (struct import_result){0};
    if (!check(&import, error) || !import_place_begin(&place, path, error))
        return FALSE;
    g_autofree struct session_direction *views =
        directions(material->view_theta_deg, material->view_phi_deg, material->n_views);
    g_autofree struct session_direction *lights =
        directions(material->light_theta_deg, material->light_phi_deg, material->n_lights);
    const struct session_texts texts = {IMPORT_NO_TEXT, IMPORT_NO_TEXT, IMPORT_NO_TEXT, NULL};
    const struct session_plan plan = {.grid = import.grid,
                                      .views = views,
                                      .n_views = material->n_views,
                                      .lights = lights,
                                      .n_lights = material->n_lights};
    import.session = session_create(place.session, place.name, &texts, &plan, error);
    const gboolean ok = import.session && fill(&import, ret, error);
    return import_place_end(&place, import.session, ok, error);
}
