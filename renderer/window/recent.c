#include "recent.h"

#include <gio/gio.h>

#define APPLICATION "mesorig-view"

static char *recent_path(void) {
    return g_build_filename(g_get_user_data_dir(), "recently-used.xbel", NULL);
}

/* Reads the list. If there is no file, the list is empty. Returns NULL if the file cannot be read.
 */
static GBookmarkFile *load(void) {
    g_autofree char *path = recent_path();
    g_autoptr(GError) error = NULL;
    GBookmarkFile *list = g_bookmark_file_new();
    if (g_bookmark_file_load_from_file(list, path, &error) ||
        g_error_matches(error, G_FILE_ERROR, G_FILE_ERROR_NOENT))
        return list;
    g_bookmark_file_free(list);
    return NULL;
}

struct recent {
    char *path;
    gint64 time_us;
};

static void clear(gpointer data) {
    g_free(((struct recent *)data)->path);
}

static int compare(gconstpointer a, gconstpointer b) {
    const struct recent *first = a, *second = b;
    return (first->time_us < second->time_us) - (first->time_us > second->time_us);
}

GPtrArray *recent_list(void) {
    GPtrArray *paths = g_ptr_array_new_with_free_func(g_free);
    GBookmarkFile *list = load();
    g_autoptr(GArray) found = g_array_new(FALSE, FALSE, sizeof(struct recent));
    g_array_set_clear_func(found, clear);
    g_auto(GStrv) uris = list != NULL ? g_bookmark_file_get_uris(list, NULL) : NULL;
    for (gsize k = 0; uris != NULL && uris[k] != NULL; k++) {
        GDateTime *opened = NULL;
        char *path = g_filename_from_uri(uris[k], NULL, NULL);
        if (path != NULL && g_file_test(path, G_FILE_TEST_EXISTS) &&
            g_bookmark_file_get_application_info(list, uris[k], APPLICATION, NULL, NULL, &opened,
                                                 NULL)) {
            const struct recent recent = {g_steal_pointer(&path),
                                          g_date_time_to_unix(opened) * G_USEC_PER_SEC +
                                              g_date_time_get_microsecond(opened)};
            g_array_append_val(found, recent);
        }
        g_clear_pointer(&path, g_free);
    }
    g_array_sort(found, compare);
    for (guint k = 0; k < MIN(found->len, RECENT_MAX); k++)
        g_ptr_array_add(paths, g_strdup(g_array_index(found, struct recent, k).path));
    g_clear_pointer(&list, g_bookmark_file_free);
    return paths;
}

void recent_add(const char *path) {
    g_autofree char *whole = g_canonicalize_filename(path, NULL), *file = recent_path();
    g_autofree char *uri = g_filename_to_uri(whole, NULL, NULL), *folder = g_path_get_dirname(file);
    GBookmarkFile *list = uri != NULL ? load() : NULL;
    if (list == NULL)
        return;
    g_autoptr(GDateTime) now = g_date_time_new_now_utc();
    g_bookmark_file_set_mime_type(list, uri,
                                  g_file_test(whole, G_FILE_TEST_IS_DIR) ? "inode/directory"
                                  : g_str_has_suffix(whole, ".exr")      ? "image/x-exr"
                                                                    : "application/octet-stream");
    if (!g_bookmark_file_set_application_info(list, uri, APPLICATION, "mesorig-view %f", -1, now,
                                              NULL))
        g_bookmark_file_add_application(list, uri, APPLICATION, "mesorig-view %f");
    g_mkdir_with_parents(folder, 0700);
    g_bookmark_file_to_file(list, file, NULL);
    g_bookmark_file_free(list);
}
