/* Sessions that were captured by different drivers, in one folder: how far they are from each
 * other, and what they say of themselves. */
#pragma once

#include "session/session.h"
#include "session_difference.h"

static char *top; /* the folder */

static char *in_top(const char *name) {
    return g_build_filename(top, name, NULL);
}

static struct difference compare(const char *a, const char *b, const char *folder, gboolean holes) {
    struct difference difference;
    g_autofree char *in_a = in_top(a), *in_b = in_top(b);
    g_autoptr(GError) error = NULL;
    difference_folder(in_a, in_b, folder, holes, &difference, &error);
    g_assert_no_error(error);
    g_assert_cmpint(difference.n_files, >, 0);
    g_assert_cmpint(difference.n_values, >, 0);
    g_test_message("%s and %s, %s: RMS %.5f, mean %+.5f, seen differently %.4f", a, b, folder,
                   difference.rms, difference.systematic, difference.seen_differently);
    return difference;
}

static double value(const char *name, const char *key) {
    g_autofree char *path = in_top(name);
    g_autoptr(GError) error = NULL;
    g_autoptr(Session) session = session_open(path, SESSION_READ, &error);
    g_assert_no_error(error);
    g_autofree char *text = session_value(session, key);
    g_assert_nonnull(text);
    return g_ascii_strtod(text, NULL);
}
