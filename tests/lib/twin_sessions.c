#include "twin_sessions.h"

char *twin_folder;

char *twin_path(const char *name) {
    return g_build_filename(twin_folder, name, NULL);
}

struct difference twin_compare(const char *a, const char *b, const char *folder, gboolean holes) {
    struct difference difference;
    g_autofree char *in_a = twin_path(a), *in_b = twin_path(b);
    g_autoptr(GError) error = NULL;
    difference_folder(in_a, in_b, folder, holes, &difference, &error);
    g_assert_no_error(error);
    g_assert_cmpint(difference.n_files, >, 0);
    g_assert_cmpint(difference.n_values, >, 0);
    g_test_message("%s and %s, %s: RMS %.5f, mean %+.5f, seen differently %.4f", a, b, folder,
                   difference.rms, difference.systematic, difference.seen_differently);
    return difference;
}

double twin_value(const char *name, const char *key) {
    g_autofree char *path = twin_path(name);
    g_autoptr(GError) error = NULL;
    g_autoptr(Session) session = session_open(path, SESSION_READ, &error);
    g_assert_no_error(error);
    g_autofree char *text = session_value(session, key);
    g_assert_nonnull(text);
    return g_ascii_strtod(text, NULL);
}
