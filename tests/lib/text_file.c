#include "text_file.h"
#include "ok.h"

char *text_file_read(const char *path) {
    char *text = NULL;
    ok(g_file_get_contents(path, &text, NULL, ERR));
    return text;
}

void text_file_write(const char *folder, const char *name, const char *text) {
    g_autofree char *path = g_build_filename(folder, name, NULL);
    ok(g_file_set_contents(path, text, -1, ERR));
}

void text_file_append(const char *folder, const char *name, const char *text) {
    g_autofree char *path = g_build_filename(folder, name, NULL), *before = text_file_read(path);
    g_autofree char *both = g_strconcat(before, "\n", text, NULL);
    text_file_write(folder, name, both);
}
