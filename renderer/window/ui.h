/*
 * Controls over the picture in a window: a thin layer over Dear ImGui, in C. All functions belong
 * to the thread of the window's GL context. Text is UTF-8. In every frame, the program calls a
 * function for each control, between ui_begin() and ui_end(). The call adds the control to the
 * frame. If the function returns a gboolean, it returns TRUE if the user has just changed the
 * control or pressed the button, unless the comment of the function says otherwise.
 */
#pragma once

#include <glib.h>

typedef struct Ui Ui;
struct GLFWwindow;

/* Makes the controls, once per program. The window's GL context must be current. Call this function
 * after the window's own callbacks are set. The window's callbacks are still called; see
 * ui_wants_mouse() and ui_wants_keyboard(). */
Ui *ui_new(struct GLFWwindow *window);
void ui_free(Ui *ui); /* NULL is ignored */

void ui_begin(Ui *ui);
void ui_end(Ui *ui); /* draws into the window's framebuffer */

/* Return whether the actions of the mouse, or those of the keyboard, are meant for a control. */
gboolean ui_wants_mouse(void);
gboolean ui_wants_keyboard(void);

/* Returns the factor by which fonts and controls are enlarged: 1, or up to 4 on a display of high
 * resolution. Lengths below are in units of the window (screen coordinates of GLFW). The caller
 * multiplies a length by this factor if it should have the same size on each display. */
float ui_scale(void);

/* These functions begin a window of controls, and ui_end_window() ends it. ui_panel_begin() begins
 * a panel that fills a rectangle and scrolls. ui_dialog_begin() begins a dialog in the middle of a
 * rectangle. The dialog has the given width if there is room, and is not higher than the rectangle.
 * ui_bar_begin() begins a line of text at the bottom of a rectangle. With takes_mouse FALSE, the
 * mouse reaches the picture below this line. */
struct ui_box {
    float x, y, width, height;
};
void ui_panel_begin(const char *title, struct ui_box box);
void ui_dialog_begin(const char *title, struct ui_box within, float width);
void ui_bar_begin(struct ui_box within, gboolean takes_mouse);
void ui_button_begin(struct ui_box at); /* a window without a frame, for a button */
void ui_end_window(void);
void ui_same_line(void);
void ui_column(float x); /* the next control is in the same line, at x */
/* Adds a horizontal line with space above and below it. */
void ui_gap(void);
gboolean ui_section(const char *title, gboolean open); /* returns whether the section is unfolded */

/* For tests: returns whether the font has a glyph for each letter of the text. Letters without a
 * glyph are drawn as “?”. Needs no window. */
gboolean ui_has_glyphs(const char *text);

void ui_text(const char *text);
void ui_note(const char *text); /* shows highlighted text */
/* *chosen is the index, in `names`, of the name that is chosen. `format` of the following functions
 * is the format of the number for printf(), which gets a double. */
gboolean ui_choice(const char *label, const char *const *names, int n, int *chosen);
gboolean ui_slider(const char *label, double *value, double low, double high, const char *format);
/* Adds a slider with a logarithmic scale. low must be above 0. */
gboolean ui_slider_log(const char *label, double *value, double low, double high,
                       const char *format);
gboolean ui_pair(const char *label, double values[2], double low, double high, const char *format);
gboolean ui_check(const char *label, gboolean *value);
gboolean ui_button(const char *label);
gboolean ui_colour(const char *label, float rgb[3]);

/* Begins a list that scrolls. ui_row() adds a row and returns whether the row was clicked.
 * ui_list_end() ends the list. */
void ui_list_begin(const char *name, float height);
gboolean ui_row(const char *text, gboolean marked);
void ui_list_end(void);

/* Adds a line of text input, as wide as its dialog. text has room for size bytes, including the
 * NUL. If focus is TRUE, the line takes the keyboard. The window handles Enter, because a control
 * misses a key that is pressed and released between two pictures. */
void ui_line(const char *name, char *text, gsize size, gboolean focus);

/* Draws a 2D texture, which must exist until ui_end(). */
void ui_picture(guint texture, float width, float height);

/* Draws bars of red, green and blue over each other. values are n values of red, then n of green,
 * then n of blue, all 0 … 1. */
void ui_histogram(const float *values, int n, float width, float height);

/* The kinds of directions that ui_hemisphere() draws as dots on the hemisphere, seen from above.
 * Directions below the horizon are drawn on the edge. */
enum ui_dot_kind { UI_DOT_THERE, UI_DOT_MISSING, UI_DOT_CAMERA, UI_DOT_LIGHT, UI_DOT_CHOSEN_LIGHT };
struct ui_dot {
    double theta_deg, phi_deg;
    enum ui_dot_kind kind;
};
/* Draws the dots. If the mouse holds the dot of a light, returns the index of the dot.
 * *ret_theta_deg and *ret_phi_deg are then the direction on the upper hemisphere to which the mouse
 * has dragged the dot. They are the dot's own direction until it is dragged. If the mouse holds no
 * dot of a light, returns −1 and does not set *ret_theta_deg and *ret_phi_deg. */
int ui_hemisphere(const char *name, const struct ui_dot *dots, int n, float size,
                  double *ret_theta_deg, double *ret_phi_deg);
