#include "beside.h"

#include <gio/gio.h>
#include <glib/gstdio.h>

#include "lib/ok.h"
#include "process.h"
#include "remove_tree.h"

#define IN_PATH "in-path" /* a folder in the program's own folder */

static const char *beside_folder(void) {
    static char *folder;
    if (!folder) {
        g_autofree char *self = g_file_read_link("/proc/self/exe", NULL);
        folder = g_path_get_dirname(self);
    }
    return folder;
}

char *beside_run(const char *test_path) {
    g_autofree char *made = ok(g_dir_make_tmp("mesorig-beside-XXXXXX", ERR));
    g_autofree char *self = g_file_read_link("/proc/self/exe", NULL);
    g_autofree char *copy = g_build_filename(made, "program", NULL);
    g_autofree char *empty = g_build_filename(made, IN_PATH, NULL);
    g_autofree char *path = g_strdup_printf("PATH=%s:%s", empty, g_getenv("PATH"));
    g_autoptr(GFile) from = g_file_new_for_path(self), to = g_file_new_for_path(copy);
    ok(g_file_copy(from, to, G_FILE_COPY_NONE, NULL, NULL, NULL, ERR));
    g_assert_cmpint(g_mkdir(empty, 0777), ==, 0);
    const char *const argv[] = {"env", path, copy, "-p", test_path, NULL};
    char *said = process_text(0, argv);
    g_test_message("%s", said);
    assert_has(said, test_path); /* the case was run */
    remove_tree(made);
    return said;
}

static void beside_write_to(const char *folder, const char *program, const char *head,
                            const char *text) {
    g_autofree char *path = g_build_filename(folder, program, NULL);
    g_unlink(path);
    if (!text)
        return;
    g_autofree char *all = g_strconcat(head, text, "\n", NULL);
    ok(g_file_set_contents_full(path, all, -1, G_FILE_SET_CONTENTS_NONE, 0755, ERR));
}

const char *beside_write(const char *program, const char *text) {
    beside_write_to(beside_folder(), program, "#!/bin/sh\n", text);
    return beside_folder();
}

void beside_write_in_path(const char *program, const char *text) {
    g_autofree char *folder = g_build_filename(beside_folder(), IN_PATH, NULL);
    beside_write_to(folder, program, "#!/bin/sh\n", text);
}

void beside_write_raw(const char *program, const char *text) {
    beside_write_to(beside_folder(), program, "", text);
}
