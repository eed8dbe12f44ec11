#include "window_private.h"

#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>
#include <math.h>
#include <string.h>

const struct window_key window_keys[] = {
    {"drag left", "turn the shape"},
    {"drag right", "move the chosen lamp, or turn the environment"},
    {"Shift + drag left", "move the shape"},
    {"wheel", "zoom"},
    {"Ctrl+O", "open a session, a material, a shape or an environment"},
    {"drop", "files and folders on the window: the same"},
    {"S", "save the picture under the next free name"},
    {"Ctrl+S", "save the picture under a name"},
    {"Ctrl+C", "copy the command that draws the picture"},
    {"1 2 3 4 5", "plane, torus, sphere, cylinder, torus knot"},
    {"0", "the shape that was opened last"},
    {"+ −", "exposure"},
    {"[ ]", "fewer, more tiles"},
    {"L  Del", "a further lamp; remove the chosen one"},
    {"E", "the next environment"},
    {"B", "the environment behind the shape, or the ground"},
    {"P", "plain texture, to compare (eigen-maps)"},
    {"O", "outlines of the structure (silhouettes)"},
    {"H", "shadows that the shape casts"},
    {"M", "the nearest measured frame, to compare"},
    {"R", "as it was at the start"},
    {"Tab", "fold or unfold the panel"},
    {"F11", "full screen"},
    {"F1  ?", "these keys"},
    {"Esc", "close a dialog or a message, or leave the full screen"},
    {"Ctrl+Q", "quit"},
    {NULL, NULL},
};

/* Returns the window for which an event came. The next frames are drawn, because the event may
 * change the panel. */
static struct window *window_input_of(GLFWwindow *glfw) {
    struct window *w = glfwGetWindowUserPointer(glfw);
    w->frames_due = WINDOW_FRAMES;
    return w;
}

/* Called when a key or button is pressed. Removes a message that is not an error, because the user
 * has then read it. */
static void pressed(struct window *w) {
    if (w->message != NULL && !w->is_error)
        window_tell(w, NULL);
}

/* Returns the monitor that shows most of the window. */
static GLFWmonitor *monitor_of(GLFWwindow *glfw) {
    int n = 0, x, y, width, height, most = -1;
    GLFWmonitor **monitors = glfwGetMonitors(&n), *found = NULL;
    glfwGetWindowPos(glfw, &x, &y);
    glfwGetWindowSize(glfw, &width, &height);
    for (int k = 0; k < n; k++) {
        int left, top;
        const GLFWvidmode *mode = glfwGetVideoMode(monitors[k]);
        glfwGetMonitorPos(monitors[k], &left, &top);
        if (mode == NULL)
            continue;
        const int across = MIN(x + width, left + mode->width) - MAX(x, left);
        const int down = MIN(y + height, top + mode->height) - MAX(y, top);
        const int shared = MAX(across, 0) * MAX(down, 0);
        if (shared > most) {
            most = shared;
            found = monitors[k];
        }
    }
    return found;
}

static void toggle_full_screen(struct window *w) {
    int *before = w->before_full_screen;
    GLFWmonitor *monitor = monitor_of(w->glfw);
    w->stale = TRUE;
    if (glfwGetWindowMonitor(w->glfw) != NULL) {
        glfwSetWindowMonitor(w->glfw, NULL, before[0], before[1], before[2], before[3], 0);
        return;
    }
    if (monitor == NULL) {
        window_say(w, "No monitor was found, so the window cannot fill one.");
        return;
    }
    const GLFWvidmode *mode = glfwGetVideoMode(monitor);
    glfwGetWindowPos(w->glfw, &before[0], &before[1]);
    glfwGetWindowSize(w->glfw, &before[2], &before[3]);
    glfwSetWindowMonitor(w->glfw, monitor, 0, 0, mode->width, mode->height, mode->refreshRate);
}

/* Handles Esc: closes a dialog or a message, or leaves the full screen. Never closes the window. */
static void escape(struct window *w) {
    if (w->page != WINDOW_NO_PAGE)
        window_show_page(w, WINDOW_NO_PAGE);
    else if (chooser_is_open(w->chooser))
        chooser_close(w->chooser);
    else if (w->message != NULL)
        window_tell(w, NULL);
    else if (glfwGetWindowMonitor(w->glfw) != NULL)
        toggle_full_screen(w);
}

static void next_environment(struct window *w) {
    int k = 0;
    while (w->now.environment != NULL && environment_names[k] != NULL &&
           !g_str_equal(environment_names[k], w->now.environment))
        k++;
    if (w->now.environment != NULL && environment_names[k] != NULL)
        k++;
    if (environment_names[k] != NULL)
        window_ask_environment(w, environment_names[k]);
    else
        window_set_environment(w, NULL, NULL);
}

static void reset(struct window *w) {
    const struct viewer_settings before = w->now.settings;
    struct viewer_settings *s = &w->now.settings;
    *s = w->start->settings;
    s->tiles_u = before.tiles_u;
    s->tiles_v = before.tiles_v;
    s->silhouettes = before.silhouettes; /* the file of the MDF may not exist */
    s->backdrop = before.backdrop;       /* the environment may have changed since */
    if ((w->environment != NULL) != (w->start->environment != NULL))
        viewer_options_default_light(s, w->environment != NULL);
    w->n_lamps = w->start->settings.n_lamps;
    window_relight(w);
}

/* Handles keys with Ctrl. A key is identified by the letter that is printed on it, so that the
 * keyboards of all countries work. */
static void on_chord(struct window *w, int key, int scancode, int mods) {
    const char *name = glfwGetKeyName(key, scancode);
    const char letter = name != NULL && name[1] == '\0' ? g_ascii_tolower(name[0]) : '\0';
    if (letter == 'q' || letter == 'w')
        glfwSetWindowShouldClose(w->glfw, GLFW_TRUE);
    else if (ui_wants_keyboard() || w->page == WINDOW_FILES)
        return; /* a line of text handles copy and paste itself */
    else if (letter == 'o')
        window_ask_file(w, mods & GLFW_MOD_SHIFT ? CHOOSER_FOLDER : CHOOSER_FILE);
    else if (letter == 's')
        window_ask_file(w, CHOOSER_SAVE);
    else if (letter == 'c')
        window_copy_command(w);
}

static void on_key(GLFWwindow *glfw, int key, int scancode, int action, int mods) {
    struct window *w = window_input_of(glfw);
    if (action == GLFW_RELEASE)
        return;
    pressed(w);
    if (key == GLFW_KEY_ESCAPE)
        escape(w);
    else if (key == GLFW_KEY_F11)
        toggle_full_screen(w);
    else if (key == GLFW_KEY_F1)
        window_show_page(w, w->page == WINDOW_KEYS ? WINDOW_NO_PAGE : WINDOW_KEYS);
    else if (w->page == WINDOW_FILES && (key == GLFW_KEY_ENTER || key == GLFW_KEY_KP_ENTER))
        window_files_enter(w);
    if (mods & GLFW_MOD_CONTROL) {
        on_chord(w, key, scancode, mods);
        return;
    }
    if (ui_wants_keyboard() || w->page == WINDOW_FILES)
        return;
    w->stale = TRUE;
    if (w->page == WINDOW_START && key >= GLFW_KEY_1 && key < GLFW_KEY_1 + (int)w->recent->len) {
        g_autofree char *path = g_strdup(w->recent->pdata[key - GLFW_KEY_1]);
        window_open(w, path);
    } else if (key >= GLFW_KEY_1 && key < GLFW_KEY_1 + SCENE_SHAPES)
        window_set_shape(w, scene_shape_names[key - GLFW_KEY_1], NULL);
    else if (key == GLFW_KEY_0)
        window_set_shape(w, w->own_shape,
                         w->own_shape == w->start->shape ? &w->start->settings : NULL);
    else if (key == GLFW_KEY_DELETE)
        window_remove_lamp(w);
    else if (key == GLFW_KEY_TAB)
        w->panel = !w->panel;
}

/* Handles keys that give a character. A key is identified by its character, because keyboard
 * layouts place letters and signs differently. */
static void on_character(GLFWwindow *glfw, unsigned character) {
    struct window *w = window_input_of(glfw);
    struct viewer_settings *s = &w->now.settings;
    if (ui_wants_keyboard() || w->page == WINDOW_FILES)
        return;
    w->stale = TRUE;
    switch (g_unichar_tolower(character)) {
    case '+':
    case '=':
        s->exposure_ev = CLAMP(s->exposure_ev + 0.25, -20.0, 20.0);
        break;
    case '-':
        s->exposure_ev = CLAMP(s->exposure_ev - 0.25, -20.0, 20.0);
        break;
    case '[':
        window_scale_tiles(w, 0.8);
        break;
    case ']':
        window_scale_tiles(w, 1.25);
        break;
    case '?':
        window_show_page(w, w->page == WINDOW_KEYS ? WINDOW_NO_PAGE : WINDOW_KEYS);
        break;
    case 'b':
        window_toggle_backdrop(w);
        break;
    case 'e':
        next_environment(w);
        break;
    case 'h':
        s->shadows = !s->shadows;
        break;
    case 'l':
        window_add_lamp(w);
        break;
    case 'm':
        if ((w->show_measured = !w->show_measured))
            window_compare_measured(w);
        break;
    case 'o':
        window_toggle_silhouettes(w);
        break;
    case 'p':
        s->plain = w->now.method == methods[0] && !s->plain;
        break;
    case 'r':
        reset(w);
        break;
    case 's':
        window_screenshot(w);
        break;
    default:
        break;
    }
}

static void on_move(GLFWwindow *glfw, double x, double y) {
    struct window *w = window_input_of(glfw);
    struct viewer_settings *s = &w->now.settings;
    double dx = x - w->x, dy = y - w->y;
    w->x = x;
    w->y = y;
    if (ui_wants_mouse())
        return;
    const gboolean shift = glfwGetKey(glfw, GLFW_KEY_LEFT_SHIFT) == GLFW_PRESS ||
                           glfwGetKey(glfw, GLFW_KEY_RIGHT_SHIFT) == GLFW_PRESS;
    const gboolean left = glfwGetMouseButton(glfw, GLFW_MOUSE_BUTTON_LEFT) == GLFW_PRESS;
    if ((left && shift) || glfwGetMouseButton(glfw, GLFW_MOUSE_BUTTON_MIDDLE) == GLFW_PRESS) {
        /* Size of a pixel at the distance of the point that the camera looks at, in radii of the
         * mesh. */
        int width, height;
        glfwGetWindowSize(glfw, &width, &height);
        if (window_has_panel(w))
            width -= (int)(WINDOW_PANEL * ui_scale());
        const double pixel = 2.0 * s->camera_distance * tan(s->camera_fov_deg * G_PI / 360.0) /
                             MAX(MIN(width, height), 1);
        s->camera_pan[0] = CLAMP(s->camera_pan[0] - dx * pixel, -100.0, 100.0);
        s->camera_pan[1] = CLAMP(s->camera_pan[1] + dy * pixel, -100.0, 100.0);
    } else if (left) {
        s->camera_azimuth_deg = fmod(s->camera_azimuth_deg - 0.4 * dx, 360.0);
        s->camera_elevation_deg = CLAMP(s->camera_elevation_deg + 0.4 * dy, -90.0, 90.0);
    } else if (glfwGetMouseButton(glfw, GLFW_MOUSE_BUTTON_RIGHT) == GLFW_PRESS) {
        window_move_lamp(w, 0.4 * dy, 0.4 * dx);
    } else {
        return;
    }
    w->stale = TRUE;
}

static void on_wheel(GLFWwindow *glfw, double x, double y) {
    struct window *w = window_input_of(glfw);
    struct viewer_settings *s = &w->now.settings;
    if (ui_wants_mouse())
        return;
    if (s->camera_distance > 0.0) /* otherwise nothing is drawn yet */
        s->camera_distance = CLAMP(s->camera_distance * pow(0.9, y), 0.05, 50.0);
    w->stale = TRUE;
}

static void on_drop(GLFWwindow *glfw, int n, const char **paths) {
    struct window *w = window_input_of(glfw);
    for (int k = 0; k < n; k++)
        window_open(w, paths[k]);
}

static void on_stale(GLFWwindow *glfw) {
    window_input_of(glfw)->stale = TRUE;
}

static void on_button(GLFWwindow *glfw, int button, int action, int mods) {
    struct window *w = window_input_of(glfw);
    if (action == GLFW_PRESS)
        pressed(w);
}

static void on_entered(GLFWwindow *glfw, int entered) {
    window_input_of(glfw);
}

static void on_size(GLFWwindow *glfw, int width, int height) {
    on_stale(glfw);
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
    glfwSetWindowRefreshCallback(w->glfw, on_stale);
    glfwSetDropCallback(w->glfw, on_drop);
    glfwGetCursorPos(w->glfw, &w->x, &w->y);
}
