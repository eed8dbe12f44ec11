#include "methods.h"

#include "drawing/gl/gpu.h"
#include "eigenmaps_view.h"
#include "eigenmaps_volume.h"
#include "exr/exr.h"
#include "hsh_view.h"
#include "lobes_view.h"
#include "lpca_grid.h"
#include "lpca_revised.h"
#include "lpca_view.h"
#include "microfacet.h"
#include "neural_view.h"
#include "session/session.h"

#include <gio/gio.h>
#include <glib/gstdio.h>
#include <string.h>

const struct method *const methods[] = {
    &method_eigenmaps,
    &method_eigenmaps_volume,
    &method_lpca_grid,
    &method_lpca_revised,
    &method_lpca,
    &methods_lobes[LOBES_FIELDS],
    &methods_lobes[LOBES_PTM],
    &method_hsh,
    &methods_lobes[LOBES_LAFORTUNE],
    &methods_lobes[LOBES_WARD],
    &methods_lobes[LOBES_ASHIKHMIN],
    &method_neural,
    &methods_microfacet[0],
    &methods_microfacet[1],
    &methods_microfacet[2],
    &methods_microfacet[3],
    NULL,
};

const struct method *method_find(const char *name) {
    for (gsize k = 0; methods[k] != NULL; k++)
        if (strcmp(methods[k]->name, name) == 0)
            return methods[k];
    return NULL;
}

/* Returns when the session's product was written, in seconds since 1970. Returns -1 if there is
 * none. */
static gint64 made_at(const struct method *method, const char *session) {
    g_autofree char *path = method->product != NULL ? method_path(method, session) : NULL;
    GStatBuf file;
    return path != NULL && g_stat(path, &file) == 0 ? (gint64)file.st_mtime : -1;
}

const struct method *method_of_session(const char *session) {
    const gint64 lpca = made_at(&method_lpca, session);
    if (lpca >= 0 && lpca >= made_at(&method_eigenmaps, session))
        return &method_lpca;
    for (gsize k = 0; methods[k] != NULL; k++)
        if (made_at(methods[k], session) >= 0)
            return methods[k];
    return NULL;
}

char *method_path(const struct method *method, const char *argument) {
    if (method->product != NULL && g_file_test(argument, G_FILE_TEST_IS_DIR))
        return g_build_filename(argument, "products", method->product, NULL);
    return g_strdup(argument);
}

/* If the file names its kind (mesorig.kind) and no method draws this kind, sets an error and
 * returns TRUE. */
static gboolean refuse_kind(const char *path, GError **error) {
    g_autoptr(ExrFile) file = exr_read_headers(path, NULL);
    const char *kind = NULL;
    for (guint k = 0; file != NULL && kind == NULL && k < file->parts->len; k++)
        exr_get_string(file->parts->pdata[k], "mesorig.kind", &kind, NULL);
    if (kind == NULL || method_find(kind) != NULL)
        return FALSE;
    g_set_error(error, GPU_ERROR, GPU_ERROR_FAILED,
                "%s is of the kind “%s”, for which there is no drawing method; give the directory "
                "of a session, or a file that “mesorig compress” made",
                path, kind);
    return TRUE;
}

gpointer method_open(const struct method *method, const char *path, GError **error) {
    if (method->product == NULL)
        return method->open(g_strcmp0(path, method->name) != 0 ? path : NULL, error);
    if (g_file_test(path, G_FILE_TEST_EXISTS)) {
        g_autoptr(GError) why = NULL;
        gpointer material = NULL;
        if (session_check_product(path, &why)) {
            material = method->open(path, &why);
            if (material == NULL && refuse_kind(path, error))
                return NULL;
        }
        if (why != NULL && strstr(why->message, path) == NULL)
            g_prefix_error(&why, "%s: ", path);
        if (why != NULL)
            g_propagate_error(error, g_steal_pointer(&why));
        return material;
    }
    g_autofree char *name = g_path_get_basename(path);
    if (g_str_equal(name, method->product))
        g_set_error(error, GPU_ERROR, GPU_ERROR_FAILED,
                    "there is no %s; “%s” makes it from a session", path, method->made_by);
    else
        g_set_error(error, GPU_ERROR, GPU_ERROR_FAILED,
                    "there is no %s; give the directory of a session, or a file that “%s” makes",
                    path, method->made_by);
    return NULL;
}
