/* A rig file and a session file that were exchanged, and files for which this cannot be recognised.
 */
#include <glib/gstdio.h>
#include <string.h>

#include "lib/remove_tree.h"
#include "lib/test.h"
#include "plan/plan.h"

static char *folder;

static char *write_as(const char *name, const char *text) {
    char *path = g_build_filename(folder, name, NULL);
    g_assert_true(g_file_set_contents(path, text, -1, NULL));
    return path;
}

TEST(exchanged) {
    g_autofree char *rig = write_as("rig.conf", "[rig]\nname = r\n");
    g_autofree char *session = write_as("session.conf", "[session]\nname = s\n");
    g_autofree char *both = write_as("both.conf", "[rig]\nname = r\n[session]\nname = s\n");
    g_autofree char *neither = write_as("neither.conf", "[sample]\nwidth_mm = 5\n");
    g_autofree char *broken = write_as("broken.conf", "[rig\n= 5\n");
    g_autofree char *missing = g_build_filename(folder, "missing.conf", NULL);
    const struct {
        const char *first, *second, *told[2]; /* told NULL: it is accepted */
    } cases[] = {
        {rig, session, {NULL}},
        {session,
         rig,
         {"session.conf is a session file", "rig.conf is a rig file: give RIG before"}},
        {session, session, {"session.conf is a session file: give RIG before SESSION", ""}},
        {rig, rig, {"rig.conf is a rig file: give RIG before SESSION, a file with", ""}},
        {session, neither, {"session.conf is a session file: give RIG before SESSION", ""}},
        {neither, rig, {"rig.conf is a rig file", ""}},
        /* Other mistakes in the files are reported by the functions that need the files. */
        {both, both, {NULL}},
        {neither, neither, {NULL}},
        {broken, session, {NULL}},
        {missing, missing, {NULL}},
        {missing, session, {NULL}},
    };
    for (gsize i = 0; i < G_N_ELEMENTS(cases); i++) {
        g_autoptr(GError) error = NULL;
        const gboolean ok = plan_check_order(cases[i].first, cases[i].second, &error);
        g_assert_cmpint(ok, ==, cases[i].told[0] == NULL);
        g_assert_true(ok == (error == NULL));
        for (int k = 0; !ok && k < 2; k++)
            g_assert_nonnull(strstr(error->message, cases[i].told[k]));
    }
}

BEFORE_TESTS {
    folder = g_dir_make_tmp("mesorig-order-XXXXXX", NULL);
}

AFTER_TESTS {
    remove_tree(folder);
    g_free(folder);
}
