#include "window_private.h"

#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>
#include <math.h>

const char window_help[] = "drag left       orbit\n"
                           "drag right      move the light\n"
                           "wheel           zoom\n"
                           "1 2 3 4 5       plane, torus, sphere, cylinder, torus knot\n"
                           "0               the shape it was started with\n"
                           "+ −             exposure\n"
                           "[ ]             fewer, more tiles\n"
                           "P               plain texture, to compare (eigen-maps)\n"
                           "O               outlines of the structure (silhouettes)\n"
                           "H               shadows that the shape casts\n"
                           "B               the environment behind the shape\n"
                           "M               the nearest measured frame, to compare\n"
                           "R               as it was at the start\n"
                           "S               screenshot\n"
                           "Tab             the panel on or off\n"
                           "F1              this help\n"
                           "Esc, Q          close\n";

void window_screenshot(struct window *w) {
    g_autoptr(GDateTime) now = g_date_time_new_now_local();
    g_autofree char *time = g_date_time_format(now, "%Y-%m-%d-%H%M%S");
    g_autofree char *path = g_strdup_printf("mesorig-%s-%d.png", time, ++w->n_screenshots);
    g_autoptr(GError) error = NULL;
    const gboolean good = window_save(w, path, &error);
    window_say(w, good ? NULL : error->message);
    if (good)
        g_print("%s\n", path);
}

/* The window of an event. What the event means to the panel shows in the next frames. */
static struct window *window_input_of(GLFWwindow *glfw) {
    struct window *w = glfwGetWindowUserPointer(glfw);
    w->frames_due = WINDOW_FRAMES;
    return w;
}

static void on_key(GLFWwindow *glfw, int key, int scancode, int action, int mods) {
    struct window *w = window_input_of(glfw);
    if (action == GLFW_RELEASE || ui_wants_keyboard())
        return;
    w->stale = TRUE;
    if (key >= GLFW_KEY_1 && key < GLFW_KEY_1 + SCENE_SHAPES)
        window_set_shape(w, scene_shape_names[key - GLFW_KEY_1], NULL);
    else if (key == GLFW_KEY_0)
        window_set_shape(w, w->options->shape, &w->options->settings);
    else if (key == GLFW_KEY_P && w->method == methods[0])
        w->settings.plain = !w->settings.plain;
    else if (key == GLFW_KEY_O)
        window_toggle_silhouettes(w);
    else if (key == GLFW_KEY_H)
        w->settings.shadows = !w->settings.shadows;
    else if (key == GLFW_KEY_B)
        window_toggle_backdrop(w);
    else if (key == GLFW_KEY_M && (w->show_measured = !w->show_measured))
        window_compare_measured(w);
    else if (key == GLFW_KEY_S)
        window_screenshot(w);
    else if (key == GLFW_KEY_TAB)
        w->panel = !w->panel;
    else if (key == GLFW_KEY_F1)
        w->help = !w->help;
    else if (key == GLFW_KEY_ESCAPE || key == GLFW_KEY_Q)
        glfwSetWindowShouldClose(glfw, GLFW_TRUE);
    else if (key == GLFW_KEY_R) {
        const struct viewer_settings before = w->settings;
        w->settings = w->options->settings;
        w->settings.tiles_u = before.tiles_u;
        w->settings.tiles_v = before.tiles_v;
        w->settings.silhouettes = before.silhouettes; /* whose file may not be there */
    }
}

/* By character, for + and [ are elsewhere on each keyboard. */
static void on_character(GLFWwindow *glfw, unsigned character) {
    struct window *w = window_input_of(glfw);
    double ev = character == '+' || character == '=' ? 0.25 : character == '-' ? -0.25 : 0.0;
    if (ui_wants_keyboard())
        return;
    w->settings.exposure_ev = CLAMP(w->settings.exposure_ev + ev, -20.0, 20.0);
    if (character == '[' || character == ']')
        window_scale_tiles(w, character == ']' ? 1.25 : 0.8);
    w->stale = TRUE;
}

static void on_move(GLFWwindow *glfw, double x, double y) {
    struct window *w = window_input_of(glfw);
    struct viewer_settings *s = &w->settings;
    double dx = x - w->x, dy = y - w->y;
    w->x = x;
    w->y = y;
    if (ui_wants_mouse())
        return;
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
    struct window *w = window_input_of(glfw);
    struct viewer_settings *s = &w->settings;
    if (ui_wants_mouse())
        return;
    if (s->camera_distance > 0.0) /* else nothing is drawn yet */
        s->camera_distance = CLAMP(s->camera_distance * pow(0.9, y), 0.05, 50.0);
    w->stale = TRUE;
}

static void window_input_on_stale(GLFWwindow *glfw) {
    window_input_of(glfw)->stale = TRUE;
}

static void on_button(GLFWwindow *glfw, int button, int action, int mods) {
    window_input_of(glfw);
}

static void on_entered(GLFWwindow *glfw, int entered) {
    window_input_of(glfw);
}

static void on_size(GLFWwindow *glfw, int width, int height) {
    window_input_on_stale(glfw);
}

void window_listen(struct window *w) {
    glfwSetWindowUserPointer(w->glfw, w);
    glfwSetKeyCallback(w->glfw, on_key);
    glfwSetCharCallback(w->glfw, on_character);
    glfwSetCursorPosCallback(w->glfw, on_move);
    glfwSetScrollCallback(w->glfw, on_wheel);
    glfwSetMouseButtonCallback(w->glfw, on_button);
    glfwSetCursorEnterCallback(w->glfw, on_entered);
    glfwSetWindowFocusCallback(w->glfw, on_entered);
    glfwSetFramebufferSizeCallback(w->glfw, on_size);
    glfwSetWindowRefreshCallback(w->glfw, window_input_on_stale);
    glfwGetCursorPos(w->glfw, &w->x, &w->y);
}
