/* A list of folders and files in the window. Ctrl+O and Ctrl+S show it if the desktop has no file
 * dialog. */
#include "window_private.h"

#include <errno.h>
#include <gio/gio.h>
#include <string.h>

#define MAX_FILES 5000 /* largest number of rows */

struct files_row {
    /* `name` is the name of the file. `shown` is the text of its row, in UTF-8. */
    char *name, *shown;
    gboolean is_folder, is_session;
};

struct window_files {
    enum chooser_what what;
    char *folder;    /* absolute path of the listed folder */
    GPtrArray *rows; /* of struct files_row */
    char *problem;   /* problem of the folder, or NULL */
    /* text of the input line: an absolute path, or a path relative to the folder */
    char line[4096];
    gboolean focus;   /* the input line must take the keyboard in the next frame */
    gboolean entered; /* Enter was pressed */
};

static void files_row_free(gpointer data) {
    struct files_row *row = data;
    g_free(row->name);
    g_free(row->shown);
    g_free(row);
}

static int files_row_compare(gconstpointer a, gconstpointer b) {
    const struct files_row *first = *(struct files_row *const *)a;
    const struct files_row *second = *(struct files_row *const *)b;
    if (first->is_folder != second->is_folder)
        return second->is_folder - first->is_folder;
    g_autofree char *first_key = g_utf8_collate_key_for_filename(first->shown, -1);
    g_autofree char *second_key = g_utf8_collate_key_for_filename(second->shown, -1);
    return strcmp(first_key, second_key);
}

static void files_add(struct window_files *files, const char *name) {
    g_autofree char *path = g_build_filename(files->folder, name, NULL);
    const gboolean is_folder = g_file_test(path, G_FILE_TEST_IS_DIR);
    const gboolean is_session = is_folder && file_kind_is_session(path);
    if (name[0] == '.' || (!is_folder && !file_kind_is_shown(name)))
        return;
    struct files_row *row = g_new(struct files_row, 1);
    g_autofree char *shown = g_filename_display_name(name);
    *row = (struct files_row){
        g_strdup(name),
        g_strdup_printf("%s%s%s", shown, is_folder ? "/" : "", is_session ? "   session" : ""),
        is_folder, is_session};
    g_ptr_array_add(files->rows, row);
}

/* Enters a folder. Takes ownership of folder. */
static void files_enter(struct window_files *files, char *folder) {
    g_autoptr(GError) error = NULL;
    g_free(files->folder);
    g_free(files->problem);
    files->folder = folder;
    files->problem = NULL;
    g_ptr_array_set_size(files->rows, 0);
    g_autoptr(GDir) dir = g_dir_open(folder, 0, &error);
    if (dir == NULL) {
        files->problem = g_strdup(error->message);
        return;
    }
    for (const char *name; files->rows->len < MAX_FILES && (name = g_dir_read_name(dir)) != NULL;)
        files_add(files, name);
    if (files->rows->len == MAX_FILES)
        files->problem = g_strdup_printf(
            "Only the first %d files are listed; type the name of any other file.", MAX_FILES);
    g_ptr_array_sort(files->rows, files_row_compare);
}

void window_files_begin(struct window *w, enum chooser_what what, const char *folder,
                        const char *name) {
    window_files_clear(w);
    w->files = g_new0(struct window_files, 1);
    w->files->what = what;
    w->files->rows = g_ptr_array_new_with_free_func(files_row_free);
    w->files->focus = TRUE;
    g_strlcpy(w->files->line, name != NULL ? name : "", sizeof w->files->line);
    files_enter(w->files, g_strdup(folder));
}

void window_files_enter(struct window *w) {
    w->files->entered = TRUE;
}

void window_files_clear(struct window *w) {
    struct window_files *files = g_steal_pointer(&w->files);
    if (files == NULL)
        return;
    g_ptr_array_unref(files->rows);
    g_free(files->folder);
    g_free(files->problem);
    g_free(files);
}

/* Returns the absolute path of name. If name is relative, it is relative to the folder of the list.
 */
static char *files_path(const struct window_files *files, const char *name) {
    g_autofree char *local = g_filename_from_utf8(name, -1, NULL, NULL, NULL);
    return g_canonicalize_filename(local != NULL ? local : name, files->folder);
}

/* Acts on a chosen path: enters a folder, or saves or opens a file. When a file is to be opened, a
 * session is also opened, and not entered. */
static void files_take(struct window *w, const char *path) {
    struct window_files *files = w->files;
    const gboolean is_folder = g_file_test(path, G_FILE_TEST_IS_DIR);
    if (is_folder && (files->what == CHOOSER_SAVE || !file_kind_is_session(path))) {
        files_enter(files, g_strdup(path));
        files->line[0] = '\0';
        files->focus = TRUE;
    } else if (files->what == CHOOSER_SAVE) {
        g_autofree char *named =
            g_str_has_suffix(path, ".png") ? g_strdup(path) : g_strconcat(path, ".png", NULL);
        if (g_file_test(named, G_FILE_TEST_EXISTS)) {
            g_autofree char *why = g_strdup_printf("%s already exists; give another name.", named);
            window_say(w, why);
            files->focus = TRUE;
            return;
        }
        window_show_page(w, WINDOW_NO_PAGE);
        window_save_named(w, named, FALSE);
    } else {
        window_open(w, path); /* closes the dialog, or shows why it failed */
    }
}

static void files_draw_rows(struct window_files *files, char **ret_path) {
    ui_list_begin("files", 260.0F * ui_scale());
    if (ui_row("../   the folder above", FALSE))
        *ret_path = files_path(files, "..");
    for (guint k = 0; k < files->rows->len; k++) {
        const struct files_row *row = files->rows->pdata[k];
        if (!ui_row(row->shown, row->is_session))
            continue;
        g_free(*ret_path);
        *ret_path = g_build_filename(files->folder, row->name, NULL);
        if (files->what == CHOOSER_SAVE && !row->is_folder) { /* only copy its name to the line */
            g_strlcpy(files->line, row->shown, sizeof files->line);
            g_clear_pointer(ret_path, g_free);
        }
    }
    ui_list_end();
}

void window_files_draw(struct window *w, struct ui_box picture) {
    struct window_files *files = w->files;
    const gboolean save = files->what == CHOOSER_SAVE;
    g_autofree char *path = NULL, *shown = g_filename_display_name(files->folder);
    ui_dialog_begin(save ? "Save the picture" : "Open", picture, 520.0F * ui_scale());
    ui_text(shown);
    files_draw_rows(files, &path);
    if (files->problem != NULL)
        ui_note(files->problem);
    ui_text(save ? "Name of the picture:" : "Or type a path:");
    ui_line("path", files->line, sizeof files->line, files->focus);
    const gboolean entered = files->entered | ui_button(save ? "Save" : "Open");
    ui_same_line();
    const gboolean cancelled = ui_button("Cancel");
    ui_end_window();
    files->focus = files->entered = FALSE;
    if (entered && files->line[0] != '\0') {
        g_free(path);
        path = files_path(files, files->line);
    }
    if (cancelled)
        window_show_page(w, WINDOW_NO_PAGE);
    else if (path != NULL)
        files_take(w, path);
}
