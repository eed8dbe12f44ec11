#include "window_private.h"

#include <epoxy/gl.h>
#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>
#include <math.h>

#define MIN_PICTURE                                                                                \
    64 /* minimum width of the picture in pixels; the panel is hidden if less would be left */

/* Returns the width in framebuffer pixels of the panel, which is at the left of the window. Returns
 * 0 if the panel is folded or hidden. */
static int panel_pixels(const struct window *w) {
    int width, height, pixels, unused;
    glfwGetWindowSize(w->glfw, &width, &height);
    glfwGetFramebufferSize(w->glfw, &pixels, &unused);
    if (!w->panel || width < 1)
        return 0;
    const int panel = (int)lroundf(WINDOW_PANEL * ui_scale() * (float)pixels / (float)width);
    return panel + MIN_PICTURE <= pixels ? panel : 0;
}

gboolean window_has_panel(const struct window *w) {
    return panel_pixels(w) > 0;
}

void window_paint(struct window *w) {
    const int width = w->scene.width, height = w->scene.height, left = panel_pixels(w);
    int across, down;
    glfwGetWindowSize(w->glfw, &across, &down);
    glBindFramebuffer(GL_READ_FRAMEBUFFER, w->scene.framebuffer);
    glBindFramebuffer(GL_DRAW_FRAMEBUFFER, 0);
    glClearColor(0.06F, 0.06F, 0.06F, 1.0F);
    glClear(GL_COLOR_BUFFER_BIT);
    glBlitFramebuffer(0, 0, width, height, left, 0, left + width, height, GL_COLOR_BUFFER_BIT,
                      GL_NEAREST);
    glBindFramebuffer(GL_FRAMEBUFFER, 0);
    glViewport(0, 0, left + width, height);
    const float panel = left > 0 ? WINDOW_PANEL * ui_scale() : 0.0F;
    ui_begin(w->ui);
    window_draw_panel(w, (struct ui_box){0.0F, 0.0F, panel, (float)down});
    window_draw_pages(w, (struct ui_box){panel, 0.0F, (float)across - panel, (float)down});
    ui_end(w->ui);
}

static void on_glfw_error(int code, const char *text) {
    g_debug("GLFW %d: %s", code, text);
}

/* Opens the window. GLFW stays initialised until the process ends, as EGL's display does. */
static GLFWwindow *open_window(const struct viewer_options *options, GError **error) {
    const char *text = NULL;
    if (!gpu_find_library(TRUE, error))
        return NULL;
    glfwSetErrorCallback(on_glfw_error);
    if (!glfwInit()) {
        glfwGetError(&text);
        g_set_error(error, GPU_ERROR, GPU_ERROR_NONE,
                    "no window can be opened here (%s); --render FILE.png needs no display",
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
    glfwWindowHintString(GLFW_X11_CLASS_NAME, "org.mesorig.View"); /* the desktop file's name */
    glfwWindowHintString(GLFW_X11_INSTANCE_NAME, "mesorig-view");
    GLFWwindow *glfw =
        glfwCreateWindow(options->width, options->height, "mesorig-view", NULL, NULL);
    if (glfw == NULL) {
        glfwGetError(&text);
        g_set_error(
            error, GPU_ERROR, GPU_ERROR_NONE,
            "no window with OpenGL 3.3 can be opened (%s); update the graphics driver, let Mesa "
            "draw without the card (LIBGL_ALWAYS_SOFTWARE=1), or try --render FILE.png",
            text != NULL ? text : "unknown reason");
        return NULL;
    }
    glfwMakeContextCurrent(glfw);
    gpu_watch();
    glfwSwapInterval(options->close_after > 0 ? 0 : 1);
    return glfw;
}

/* Computes the histogram of a picture. Each count is divided by the largest count. The histogram
 * shows the square roots of these quotients, so that small counts stay visible. */
static void count_levels(struct window *w, const guint8 *rgb) {
    const gsize n = 3 * (gsize)w->scene.width * w->scene.height;
    guint counts[3 * WINDOW_BINS] = {0}, most = 1;
    for (gsize k = 0; k < n; k++)
        counts[k % 3 * WINDOW_BINS + rgb[k] * WINDOW_BINS / 256]++;
    for (gsize k = 0; k < G_N_ELEMENTS(counts); k++)
        most = MAX(most, counts[k]);
    for (gsize k = 0; k < G_N_ELEMENTS(counts); k++)
        w->histogram[k] = sqrtf((float)counts[k] / (float)most);
}

/* Sets the camera's distance. The distance is fitted to a shape only once, so that the shape keeps
 * its size while the user turns it. The aspect of the picture changes with the size of the panel
 * and of the window. The distance is then multiplied by the factor by which the distance of a
 * fitted camera would change. */
static void fit(struct window *w, double aspect) {
    struct viewer_settings *s = &w->now.settings;
    if (s->camera_distance == 0.0) {
        viewer_fit(w->viewer, s, aspect);
    } else if (w->aspect > 0.0 && w->aspect != aspect) {
        struct viewer_settings before = *s, after = *s;
        before.camera_distance = after.camera_distance = 0.0;
        viewer_fit(w->viewer, &before, w->aspect);
        viewer_fit(w->viewer, &after, aspect);
        s->camera_distance *= after.camera_distance / before.camera_distance;
    }
    w->aspect = aspect;
}

static gboolean draw_scene(struct window *w, int width, int height, struct window_result *ret,
                           GError **error) {
    const gint64 start = g_get_monotonic_time();
    fit(w, (double)width / height);
    if (!gpu_target_resize(&w->scene, width, height, GL_RGBA8, FALSE, error) ||
        !compose_draw(w->compose, w->viewer, w->second, &w->now.compose, &w->now.settings,
                      w->scene.framebuffer, width, height, error))
        return FALSE;
    viewer_finish();
    w->frame_ms = (double)(g_get_monotonic_time() - start) * 1e-3;
    ret->seconds += w->frame_ms * 1e-3;
    ret->n_frames++;
    g_autofree guint8 *rgb = w->panel ? gpu_target_read(&w->scene, error) : NULL;
    if (rgb != NULL)
        count_levels(w, rgb);
    w->stale = FALSE;
    return rgb != NULL || !w->panel;
}

/* Sets the title only when it changes. Setting it causes an event, which would wake the loop for
 * another frame. */
static void set_title(struct window *w) {
    g_autofree char *name = g_path_get_basename(w->material);
    g_autofree char *shape = g_path_get_basename(w->now.shape); /* a path if the shape is a file */
    g_autofree char *session =
        w->now.argument != NULL ? g_path_get_basename(w->now.argument) : NULL;
    const gboolean other = session != NULL && !g_str_equal(session, name);
    g_autofree char *title = g_strdup_printf("%s on %s – %s%sMesorig", name, shape,
                                             other ? session : "", other ? " – " : "");
    if (g_strcmp0(title, w->title) == 0)
        return;
    glfwSetWindowTitle(w->glfw, title);
    g_free(w->title);
    w->title = g_steal_pointer(&title);
}

/* Draws the panel after every event, and the picture only when it has changed. */
static gboolean draw_frame(struct window *w, struct window_result *ret, GError **error) {
    int width, height;
    glfwGetFramebufferSize(w->glfw, &width, &height);
    width -= panel_pixels(w);
    if (width < 1 || height < 1) { /* the window has no size yet; on_size() reports one */
        w->stale = FALSE;
        w->frames_due = 0;
        return TRUE;
    }
    if ((w->stale || w->now.close_after > 0 || w->scene.width != width ||
         w->scene.height != height) &&
        !draw_scene(w, width, height, ret, error))
        return FALSE;
    window_paint(w);
    glfwSwapBuffers(w->glfw);
    w->frames_due = MAX(w->frames_due - 1, 0);
    set_title(w);
    return gpu_check("the window", error);
}

/* Returns whether a frame must be drawn. An idle window draws nothing. A window draws while a file
 * is opened, to show the progress, and while a text field shows its cursor. */
static gboolean must_draw(const struct window *w) {
    return w->stale || w->frames_due > 0 || w->now.close_after > 0 || opener_is_busy(w->opener) ||
           ui_wants_keyboard();
}

static gboolean loop(struct window *w, struct window_result *ret, GError **error) {
    int close_after = w->now.close_after;
    while (!glfwWindowShouldClose(w->glfw) && (close_after == 0 || ret->n_frames < close_after)) {
        if (close_after > 0 || w->stale || w->frames_due > 0)
            glfwPollEvents();
        else
            glfwWaitEventsTimeout(0.25);
        window_follow(w);
        window_follow_chooser(w);
        if (!window_take_opened(w, error))
            return FALSE;
        if (close_after > 0 && !w->first_open) /* frames of the demonstration do not count */
            glfwWaitEventsTimeout(0.05);
        else if (must_draw(w) && !draw_frame(w, ret, error))
            return FALSE;
    }
    return w->now.screenshot == NULL || window_save(w, w->now.screenshot, w->now.force, error);
}

/* Opens the requested shape. If it cannot be opened, opens the default shape and shows the reason.
 * If close_after is set, fails instead. */
static gboolean set_first_shape(struct window *w, GError **error) {
    window_set_shape(w, w->now.shape, &w->now.settings);
    if (w->mesh != NULL)
        return TRUE;
    g_autofree char *why = g_steal_pointer(&w->message);
    if (w->now.close_after == 0) {
        w->own_shape = scene_shape_names[1];
        window_set_shape(w, w->own_shape, &w->now.settings);
        window_tell(w, why);
        w->is_error = TRUE;
    }
    if (w->mesh == NULL)
        g_set_error(error, SCENE_ERROR, SCENE_ERROR_NO_SHAPE, "%s", why);
    return w->mesh != NULL;
}

static gboolean do_run(struct window *w, struct window_result *ret, GError **error) {
    w->viewer = viewer_new(NULL, error);
    w->compose = w->viewer != NULL ? compose_new(error) : NULL;
    if (w->compose == NULL)
        return FALSE;
    ret->renderer = g_strdup(gpu_renderer());
    if (!set_first_shape(w, error))
        return FALSE;
    w->outlines = w->now.settings.silhouettes;
    w->now.settings.silhouettes = FALSE;
    /* Shows a demonstration immediately, without the panel, because reading the material may take
     * seconds. */
    w->now.method = method_find(METHOD_DEMO);
    w->material = g_strdup(METHOD_DEMO);
    /* The picture is shown without the environment until the environment is open. */
    if (w->start->environment != NULL) {
        w->now.environment = NULL;
        w->now.settings.backdrop = FALSE;
        viewer_options_default_light(&w->now.settings, FALSE);
    }
    w->now.compose.mode = COMPOSE_ONE; /* one picture until the second material is open */
    w->now.second = NULL;
    if (!viewer_open(w->viewer, w->now.method, NULL, error) || !draw_frame(w, ret, error))
        return FALSE;
    ret->first_seconds = (double)(g_get_monotonic_time() - w->start->started_us) / G_USEC_PER_SEC;
    ret->n_frames = 0;
    ret->seconds = 0.0;
    w->panel = w->stale = TRUE;
    if ((w->opener = opener_new(w->glfw, error)) == NULL)
        return FALSE;
    window_open_first(w);
    const gboolean good = loop(w, ret, error);
    ret->memory = viewer_memory(w->viewer);
    return good;
}

gboolean window_run(const struct viewer_options *options, struct window_result *ret,
                    GError **error) {
    struct window w = {.start = options,
                       .now = *options,
                       .own_shape = options->shape,
                       .n_lamps = options->settings.n_lamps,
                       .stale = TRUE};
    *ret = (struct window_result){0};
    w.glfw = open_window(options, error);
    if (w.glfw == NULL)
        return FALSE;
    w.texts = g_string_chunk_new(256);
    w.chooser = chooser_new();
    window_listen(&w);
    w.ui = ui_new(w.glfw);
    const gboolean good = do_run(&w, ret, error);
    window_clear_sources(&w);
    window_files_clear(&w);
    chooser_free(w.chooser);
    compose_free(w.compose);
    gpu_target_clear(&w.scene);
    g_free(w.title);
    ui_free(w.ui);
    glfwDestroyWindow(w.glfw);
    g_string_chunk_free(w.texts);
    return good;
}
