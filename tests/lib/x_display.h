/* A display without a screen (Xvfb), and somebody who presses keys and drags the mouse on it. */
#pragma once

#include <glib.h>

typedef struct XDisplay XDisplay;

XDisplay *x_display_new(void);    /* NULL: there is no Xvfb here */
void x_display_free(XDisplay *x); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(XDisplay, x_display_free)

const char *x_display_name(const XDisplay *x); /* of DISPLAY */

/* Waits for the one window that is shown, gives it the keyboard, and returns FALSE if there is none
 * after so long. */
gboolean x_display_wait_window(XDisplay *x, double seconds);

char *x_display_title(XDisplay *x); /* of the window, g_free() */

/* key: of X11/keysymdef.h by name, as "F1", "plus", "s". */
void x_display_key(XDisplay *x, const char *key);
/* With a key held down, as "Control_L"; before: NULL, or one more. */
void x_display_chord(XDisplay *x, const char *before, const char *held, const char *key);
void x_display_type(XDisplay *x, const char *text); /* ASCII */
/* Relative to the window; button 1 left, 3 right, 4 and 5 the wheel. */
void x_display_move(XDisplay *x, int to_x, int to_y);
void x_display_press(XDisplay *x, int button, gboolean down); /* or lets go, where the mouse is */
void x_display_drag(XDisplay *x, int button, int from_x, int from_y, int by_x, int by_y);
void x_display_click(XDisplay *x, int button, int at_x, int at_y);

void x_display_size(XDisplay *x, int *ret_width, int *ret_height); /* of the window */

/* Files and folders dragged from another program are let go over the window (XDND version 5). paths
 * ends with NULL. Returns once the window has taken them. */
void x_display_drop(XDisplay *x, const char *const *paths);

/* As a window's frame would, where there were one. */
void x_display_ask_to_close(XDisplay *x);

/* What is shown of the window: width × height × 3 bytes, g_free(). */
guint8 *x_display_picture(XDisplay *x, int *ret_width, int *ret_height);

/* The server goes, with all connections. */
void x_display_kill(XDisplay *x);
