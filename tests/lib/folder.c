#include "folder.h"
#include "ok.h"
#include "remove_tree.h"

char *folder;

void folder_make(void) {
    g_autofree char *program = g_path_get_basename(g_get_prgname());
    g_autofree char *template = g_strconcat(program, "-XXXXXX", NULL);
    folder = ok(g_dir_make_tmp(template, ERR));
}

void folder_remove(void) {
    remove_tree(folder);
    g_clear_pointer(&folder, g_free);
}

char *in_folder(const char *name) {
    return g_build_filename(folder, name, NULL);
}
