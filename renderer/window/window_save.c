#include "window_private.h"

#include "series.h"
#include "snapshot.h"

#include "base/output_file.h"
#include "scene/picture.h"

#define GLFW_INCLUDE_NONE
#include <gio/gio.h>
#include <GLFW/glfw3.h>
#include <string.h>
#include <unistd.h>

/* minimum number of samples of a pixel of a saved picture, in each direction */
#define SAMPLES 3

gboolean window_save(struct window *w, const char *path, gboolean force, GError **error) {
    g_autoptr(OutputFile) to = output_file_new(path, PICTURE_KIND, force, error);
    if (to == NULL)
        return FALSE;
    const gboolean capturing = w->live != NULL && w->planned != NULL;
    struct gpu_target window = {.width = w->scene.width, .height = w->scene.height};
    struct viewer_settings settings = w->now.settings;
    g_autofree guint8 *rgb = NULL;
    if (w->now.with_panel) {
        glfwGetFramebufferSize(w->glfw, &window.width, &window.height);
        window_paint(w);
        rgb = gpu_target_read(&window, error);
    } else {
        settings.samples = MAX(settings.samples, SAMPLES);
        rgb = compose_render(w->compose, w->viewer, w->second, &w->now.compose, &settings,
                             window.width, window.height, error);
    }
    const struct snapshot snapshot = {
        .material = w->material,
        .shape = w->now.shape,
        .first = w->now.method,
        .n_views = capturing ? series_count(w->planned) : 0,
        .n_planned = capturing ? (int)w->planned->len : 0,
        .second = w->now.compose.mode != COMPOSE_ONE ? w->now.second : NULL,
        .how = &w->now.compose,
        .settings = &settings,
        .options = &w->now,
    };
    const char *written = rgb != NULL ? output_file_path(to, error) : NULL;
    return written != NULL && output_file_end(to,
                                              snapshot_write(written, &snapshot, rgb, NULL,
                                                             window.width, window.height, error),
                                              error);
}

void window_save_named(struct window *w, const char *path, gboolean force) {
    g_autoptr(GError) error = NULL;
    g_autofree char *whole = g_canonicalize_filename(path, NULL);
    g_autofree char *sentence = g_strdup_printf("The picture is in %s.", whole);
    if (!window_save(w, whole, force, &error)) {
        window_say(w, error->message);
        return;
    }
    window_tell(w, sentence);
    g_print("%s\n", whole);
}

/* Returns the folder for pictures. Usually this is the current directory. If the current directory
 * cannot be written to, or is the user's home, it is the user's folder of pictures. (A program that
 * the desktop has started runs in the home.) If there is no folder of pictures that can be written
 * to, it is the current directory after all. */
static char *picture_folder(void) {
    g_autofree char *current = g_get_current_dir();
    const char *pictures = g_get_user_special_dir(G_USER_DIRECTORY_PICTURES);
    const gboolean is_home = g_str_equal(current, g_get_home_dir());
    if ((is_home || access(current, W_OK) != 0) && pictures != NULL && access(pictures, W_OK) == 0)
        return g_strdup(pictures);
    return g_steal_pointer(&current);
}

/* Returns the first of the names NAME-001.png, NAME-002.png and so on that does not exist in the
 * folder for pictures. Sets *ret_folder to this folder. Free both with g_free(). */
char *window_picture_name(const struct window *w, char **ret_folder) {
    g_autofree char *base =
        g_path_get_basename(w->now.argument != NULL ? w->now.argument : w->material);
    char *dot = strrchr(base, '.');
    if (dot != NULL && dot > base)
        *dot = '\0';
    *ret_folder = picture_folder();
    for (int k = 1;; k++) {
        g_autofree char *name = g_strdup_printf("%s-%03d.png", base, k);
        g_autofree char *path = g_build_filename(*ret_folder, name, NULL);
        if (!g_file_test(path, G_FILE_TEST_EXISTS))
            return g_steal_pointer(&name);
    }
}

void window_screenshot(struct window *w) {
    g_autofree char *folder = NULL, *name = window_picture_name(w, &folder);
    g_autofree char *path = g_build_filename(folder, name, NULL);
    window_save_named(w, path, FALSE);
}

void window_copy_command(struct window *w) {
    const struct settings_picture picture = {.width = w->scene.width,
                                             .height = w->scene.height,
                                             .samples = MAX(w->now.settings.samples, SAMPLES),
                                             .n_lamps = w->n_lamps,
                                             .live = w->live != NULL && w->n_live > 0};
    g_autofree char *command = settings_command(&w->now, &picture);
    glfwSetClipboardString(w->glfw, command);
    g_print("%s\n", command);
    window_tell(w, "The command that draws this picture is in the clipboard.");
}
