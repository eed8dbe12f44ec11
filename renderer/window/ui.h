/*
 * Controls over the picture in a window: a thin layer over Dear ImGui, in C. All belongs to the
 * thread of the window's GL context; text is UTF-8. Between ui_begin() and ui_end(), every frame
 * again, each call adds a control; it returns TRUE if the user has just changed that.
 */
#pragma once

#include <glib.h>

typedef struct Ui Ui;
struct GLFWwindow;

/* After the window's own callbacks are set: they are still called, see ui_wants_…(). */
Ui *ui_new(struct GLFWwindow *window);
void ui_free(Ui *ui); /* NULL is ignored */

void ui_begin(Ui *ui);
void ui_end(Ui *ui); /* draws into the window's framebuffer */

/* Whether what the mouse or keyboard does is meant for a control. */
gboolean ui_wants_mouse(void);
gboolean ui_wants_keyboard(void);

/* Begins a panel with its corner at (x, y), in pixels; its height is that of its contents. */
void ui_panel_begin(const char *title, float x, float y, float width);
void ui_panel_end(void);
gboolean ui_section(const char *title, gboolean open); /* whether it is unfolded */

/* Whether the font has a glyph for each letter of the text; others are drawn as “?”. Needs no
 * window. */
gboolean ui_has_glyphs(const char *text);

void ui_text(const char *text);
void ui_note(const char *text); /* a text that stands out */
gboolean ui_choice(const char *label, const char *const *names, int n, int *chosen);
gboolean ui_slider(const char *label, double *value, double low, double high, const char *format);
gboolean ui_check(const char *label, gboolean *value);
gboolean ui_button(const char *label);
void ui_picture(guint texture, float width, float height);

/* Bars of red, green and blue over each other: 3 × n values, 0 … 1. */
void ui_histogram(const float *values, int n, float width, float height);

/* Directions of the hemisphere, seen from above. */
enum ui_dot_kind { UI_DOT_THERE, UI_DOT_MISSING, UI_DOT_CAMERA, UI_DOT_LIGHT };
struct ui_dot {
    double theta_deg, phi_deg;
    enum ui_dot_kind kind;
};
void ui_hemisphere(const struct ui_dot *dots, int n, float size);
