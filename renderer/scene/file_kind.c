#include "file_kind.h"

#include "drawing/methods/methods.h"
#include "exr/exr.h"

#include <gio/gio.h>
#include <string.h>

static const char *const endings[] = {".exr", ".obj", ".gltf", ".glb", ".png"};

static const char *ending_of(const char *name) {
    for (gsize k = 0; k < G_N_ELEMENTS(endings); k++) {
        const gsize length = strlen(name), own = strlen(endings[k]);
        if (length > own && g_ascii_strcasecmp(name + length - own, endings[k]) == 0)
            return endings[k];
    }
    return NULL;
}

gboolean file_kind_is_shown(const char *name) {
    return ending_of(name) != NULL;
}

gboolean file_kind_is_session(const char *folder) {
    static const char *const parts[] = {"session.db", "products"};
    gboolean is = FALSE;
    for (gsize k = 0; !is && k < G_N_ELEMENTS(parts); k++) {
        g_autofree char *path = g_build_filename(folder, parts[k], NULL);
        is = g_file_test(path, G_FILE_TEST_EXISTS);
    }
    return is;
}

static gboolean refuse(const char *path, const char *why, GError **error) {
    g_set_error(error, G_IO_ERROR, G_IO_ERROR_NOT_SUPPORTED,
                "%s %s; choose a session's folder, a file of “mesorig process” or “mesorig "
                "compress”, an environment map (.exr, twice as wide as high), a normal map (.png) "
                "or a shape (.obj, .gltf, .glb)",
                path, why);
    return FALSE;
}

static gboolean exr_find_kind(const char *path, struct file_opened *ret, GError **error) {
    static const char *const mdfs[] = {"mdf-factors", "mdf-blocks", NULL};
    struct exr_file *file = exr_read_headers(path, error);
    const char *kind = NULL;
    gboolean has_views = FALSE, good = TRUE;
    if (file == NULL) {
        if (error != NULL && *error != NULL && strstr((*error)->message, path) == NULL)
            g_prefix_error(error, "%s: ", path);
        return FALSE;
    }
    for (guint k = 0; k < file->parts->len; k++) {
        const struct exr_part *part = file->parts->pdata[k];
        double theta_deg;
        if (kind == NULL)
            exr_get_string(part, "mesorig.kind", &kind, NULL);
        has_views |= exr_get_double(part, "view.theta_deg", &theta_deg, NULL);
    }
    g_autofree char *why =
        kind != NULL
            ? g_strdup_printf("is of the kind “%s”, for which there is no drawing method", kind)
            : g_strdup("is an EXR of another kind");
    const struct exr_part *first = file->parts->len > 0 ? file->parts->pdata[0] : NULL;
    const gboolean is_colour = first != NULL &&
                               g_strv_contains((const char *const *)first->channels, "R") &&
                               g_strv_contains((const char *const *)first->channels, "G");
    if (kind != NULL && (ret->method = method_find(kind)) != NULL)
        ret->kind = FILE_KIND_MATERIAL;
    else if (has_views || (kind != NULL && g_strv_contains(mdfs, kind)))
        ret->kind = FILE_KIND_MDF;
    else if (g_strcmp0(kind, "normals") == 0)
        ret->kind = FILE_KIND_NORMALS;
    else if (is_colour && first->width == 2 * first->height)
        ret->kind = FILE_KIND_ENVIRONMENT;
    else
        good = refuse(path, why, error);
    exr_file_free(file);
    return good;
}

gboolean file_kind_find(const char *path, struct file_opened *ret, GError **error) {
    g_autofree char *name = g_path_get_basename(path), *folder = g_path_get_dirname(path);
    const char *ending = ending_of(name);
    *ret = (struct file_opened){.kind = FILE_KIND_SESSION};
    if (!g_file_test(path, G_FILE_TEST_EXISTS)) {
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_NOT_FOUND,
                    "there is no file or folder %s; check its name", path);
        return FALSE;
    }
    if (g_file_test(path, G_FILE_TEST_IS_DIR)) {
        const gboolean inside = g_str_equal(name, "products") && file_kind_is_session(folder);
        if (!file_kind_is_session(path) && !inside)
            return refuse(path, "is not a session: it has neither session.db nor products", error);
        ret->path = g_strdup(inside ? folder : path);
        return TRUE;
    }
    if (g_str_equal(name, "session.db")) {
        ret->path = g_strdup(folder);
        return TRUE;
    }
    if (ending == NULL)
        return refuse(path, "is a file of another kind", error);
    if (g_str_equal(ending, ".exr") && !exr_find_kind(path, ret, error))
        return FALSE;
    if (g_str_equal(ending, ".png"))
        ret->kind = FILE_KIND_NORMALS;
    else if (!g_str_equal(ending, ".exr"))
        ret->kind = FILE_KIND_SHAPE;
    ret->path = g_strdup(path);
    return TRUE;
}

void file_opened_clear(struct file_opened *opened) {
    g_clear_pointer(&opened->path, g_free);
}
