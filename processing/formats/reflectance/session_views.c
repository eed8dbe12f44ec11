#include "session_views.h"

#include "base/data_error.h"
#include "btf/btf.h"
#include "exr/exr.h"

#define MAX_BYTES ((gsize)512 << 20)

/* Fails with the name of the part. `of` is "view" or "light". */
static gboolean fail_direction(const char *path, const struct exr_part *part, const char *of,
                               GError **error) {
    return data_error_fail(path, 0, error,
                           "in part %s the attribute %s.theta_deg or %s.phi_deg is missing or not "
                           "a finite number" BTF_AGAIN,
                           part->name, of, of);
}

static gboolean direction(const struct exr_part *part, const char *of, const char *path,
                          struct direction_list *list, gsize i, GError **error) {
    return btf_direction(part, of, &list->theta_deg[i], &list->phi_deg[i]) ||
           fail_direction(path, part, of, error);
}

static gboolean directions(struct session_view_files *files, GError **error) {
    files->views = direction_list_new(files->paths->len);
    for (guint v = 0; v < files->paths->len; v++) {
        const char *path = files->paths->pdata[v];
        g_autoptr(ExrFile) file = exr_read_headers(path, error);
        if (!file)
            return FALSE;
        if (file->parts->len == 0)
            return data_error_fail(path, 0, error,
                                   "the file of this view has no pictures" BTF_AGAIN);
        if (v == 0)
            files->lights = direction_list_new(file->parts->len);
        if (!direction(file->parts->pdata[0], "view", path, &files->views, v, error))
            return FALSE;
        for (guint l = 0; v == 0 && l < file->parts->len; l++)
            if (!direction(file->parts->pdata[l], "light", path, &files->lights, l, error))
                return FALSE;
    }
    return TRUE;
}

gboolean session_view_files_open(struct session_view_files *ret, const char *path, GError **error) {
    *ret = (struct session_view_files){0};
    g_autoptr(Session) session = session_open(path, SESSION_READ, error);
    if (!session || !session_grid(session, &ret->grid, error))
        return FALSE;
    ret->paths = session_btf_files(session, error);
    return ret->paths && directions(ret, error);
}

void session_view_files_clear(struct session_view_files *files) {
    g_clear_pointer(&files->paths, g_ptr_array_unref);
    direction_list_clear(&files->views);
    direction_list_clear(&files->lights);
}

static gboolean picture(const struct session_view_files *files, const struct exr_part *part,
                        const char *path, int view, int light, SessionPicture func, gpointer data,
                        GError **error) {
    float theta, phi;
    if (part->width != files->grid.width || part->height != files->grid.height)
        return data_error_fail(
            path, 0, error,
            "part %s has %d × %d texels, but the session's grid has %d × %d" BTF_AGAIN, part->name,
            part->width, part->height, files->grid.width, files->grid.height);
    if (!btf_direction(part, "light", &theta, &phi))
        return fail_direction(path, part, "light", error);
    if (theta != files->lights.theta_deg[light] || phi != files->lights.phi_deg[light])
        return data_error_fail(path, 0, error,
                               "the light of part %s is at θ %g°, φ %g°, but at θ %g°, φ %g° in "
                               "the first view" BTF_AGAIN,
                               part->name, (double)theta, (double)phi,
                               (double)files->lights.theta_deg[light],
                               (double)files->lights.phi_deg[light]);
    const float *const planes[4] = {exr_part_plane(part, "R"), exr_part_plane(part, "G"),
                                    exr_part_plane(part, "B"), exr_part_plane(part, "mark")};
    if (!planes[0] || !planes[1] || !planes[2])
        return data_error_fail(path, 0, error, "part %s lacks channel R, G or B" BTF_AGAIN,
                               part->name);
    return func(view, light, planes, data, error);
}

gboolean session_view_files_read(const struct session_view_files *files, int view,
                                 SessionPicture func, gpointer data, GError **error) {
    const char *path = files->paths->pdata[view];
    const gsize texels = (gsize)files->grid.width * (gsize)files->grid.height;
    const gboolean whole = texels * files->lights.n * 3 * sizeof(float) <= MAX_BYTES;
    g_autoptr(ExrFile) file = whole ? exr_read(path, error) : exr_read_headers(path, error);
    if (!file)
        return FALSE;
    if (file->parts->len != files->lights.n)
        return data_error_fail(
            path, 0, error,
            "the file has %u lights, but the file of the first view has %zu" BTF_AGAIN,
            file->parts->len, files->lights.n);
    for (guint light = 0; light < file->parts->len; light++) {
        const struct exr_part *part = file->parts->pdata[light];
        g_autoptr(ExrPart) alone = whole ? NULL : exr_read_part(path, part->name, error);
        if (!whole && !alone)
            return FALSE;
        if (!picture(files, whole ? part : alone, path, view, (int)light, func, data, error))
            return FALSE;
    }
    return TRUE;
}
