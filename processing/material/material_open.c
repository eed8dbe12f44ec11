#include "material_private.h"

#include "base/new_file.h"
#include "codecs/mdf_codecs/mdf_source.h"
#include "exr/exr.h"
#include "session/session.h"

#include <errno.h>
#include <gio/gio.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

static int material_status(const GError *error) {
    if (error->domain == G_FILE_ERROR || error->domain == G_IO_ERROR ||
        g_error_matches(error, EXR_ERROR, EXR_ERROR_IO))
        return MESORIG_ERROR_FILE;
    return g_error_matches(error, EXR_ERROR, EXR_ERROR_TOO_LARGE) ? MESORIG_ERROR_MEMORY
                                                                  : MESORIG_ERROR_FORMAT;
}

static void tell(struct mesorig_error *ret_error, int status, const char *text) {
    const char *end;
    if (!ret_error)
        return;
    ret_error->status = status;
    g_strlcpy(ret_error->text, text, sizeof ret_error->text);
    if (!g_utf8_validate(ret_error->text, -1, &end))
        ret_error->text[end - ret_error->text] = '\0';
}

static void tell_error(GError *error, struct mesorig_error *ret_error) {
    tell(ret_error, material_status(error), error->message);
    g_error_free(error);
}

/* Returns the path of the compressed material with the smallest error in a folder; g_free(). Files
 * with an unknown error are used only if no file has a known error. Returns NULL if there is no
 * compressed material. */
static char *best_of(const char *folder) {
    g_autoptr(GDir) dir = g_dir_open(folder, 0, NULL);
    char *best = NULL;
    double least = G_MAXDOUBLE;
    for (const char *name; dir && (name = g_dir_read_name(dir));) {
        g_autofree char *path = g_build_filename(folder, name, NULL);
        g_autoptr(ExrFile) file =
            g_str_has_suffix(name, ".exr") ? exr_read_headers(path, NULL) : NULL;
        const char *kind = NULL;
        double error = G_MAXDOUBLE;
        for (guint i = 0; file && !kind && i < file->parts->len; i++)
            if (exr_get_string(file->parts->pdata[i], "mesorig.kind", &kind, NULL))
                exr_get_double(file->parts->pdata[i], "mesorig.error", &error, NULL);
        if (!codecs_find(kind) ||
            (best && (error > least || (error == least && strcmp(path, best) > 0))))
            continue;
        g_free(best);
        best = g_steal_pointer(&path);
        least = error;
    }
    return best;
}

/* Returns the path that is opened for the directory of a session; g_free(). It is the folder of the
 * BTF if there is one, and otherwise the compressed material with the smallest error. Returns NULL
 * with an error if there is neither. */
static char *material_product(const char *directory, GError **error) {
    g_autofree char *products = g_build_filename(directory, "products", NULL);
    g_autofree char *session = btf_matrix_session(directory);
    g_autofree char *btf = g_build_filename(session, "products", "btf", NULL);
    if (g_file_test(btf, G_FILE_TEST_IS_DIR))
        return g_steal_pointer(&btf);
    char *best = best_of(products);
    if (!best)
        g_set_error(error, EXR_ERROR, EXR_ERROR_FORMAT,
                    "%s contains no material: give a session of which “mesorig process” has made a "
                    "BTF, or a file that “mesorig compress” wrote",
                    directory);
    return best;
}

/* Returns the path of the measured MDF of a session, or NULL if the session has none; g_free(). */
static char *mdf_of(const char *directory) {
    g_autofree char *session = btf_matrix_session(directory);
    g_autofree char *mdf = g_build_filename(session, "products", "mdf.exr", NULL);
    return g_file_test(mdf, G_FILE_TEST_EXISTS) ? g_steal_pointer(&mdf) : NULL;
}

static gboolean material_read(mesorig_material *m, const char *path, GError **error) {
    const gboolean folder = g_file_test(path, G_FILE_TEST_IS_DIR);
    m->codec = folder ? &material_btf_codec : codecs_of_file(path, error);
    if (!m->codec)
        return FALSE;
    if (!folder && m->codec->read_levels) {
        m->levels = m->codec->read_levels(path, error);
    } else {
        gpointer model = folder ? btf_matrix_read(path, NULL, error) : m->codec->read(path, error);
        if (model) {
            m->levels = g_ptr_array_new_with_free_func(m->codec->free);
            g_ptr_array_add(m->levels, model);
        }
    }
    if (!m->levels)
        return FALSE;
    gconstpointer model = m->levels->pdata[0];
    m->layout = G_STRUCT_MEMBER_P(model, m->codec->layout);
    m->error = folder ? 0 : m->codec->error ? G_STRUCT_MEMBER(double, model, m->codec->error) : -1;
    if (codec_tables_init(&m->tables, m->codec, model, error))
        return TRUE;
    g_prefix_error(error, "%s: ", path);
    return FALSE;
}

/* Makes a material from a file or from the folder of a BTF. mdf is a file, or NULL for no
 * relief. */
static mesorig_material *new_from(const char *path, const char *mdf, GError **error) {
    mesorig_material *m = g_new0(mesorig_material, 1);
    pthread_mutex_init(&m->sampling_lock, NULL);
    if (material_read(m, path, error) &&
        (!mdf || (mdf_source_fits(mdf, path, error) &&
                  (m->relief = material_relief_read(mdf, error)) != NULL)))
        return m;
    mesorig_material_close(m);
    return NULL;
}

mesorig_material *mesorig_material_open(const char *path, const char *mdf,
                                        struct mesorig_error *ret_error) {
    GError *error = NULL;
    if (!path) {
        tell(ret_error, MESORIG_ERROR_ARGUMENT, "path is NULL: give a file or a session");
        return NULL;
    }
    const gboolean folder = g_file_test(path, G_FILE_TEST_IS_DIR);
    g_autofree char *product = folder ? material_product(path, &error) : g_strdup(path);
    g_autofree char *relief = folder && !mdf ? mdf_of(path) : g_strdup(mdf);
    mesorig_material *m = product ? new_from(product, relief, &error) : NULL;
    if (error)
        tell_error(error, ret_error);
    return m;
}

/* Makes a file in memory for the readers. Returns its descriptor, or −1 with an error. */
static int file_of(const void *bytes, size_t n, GError **error) {
    const int fd = memfd_create("mesorig-material", MFD_CLOEXEC);
    if (fd >= 0 && new_file_write(fd, bytes, n))
        return fd;
    g_set_error(error, EXR_ERROR, EXR_ERROR_TOO_LARGE,
                "there is no memory for a copy of the %zu bytes of the file: %s; close other "
                "programs, or use a smaller file",
                n, g_strerror(errno));
    if (fd >= 0)
        close(fd);
    return -1;
}

/* Replaces the path by the name, which the caller knows, in the message of an error. */
static void material_rename(GError *error, const char *path, const char *name) {
    g_auto(GStrv) parts = g_strsplit(error->message, path, -1);
    g_free(error->message);
    error->message = g_strjoinv(name, parts);
}

mesorig_material *mesorig_material_open_memory(const void *material, size_t material_bytes,
                                               const void *mdf, size_t mdf_bytes,
                                               struct mesorig_error *ret_error) {
    GError *error = NULL;
    if (!material || material_bytes == 0 || (mdf && mdf_bytes == 0)) {
        tell(ret_error, MESORIG_ERROR_ARGUMENT,
             !material || material_bytes == 0 ? "there are no bytes of a material: give the bytes "
                                                "of a file that “mesorig compress” wrote"
                                              : "there are no bytes of the MDF: give the bytes of "
                                                "an mdf.exr, or NULL for no relief");
        return NULL;
    }
    mesorig_material *m = NULL;
    const int fd = file_of(material, material_bytes, &error);
    const int mdf_fd = fd >= 0 && mdf ? file_of(mdf, mdf_bytes, &error) : -1;
    g_autofree char *path = g_strdup_printf("/proc/self/fd/%d", fd);
    g_autofree char *mdf_path = mdf_fd >= 0 ? g_strdup_printf("/proc/self/fd/%d", mdf_fd) : NULL;
    if (!error)
        m = new_from(path, mdf_path, &error);
    if (error) {
        if (mdf_path)
            material_rename(error, mdf_path, "the MDF in memory");
        material_rename(error, path, "the material in memory");
        tell_error(error, ret_error);
    }
    if (fd >= 0)
        close(fd);
    if (mdf_fd >= 0)
        close(mdf_fd);
    return m;
}

void mesorig_material_close(mesorig_material *m) {
    if (!m)
        return;
    if (m->sampling_free)
        m->sampling_free(m->sampling);
    pthread_mutex_destroy(&m->sampling_lock);
    material_relief_free(m->relief);
    codec_tables_clear(&m->tables);
    if (m->levels)
        g_ptr_array_unref(m->levels);
    g_free(m);
}

int mesorig_material_info(const mesorig_material *m, struct mesorig_material_info *info) {
    if (!m || !info || info->size < sizeof info->size || info->size > 4096)
        return MESORIG_ERROR_ARGUMENT;
    const struct mesorig_material_info all = {
        .size = info->size,
        .kind = m->codec->name,
        .width = (int)m->layout->width,
        .height = (int)m->layout->height,
        .n_views = (int)m->layout->views.n,
        .n_lights = (int)m->layout->lights.n,
        .texel_mm = m->layout->texel_mm,
        .deepest_mm = m->relief ? material_relief_deepest_mm(m->relief) : 0,
        .has_relief = m->relief != NULL,
        .error = m->error,
    };
    memset(info, 0, info->size);
    memcpy(info, &all, MIN(all.size, sizeof all));
    return MESORIG_OK;
}

int mesorig_material_directions(const mesorig_material *m, float *ret_views, float *ret_lights) {
    if (!m)
        return MESORIG_ERROR_ARGUMENT;
    const struct direction_list *const lists[] = {&m->layout->views, &m->layout->lights};
    float *const ret[] = {ret_views, ret_lights};
    for (gsize i = 0; i < G_N_ELEMENTS(lists); i++) {
        g_autofree float *vectors = ret[i] ? direction_list_vectors(lists[i]) : NULL;
        if (vectors)
            memcpy(ret[i], vectors, sizeof(float) * 3 * lists[i]->n);
    }
    return MESORIG_OK;
}
