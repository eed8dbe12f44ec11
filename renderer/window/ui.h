/*
 * Controls over the picture in a window: a thin layer over Dear ImGui, in C. All functions belong
 * to the thread of the window's GL context. Text is UTF-8.
 *
 * In every frame, the program calls a function for each control, between ui_begin() and ui_end().
 * The call adds the control to the frame. A function of type gboolean returns TRUE if the user has
 * just changed the control or pressed the button. Where a function returns something else, its
 * comment says so.
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

/* Return whether a control uses the mouse, or the keyboard, so that the picture must ignore it. */
gboolean ui_wants_mouse(void);
gboolean ui_wants_keyboard(void);

/* Returns the factor by which fonts and controls are enlarged. It is 1, or up to 4 on a display of
 * high resolution. All lengths below are in units of the window (screen coordinates of GLFW). A
 * caller multiplies a length by this factor so that it looks the same on each display. */
float ui_scale(void);

/* These functions begin a window of controls, and ui_end_window() ends it.
 * - ui_panel_begin(): a panel that fills a rectangle and scrolls.
 * - ui_dialog_begin(): a dialog in the middle of a rectangle. It has the given width if the
 *   rectangle is wide enough, and is not higher than the rectangle.
 * - ui_bar_begin(): a line of text at the bottom of a rectangle. If takes_mouse is FALSE, actions
 *   of the mouse over this line are meant for the picture. */
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
/* *chosen is the index of the chosen name in `names`. In the functions that follow, `format` is a
 * printf() format for a double. */
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

/* Adds a line of text input, as wide as its dialog. text has space for size bytes, including the
 * NUL. If focus is TRUE, the line takes the keyboard. The line does not react to Enter. The window
 * handles this key, because a control misses a key that is pressed and released between two frames.
 */
void ui_line(const char *name, char *text, gsize size, gboolean focus);

/* Draws a 2D texture, which must exist until ui_end(). */
void ui_picture(guint texture, float width, float height);

/* Draws bars of red, green and blue over each other. values has 3 n numbers from 0 to 1: first n
 * for red, then n for green, then n for blue. */
void ui_histogram(const float *values, int n, float width, float height);

/* The kinds of directions that ui_hemisphere() draws as dots on the hemisphere, seen from above.
 * Directions below the horizon are drawn on the edge. */
enum ui_dot_kind { UI_DOT_THERE, UI_DOT_MISSING, UI_DOT_CAMERA, UI_DOT_LIGHT, UI_DOT_CHOSEN_LIGHT };
struct ui_dot {
    double theta_deg, phi_deg;
    enum ui_dot_kind kind;
};
/* Draws the dots. Returns the index of the dot of a light that the mouse is dragging, or −1 if
 * there is none.
 *
 * If there is one, *ret_theta_deg and *ret_phi_deg are the direction on the upper hemisphere to
 * which the mouse has dragged the dot. Until the mouse has moved, this is the dot's own direction.
 * If there is none, they are not set. */
int ui_hemisphere(const char *name, const struct ui_dot *dots, int n, float size,
                  double *ret_theta_deg, double *ret_phi_deg);
