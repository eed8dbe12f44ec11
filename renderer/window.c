#include "window.h"

#include "gpu.h"
#include "picture.h"

#include <epoxy/gl.h>
#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>
#include <glib/gstdio.h>
#include <math.h>

static const char help[] = "drag left       orbit\n"
                           "drag right      move the light\n"
                           "wheel           zoom\n"
                           "1 2 3 4 5       plane, torus, sphere, cylinder, torus knot\n"
                           "0               the shape it was started with\n"
                           "+ −             exposure\n"
                           "[ ]             fewer, more tiles\n"
                           "P               plain texture, to compare\n"
                           "O               outlines of the structure (silhouettes)\n"
                           "H               shadows that the shape casts\n"
                           "R               as it was at the start\n"
                           "S               screenshot\n"
                           "F1              this help\n"
                           "Esc, Q          close\n";

struct window {
    GLFWwindow *glfw;
    const struct window_options *options;
    View *view;
    struct view_settings settings;
    const char *shape;
    double tiles_u, tiles_v;
    double x, y;    /* of the mouse */
    gboolean stale; /* must be drawn again */
    GError *error;  /* of a callback; ends the loop */
    gint64 file_time, mdf_time, looked_us;
    int n_screenshots;
};

static void set_title(struct window *w) {
    g_autofree char *name = g_path_get_basename(w->options->material);
    g_autofree char *title = g_strdup_printf("%s on %s – light %.0f°, %.0f° – %+.1f EV – F1: help",
                                             name, w->shape, w->settings.light_theta_deg,
                                             w->settings.light_phi_deg, w->settings.exposure_ev);
    glfwSetWindowTitle(w->glfw, title);
}

/* tiles: of which tiles_u and tiles_v are taken; NULL: as the shape has it. */
static void set_shape(struct window *w, const char *shape, const struct view_settings *tiles) {
    g_autoptr(GError) error = NULL;
    struct scene_options scene = {.up = w->options->up, .floor = w->options->floor};
    if (tiles != NULL) {
        scene.tiles_u = tiles->tiles_u;
        scene.tiles_v = tiles->tiles_v;
    }
    struct mesh *mesh = scene_make(shape, &scene, &error);
    if (mesh != NULL && view_set_mesh(w->view, mesh, &error)) {
        w->shape = shape;
        w->tiles_u = mesh->tiles_u;
        w->tiles_v = mesh->tiles_v;
        w->settings.tiles_u = w->settings.tiles_v = 0.0;
        w->settings.camera_distance = w->options->settings.camera_distance;
        w->stale = TRUE;
    } else if (w->error == NULL) {
        w->error = g_steal_pointer(&error);
    }
    mesh_free(mesh);
}

static void scale_tiles(struct window *w, double factor) {
    double u = w->settings.tiles_u > 0.0 ? w->settings.tiles_u : w->tiles_u;
    double v = w->settings.tiles_v > 0.0 ? w->settings.tiles_v : w->tiles_v;
    w->settings.tiles_u = CLAMP(u * factor, 0.01, 500.0);
    w->settings.tiles_v = CLAMP(v * factor, 0.01, 500.0);
}

static gboolean save(struct window *w, const char *path, GError **error) {
    int width, height;
    glfwGetFramebufferSize(w->glfw, &width, &height);
    struct view_settings settings = w->settings;
    settings.samples = MAX(settings.samples, 3);
    g_autofree guint8 *rgb = view_render(w->view, &settings, width, height, error);
    const char *texts[] = {"Software", "mesorig-view " MESORIG_VERSION,
                           "Material", w->options->material,
                           "Shape",    w->shape,
                           NULL};
    return rgb != NULL && picture_write_png(path, rgb, width, height, texts, error);
}

static gint64 time_of(const char *path) {
    GStatBuf info;
    return g_stat(path, &info) == 0
               ? info.st_mtim.tv_sec * G_USEC_PER_SEC + info.st_mtim.tv_nsec / 1000
               : -1;
}

/* Unless it is open already and has not changed since. */
static gboolean open_mdf(struct window *w, GError **error) {
    gint64 changed = time_of(w->options->mdf);
    if (changed >= 0 && changed == w->mdf_time)
        return TRUE;
    if (!view_open_mdf(w->view, w->options->mdf, error))
        return FALSE;
    w->mdf_time = changed;
    return TRUE;
}

static void screenshot(struct window *w) {
    g_autoptr(GDateTime) now = g_date_time_new_now_local();
    g_autofree char *time = g_date_time_format(now, "%Y-%m-%d-%H%M%S");
    g_autofree char *path = g_strdup_printf("mesorig-%s-%d.png", time, ++w->n_screenshots);
    g_autoptr(GError) error = NULL;
    if (save(w, path, &error))
        g_print("%s\n", path);
    else
        g_printerr("mesorig-view: %s\n", error->message);
}

static void toggle_silhouettes(struct window *w) {
    g_autoptr(GError) error = NULL;
    if (!w->settings.silhouettes && !open_mdf(w, &error))
        g_printerr("mesorig-view: %s\n", error->message);
    else
        w->settings.silhouettes = !w->settings.silhouettes;
}

static void on_key(GLFWwindow *glfw, int key, int scancode, int action, int mods) {
    static const char *const names[] = {"plane", "torus", "sphere", "cylinder", "torus-knot"};
    struct window *w = glfwGetWindowUserPointer(glfw);
    if (action == GLFW_RELEASE)
        return;
    w->stale = TRUE;
    if (key >= GLFW_KEY_1 && key <= GLFW_KEY_5)
        set_shape(w, names[key - GLFW_KEY_1], NULL);
    else if (key == GLFW_KEY_0)
        set_shape(w, w->options->shape, &w->options->settings);
    else if (key == GLFW_KEY_P)
        w->settings.plain = !w->settings.plain;
    else if (key == GLFW_KEY_O)
        toggle_silhouettes(w);
    else if (key == GLFW_KEY_H)
        w->settings.shadows = !w->settings.shadows;
    else if (key == GLFW_KEY_R)
        w->settings = w->options->settings;
    else if (key == GLFW_KEY_S)
        screenshot(w);
    else if (key == GLFW_KEY_F1)
        g_print("%s", help);
    else if (key == GLFW_KEY_ESCAPE || key == GLFW_KEY_Q)
        glfwSetWindowShouldClose(glfw, GLFW_TRUE);
}

/* By character, for + and [ are elsewhere on each keyboard. */
static void on_character(GLFWwindow *glfw, unsigned character) {
    struct window *w = glfwGetWindowUserPointer(glfw);
    double ev = character == '+' || character == '=' ? 0.25 : character == '-' ? -0.25 : 0.0;
    w->settings.exposure_ev = CLAMP(w->settings.exposure_ev + ev, -20.0, 20.0);
    if (character == '[' || character == ']')
        scale_tiles(w, character == ']' ? 1.25 : 0.8);
    w->stale = TRUE;
}

static void on_move(GLFWwindow *glfw, double x, double y) {
    struct window *w = glfwGetWindowUserPointer(glfw);
    struct view_settings *s = &w->settings;
    double dx = x - w->x, dy = y - w->y;
    w->x = x;
    w->y = y;
    if (glfwGetMouseButton(glfw, GLFW_MOUSE_BUTTON_LEFT) == GLFW_PRESS) {
        s->camera_azimuth_deg = fmod(s->camera_azimuth_deg - 0.4 * dx, 360.0);
        s->camera_elevation_deg = CLAMP(s->camera_elevation_deg + 0.4 * dy, -90.0, 90.0);
    } else if (glfwGetMouseButton(glfw, GLFW_MOUSE_BUTTON_RIGHT) == GLFW_PRESS) {
        s->light_phi_deg = fmod(s->light_phi_deg + 0.4 * dx, 360.0);
        s->light_theta_deg = CLAMP(s->light_theta_deg + 0.4 * dy, 0.0, 180.0);
    } else {
        return;
    }
    w->stale = TRUE;
}

static void on_wheel(GLFWwindow *glfw, double x, double y) {
    struct window *w = glfwGetWindowUserPointer(glfw);
    struct view_settings *s = &w->settings;
    if (s->camera_distance > 0.0) /* else nothing is drawn yet */
        s->camera_distance = CLAMP(s->camera_distance * pow(0.9, y), 0.05, 50.0);
    w->stale = TRUE;
}

static void on_stale(GLFWwindow *glfw) {
    struct window *w = glfwGetWindowUserPointer(glfw);
    w->stale = TRUE;
}

static void on_glfw_error(int code, const char *text) {
    g_debug("GLFW %d: %s", code, text);
}

static void set_callbacks(GLFWwindow *glfw, struct window *w) {
    glfwSetWindowUserPointer(glfw, w);
    glfwSetKeyCallback(glfw, on_key);
    glfwSetCharCallback(glfw, on_character);
    glfwSetCursorPosCallback(glfw, on_move);
    glfwSetScrollCallback(glfw, on_wheel);
    glfwSetWindowRefreshCallback(glfw, on_stale);
    glfwGetCursorPos(glfw, &w->x, &w->y);
}

/* GLFW, like EGL's display, stays initialised as long as the process lives. */
static GLFWwindow *open_window(const struct window_options *options, GError **error) {
    const char *text = NULL;
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
                    "no window with OpenGL 3.3 can be opened (%s); try --render FILE.png",
                    text != NULL ? text : "unknown reason");
        return NULL;
    }
    glfwMakeContextCurrent(glfw);
    gpu_watch();
    glfwSwapInterval(options->close_after > 0 ? 0 : 1);
    return glfw;
}

/* Processing replaces the file as a whole, so what is there can be read at once. */
static void follow_material(struct window *w) {
    gint64 now = g_get_monotonic_time();
    if (now - w->looked_us < G_USEC_PER_SEC)
        return;
    w->looked_us = now;
    g_autoptr(GError) error = NULL;
    if (w->mdf_time > 0 && time_of(w->options->mdf) != w->mdf_time) {
        if (!open_mdf(w, &error))
            g_printerr("mesorig-view: %s\n", error->message);
        g_clear_error(&error);
        w->stale = TRUE;
    }
    gint64 changed = time_of(w->options->material);
    if (changed == w->file_time || changed < 0)
        return;
    w->file_time = changed;
    if (!view_open(w->view, w->options->method, w->options->material, &error))
        g_printerr("mesorig-view: %s\n", error->message);
    w->stale = TRUE;
}

static gboolean draw_frame(struct window *w, struct window_result *ret, GError **error) {
    int width, height;
    glfwGetFramebufferSize(w->glfw, &width, &height);
    if (width < 1 || height < 1)
        return TRUE;
    /* Once a shape, so that it keeps its size while the user turns it. */
    view_fit(w->view, &w->settings, (double)width / height);
    gint64 start = g_get_monotonic_time();
    if (!view_draw(w->view, &w->settings, 0, width, height, error))
        return FALSE;
    view_finish();
    ret->seconds += (g_get_monotonic_time() - start) * 1e-6;
    ret->n_frames++;
    glfwSwapBuffers(w->glfw);
    set_title(w);
    return TRUE;
}

static gboolean loop(struct window *w, struct window_result *ret, GError **error) {
    int close_after = w->options->close_after;
    while (!glfwWindowShouldClose(w->glfw) && (close_after == 0 || ret->n_frames < close_after)) {
        if (close_after > 0)
            glfwPollEvents();
        else
            glfwWaitEventsTimeout(0.25);
        follow_material(w);
        if (w->error != NULL) {
            g_propagate_error(error, g_steal_pointer(&w->error));
            return FALSE;
        }
        if (!w->stale && close_after == 0)
            continue;
        w->stale = FALSE;
        if (!draw_frame(w, ret, error))
            return FALSE;
    }
    return w->options->screenshot == NULL || save(w, w->options->screenshot, error);
}

static gboolean run(struct window *w, struct window_result *ret, GError **error) {
    w->file_time = time_of(w->options->material);
    w->view = view_new(NULL, error);
    if (w->view == NULL || !view_open(w->view, w->options->method, w->options->material, error) ||
        (w->settings.silhouettes && !open_mdf(w, error)))
        return FALSE;
    ret->renderer = g_strdup(gpu_renderer());
    set_shape(w, w->options->shape, &w->options->settings);
    return loop(w, ret, error);
}

gboolean window_run(const struct window_options *options, struct window_result *ret,
                    GError **error) {
    struct window w = {.options = options, .settings = options->settings, .stale = TRUE};
    gboolean good = FALSE;
    *ret = (struct window_result){0};
    w.shape = options->shape;
    w.glfw = open_window(options, error);
    if (w.glfw != NULL) {
        set_callbacks(w.glfw, &w);
        good = run(&w, ret, error);
        view_free(w.view);
        glfwDestroyWindow(w.glfw);
    }
    g_clear_error(&w.error);
    return good;
}
