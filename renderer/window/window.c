#include "window_private.h"

#include "scene/picture.h"
#include "series.h"
#include "snapshot.h"

#include <epoxy/gl.h>
#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>
#include <math.h>

/* The picture and the panel over it, into the window's back buffer. */
static void paint(struct window *w) {
    const int width = w->scene.width, height = w->scene.height;
    glBindFramebuffer(GL_READ_FRAMEBUFFER, w->scene.framebuffer);
    glBindFramebuffer(GL_DRAW_FRAMEBUFFER, 0);
    glBlitFramebuffer(0, 0, width, height, 0, 0, width, height, GL_COLOR_BUFFER_BIT, GL_NEAREST);
    glBindFramebuffer(GL_FRAMEBUFFER, 0);
    glViewport(0, 0, width, height);
    ui_begin(w->ui);
    window_panel(w);
    ui_end(w->ui);
}

gboolean window_save(struct window *w, const char *path, GError **error) {
    const gboolean capturing = w->live != NULL && w->planned != NULL;
    struct gpu_target window = {0};
    glfwGetFramebufferSize(w->glfw, &window.width, &window.height);
    struct viewer_settings settings = w->settings;
    g_autofree guint8 *rgb = NULL;
    if (w->options->with_panel) {
        paint(w);
        rgb = gpu_target_read(&window, error);
    } else {
        settings.samples = MAX(settings.samples, 3);
        rgb = compose_render(w->compose, w->viewer, w->second, &w->how, &settings, window.width,
                             window.height, error);
    }
    const struct snapshot snapshot = {
        .material = w->material,
        .shape = w->shape,
        .first = w->method,
        .n_views = capturing ? series_count(w->planned) : 0,
        .n_planned = capturing ? (int)w->planned->len : 0,
        .second = w->how.mode != COMPOSE_ONE ? w->second_method : NULL,
        .how = &w->how,
        .settings = &settings,
        .options = w->options,
    };
    return rgb != NULL &&
           snapshot_write(path, &snapshot, rgb, NULL, window.width, window.height, error);
}

static void on_glfw_error(int code, const char *text) {
    g_debug("GLFW %d: %s", code, text);
}

/* GLFW, like EGL's display, stays initialised as long as the process lives. */
static GLFWwindow *open_window(const struct viewer_options *options, GError **error) {
    const char *text = NULL;
    if (!gpu_find_library(TRUE, error))
        return NULL;
    glfwSetErrorCallback(on_glfw_error);
    if (!glfwInit()) {
        glfwGetError(&text);
        g_set_error(
            error, GPU_ERROR, GPU_ERROR_NONE,
            "no window can be opened here (%s); with --render FILE.png no display is needed",
            text != NULL ? text : "no display");
        return NULL;
    }
    glfwWindowHint(GLFW_CONTEXT_VERSION_MAJOR, 3);
    glfwWindowHint(GLFW_CONTEXT_VERSION_MINOR, 3);
    glfwWindowHint(GLFW_OPENGL_PROFILE, GLFW_OPENGL_CORE_PROFILE);
    glfwWindowHint(GLFW_OPENGL_FORWARD_COMPAT, GLFW_TRUE);
#ifdef GPU_DEBUG
    glfwWindowHint(GLFW_OPENGL_DEBUG_CONTEXT, GLFW_TRUE);
#endif
    GLFWwindow *glfw =
        glfwCreateWindow(options->width, options->height, "mesorig-view", NULL, NULL);
    if (glfw == NULL) {
        glfwGetError(&text);
        g_set_error(error, GPU_ERROR, GPU_ERROR_NONE,
                    "no window with OpenGL 3.3 can be opened (%s); renew the graphics driver, let "
                    "Mesa draw without the card (LIBGL_ALWAYS_SOFTWARE=1), or try --render "
                    "FILE.png",
                    text != NULL ? text : "unknown reason");
        return NULL;
    }
    glfwMakeContextCurrent(glfw);
    gpu_watch();
    glfwSwapInterval(options->close_after > 0 ? 0 : 1);
    return glfw;
}

/* Bins relative to the fullest one, as square roots, so that small bins stay visible. */
static void window_count_levels(struct window *w, const guint8 *rgb) {
    const gsize n = 3 * (gsize)w->scene.width * w->scene.height;
    guint counts[3 * WINDOW_BINS] = {0}, most = 1;
    for (gsize k = 0; k < n; k++)
        counts[k % 3 * WINDOW_BINS + rgb[k] * WINDOW_BINS / 256]++;
    for (gsize k = 0; k < G_N_ELEMENTS(counts); k++)
        most = MAX(most, counts[k]);
    for (gsize k = 0; k < G_N_ELEMENTS(counts); k++)
        w->histogram[k] = sqrtf((float)counts[k] / (float)most);
}

static gboolean window_draw_scene(struct window *w, int width, int height,
                                  struct window_result *ret, GError **error) {
    const gint64 start = g_get_monotonic_time();
    /* Once a shape, so that it keeps its size while the user turns it. */
    viewer_fit(w->viewer, &w->settings, (double)width / height);
    if (!gpu_target_resize(&w->scene, width, height, GL_RGBA8, FALSE, error) ||
        !compose_draw(w->compose, w->viewer, w->second, &w->how, &w->settings, w->scene.framebuffer,
                      width, height, error))
        return FALSE;
    viewer_finish();
    w->frame_ms = (double)(g_get_monotonic_time() - start) * 1e-3;
    ret->seconds += w->frame_ms * 1e-3;
    ret->n_frames++;
    g_autofree guint8 *rgb = w->panel ? gpu_target_read(&w->scene, error) : NULL;
    if (rgb != NULL)
        window_count_levels(w, rgb);
    w->stale = FALSE;
    return rgb != NULL || !w->panel;
}

/* Only when it changes: to set a title is an event, which would wake the loop for the next frame.
 */
static void window_set_title(struct window *w) {
    g_autofree char *name = g_path_get_basename(w->material);
    g_autofree char *shape = g_path_get_basename(w->shape); /* may be a file */
    g_autofree char *title = g_strdup_printf("%s on %s – light %.0f°, %.0f° – %+.1f EV – F1: help",
                                             name, shape, w->settings.light_theta_deg,
                                             w->settings.light_phi_deg, w->settings.exposure_ev);
    if (g_strcmp0(title, w->title) == 0)
        return;
    glfwSetWindowTitle(w->glfw, title);
    g_free(w->title);
    w->title = g_steal_pointer(&title);
}

/* The panel is drawn again after every event, the picture behind it when it has changed. */
static gboolean window_draw_frame(struct window *w, struct window_result *ret, GError **error) {
    int width, height;
    glfwGetFramebufferSize(w->glfw, &width, &height);
    if (width < 1 || height < 1) { /* until on_size() */
        w->stale = FALSE;
        w->frames_due = 0;
        return TRUE;
    }
    if ((w->stale || w->options->close_after > 0 || w->scene.width != width ||
         w->scene.height != height) &&
        !window_draw_scene(w, width, height, ret, error))
        return FALSE;
    paint(w);
    glfwSwapBuffers(w->glfw);
    w->frames_due = MAX(w->frames_due - 1, 0);
    window_set_title(w);
    return gpu_check("the window", error);
}

/* An idle window draws nothing. What is being opened shows its progress, a text field its cursor.
 */
static gboolean window_must_draw(const struct window *w) {
    return w->stale || w->frames_due > 0 || w->options->close_after > 0 ||
           opener_is_busy(w->opener) || ui_wants_keyboard();
}

static gboolean window_loop(struct window *w, struct window_result *ret, GError **error) {
    int close_after = w->options->close_after;
    while (!glfwWindowShouldClose(w->glfw) && (close_after == 0 || ret->n_frames < close_after)) {
        if (close_after > 0 || w->stale || w->frames_due > 0)
            glfwPollEvents();
        else
            glfwWaitEventsTimeout(0.25);
        window_follow(w);
        if (!window_take_opened(w, error))
            return FALSE;
        if (close_after > 0 && !w->first_open) /* frames of the demonstration do not count */
            glfwWaitEventsTimeout(0.05);
        else if (window_must_draw(w) && !window_draw_frame(w, ret, error))
            return FALSE;
    }
    return w->options->screenshot == NULL || window_save(w, w->options->screenshot, error);
}

static gboolean window_do_run(struct window *w, struct window_result *ret, GError **error) {
    w->viewer = viewer_new(NULL, error);
    w->compose = w->viewer != NULL ? compose_new(error) : NULL;
    if (w->compose == NULL || !window_set_environment(w, w->viewer, error))
        return FALSE;
    ret->renderer = g_strdup(gpu_renderer());
    window_set_shape(w, w->options->shape, &w->options->settings);
    if (w->mesh == NULL) {
        g_set_error(error, SCENE_ERROR, SCENE_ERROR_NO_SHAPE, "%s", w->message);
        return FALSE;
    }
    w->outlines = w->settings.silhouettes;
    w->settings.silhouettes = FALSE;
    /* A demonstration at once, without the panel: reading the material may take seconds. */
    w->method = method_find(METHOD_DEMO);
    w->material = g_strdup(METHOD_DEMO);
    w->panel = FALSE;
    if (!viewer_open(w->viewer, w->method, NULL, error) || !window_draw_frame(w, ret, error))
        return FALSE;
    ret->first_seconds = (double)(g_get_monotonic_time() - w->options->started_us) / G_USEC_PER_SEC;
    ret->n_frames = 0;
    ret->seconds = 0.0;
    w->panel = w->stale = TRUE;
    if ((w->opener = opener_new(w->glfw, error)) == NULL)
        return FALSE;
    w->how = w->options->compose;
    w->how.mode = COMPOSE_ONE; /* until there is a second */
    window_open_first(w);
    const gboolean good = window_loop(w, ret, error);
    ret->memory = viewer_memory(w->viewer);
    return good;
}

gboolean window_run(const struct viewer_options *options, const struct environment *environment,
                    struct window_result *ret, GError **error) {
    struct window w = {.options = options,
                       .environment = environment,
                       .settings = options->settings,
                       .how = {.mode = COMPOSE_ONE},
                       .stale = TRUE};
    *ret = (struct window_result){0};
    w.glfw = open_window(options, error);
    if (w.glfw == NULL)
        return FALSE;
    window_listen(&w);
    w.ui = ui_new(w.glfw);
    const gboolean good = window_do_run(&w, ret, error);
    window_clear_sources(&w);
    compose_free(w.compose);
    gpu_target_clear(&w.scene);
    g_free(w.title);
    ui_free(w.ui);
    glfwDestroyWindow(w.glfw);
    return good;
}
