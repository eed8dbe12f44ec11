#include "program.h"

char *program_find(const char *name, GError **error) {
    static const char *const places[] = {"", "../libexec/mesorig"};
    g_autofree char *self = g_file_read_link("/proc/self/exe", NULL);
    g_autofree char *folder = self ? g_path_get_dirname(self) : NULL;
    for (gsize i = 0; folder && i < G_N_ELEMENTS(places); i++) {
        char *path = g_build_filename(folder, places[i], name, NULL);
        if (g_file_test(path, G_FILE_TEST_IS_EXECUTABLE))
            return path;
        g_free(path);
    }
    char *found = g_find_program_in_path(name);
    if (!found)
        g_set_error(error, G_FILE_ERROR, G_FILE_ERROR_NOENT,
                    "%s is neither beside this program nor in PATH: install it", name);
    return found;
}
