#include "window_user.h"
#include "lib/ok.h"
#include "lib/wait.h"

#include "remove_tree.h"
#include "skip.h"
#include "view_fixture.h"

#include <png.h>

static gboolean start(struct user *u, const char *const *options) {
    g_autoptr(GSubprocessLauncher) launcher =
        g_subprocess_launcher_new(G_SUBPROCESS_FLAGS_STDOUT_PIPE | G_SUBPROCESS_FLAGS_STDERR_PIPE);
    g_autoptr(GPtrArray) argv = g_ptr_array_new();
    g_ptr_array_add(argv, VIEWER);
    if (*u->session != '\0')
        g_ptr_array_add(argv, u->session);
    for (; options != NULL && *options != NULL; options++)
        g_ptr_array_add(argv, (gpointer)*options);
    g_ptr_array_add(argv, NULL);
    g_subprocess_launcher_set_cwd(launcher, u->folder);
    g_subprocess_launcher_setenv(launcher, "DISPLAY", x_display_name(u->x), TRUE);
    g_subprocess_launcher_setenv(launcher, "XDG_DATA_HOME", u->folder, TRUE);
    g_subprocess_launcher_setenv(launcher, "XDG_RUNTIME_DIR", u->folder, TRUE);
    g_subprocess_launcher_unsetenv(launcher, "WAYLAND_DISPLAY");
    g_subprocess_launcher_unsetenv(launcher, "DBUS_SESSION_BUS_ADDRESS");
    if (u->bus != NULL)
        g_subprocess_launcher_setenv(launcher, "DBUS_SESSION_BUS_ADDRESS", u->bus, TRUE);
    u->program = ok(g_subprocess_launcher_spawnv(launcher, (const char *const *)argv->pdata, ERR));
    u->says = g_data_input_stream_new(g_subprocess_get_stdout_pipe(u->program));
    return x_display_wait_window(u->x, 60.0);
}

gboolean user_sit_down(struct user *u, const char *session, const char *const *options) {
    return user_sit_down_on(u, NULL, NULL, session, options);
}

gboolean user_sit_down_on(struct user *u, const char *bus, const char *folder, const char *session,
                          const char *const *options) {
    *u = (struct user){.x = x_display_new(), .bus = bus};
    if (u->x == NULL || !g_file_test(VIEWER, G_FILE_TEST_IS_EXECUTABLE)) {
        x_display_free(u->x);
        if (session != NULL && *session != '\0')
            remove_tree(session);
        test_skip_or_fail("no Xvfb, or mesorig-view is not built");
        return FALSE;
    }
    u->folder = folder != NULL ? g_strdup(folder) : g_dir_make_tmp("mesorig-XXXXXX", NULL);
    u->keeps_folder = folder != NULL;
    u->session = session != NULL ? g_strdup(session) : view_fixture_write_session();
    g_assert_true(start(u, options));
    return TRUE;
}

char *user_stand_up(struct user *u, int code) {
    char *err = NULL;
    const gint64 from = g_get_monotonic_time();
    ok(g_subprocess_communicate_utf8(u->program, NULL, NULL, NULL, &err, ERR));
    g_test_message("%sclosed in %.2f s", err, (g_get_monotonic_time() - from) * 1e-6);
    g_assert_true(g_subprocess_get_if_exited(u->program));
    g_assert_cmpint(g_subprocess_get_exit_status(u->program), ==, code);
    g_assert_cmpint(g_get_monotonic_time() - from, <, WAIT_S * G_USEC_PER_SEC);
    if (!u->keeps_folder)
        remove_tree(u->folder);
    if (*u->session != '\0')
        remove_tree(u->session);
    g_object_unref(u->says);
    g_object_unref(u->program);
    x_display_free(u->x);
    g_free(u->folder);
    g_free(u->session);
    return err;
}

char *user_leave(struct user *u) {
    x_display_chord(u->x, NULL, "Control_L", "q");
    return user_stand_up(u, 0);
}

static GHashTable *read_texts(const char *path) {
    GHashTable *texts = g_hash_table_new_full(g_str_hash, g_str_equal, g_free, g_free);
    FILE *file = fopen(path, "rb");
    g_assert_nonnull(file);
    png_structp png = png_create_read_struct(PNG_LIBPNG_VER_STRING, NULL, NULL, NULL);
    png_infop info = png_create_info_struct(png);
    if (setjmp(png_jmpbuf(png)))
        g_error("%s is not a PNG", path);
    png_init_io(png, file);
    png_read_info(png, info);
    png_textp text = NULL;
    const int n = png_get_text(png, info, &text, NULL);
    for (int k = 0; k < n; k++)
        g_hash_table_insert(texts, g_strdup(text[k].key), g_strdup(text[k].text));
    png_destroy_read_struct(&png, &info, NULL);
    fclose(file);
    return texts;
}

static gboolean stop_waiting(gpointer deadline) {
    g_cancellable_cancel(deadline);
    return G_SOURCE_REMOVE;
}

static void keep_result(GObject *source, GAsyncResult *result, gpointer data) {
    *(GAsyncResult **)data = g_object_ref(result);
}

char *user_read_line(struct user *u) {
    g_autoptr(GError) error = NULL;
    g_autoptr(GCancellable) deadline = g_cancellable_new();
    const guint timer = g_timeout_add_seconds(60, stop_waiting, deadline);
    g_autoptr(GAsyncResult) result = NULL;
    g_data_input_stream_read_line_async(u->says, G_PRIORITY_DEFAULT, deadline, keep_result,
                                        &result);
    while (result == NULL)
        g_main_context_iteration(NULL, TRUE);
    char *line = g_data_input_stream_read_line_finish(u->says, result, NULL, &error);
    if (!g_cancellable_is_cancelled(deadline))
        g_source_remove(timer);
    g_assert_no_error(error);
    g_assert_nonnull(line);
    return line;
}

GHashTable *user_look(struct user *u) {
    x_display_key(u->x, "s");
    g_autofree char *path = user_read_line(u);
    return read_texts(path);
}

const char *user_said(GHashTable *texts, const char *name) {
    const char *text = g_hash_table_lookup(texts, name);
    g_assert_nonnull(text);
    return text;
}

void user_wait_for_title(struct user *u, const char *start_of_title) {
    g_autofree char *title = NULL;
    for (int k = 0; k < 1200; k++) {
        g_free(title);
        title = x_display_title(u->x);
        if (g_str_has_prefix(title, start_of_title))
            return;
        g_usleep(50000);
    }
    g_error("the title is not “%s…”, but “%s”", start_of_title, title);
}
