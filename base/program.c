#include "program.h"

#include <locale.h>

void program_set_locale(void) {
    setlocale(LC_CTYPE, "");
    setlocale(LC_COLLATE, "");
}

/* Looks next to this executable and in ../libexec/mesorig relative to it. Returns NULL if it is in
 * neither. */
static char *find_beside(const char *name, GFileTest test) {
    static const char *const places[] = {"", "../libexec/mesorig"};
    g_autofree char *self = g_file_read_link("/proc/self/exe", NULL);
    g_autofree char *folder = self ? g_path_get_dirname(self) : NULL;
    for (gsize i = 0; folder && i < G_N_ELEMENTS(places); i++) {
        char *path = g_build_filename(folder, places[i], name, NULL);
        if (g_file_test(path, test))
            return path;
        g_free(path);
    }
    return NULL;
}

char *program_find(const char *name, GError **error) {
    char *found = find_beside(name, G_FILE_TEST_IS_EXECUTABLE);
    if (!found)
        found = g_find_program_in_path(name);
    if (!found)
        g_set_error(error, G_FILE_ERROR, G_FILE_ERROR_NOENT,
                    "%s is neither in the folder of this program nor in PATH: install it", name);
    return found;
}

char *program_find_module(const char *name, GError **error) {
    char *found = find_beside(name, G_FILE_TEST_IS_REGULAR);
    if (!found)
        g_set_error(error, G_FILE_ERROR, G_FILE_ERROR_NOENT,
                    "%s is neither in the folder of this program nor in ../libexec/mesorig "
                    "relative to it: install it",
                    name);
    return found;
}
