/* A display without a screen (Xvfb), on which tests press keys and drag the mouse. */
#pragma once

#include <glib.h>

typedef struct XDisplay XDisplay;

XDisplay *x_display_new(void);    /* returns NULL if Xvfb is not installed */
void x_display_free(XDisplay *x); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(XDisplay, x_display_free)

const char *x_display_name(const XDisplay *x); /* a value of $DISPLAY */

/* Waits for the single window, and gives it the keyboard. Returns FALSE if there is no window
 * within this time. */
gboolean x_display_wait_window(XDisplay *x, double seconds);

char *x_display_title(XDisplay *x); /* title of the window; g_free() */

/* Presses a key. key is its name in X11/keysymdef.h, for example "F1", "plus" or "s". */
void x_display_key(XDisplay *x, const char *key);
/* Presses a key while another one is held, for example "Control_L". before is pressed before held,
 * or is NULL. */
void x_display_chord(XDisplay *x, const char *before, const char *held, const char *key);
void x_display_type(XDisplay *x, const char *text); /* ASCII */
/* Moves the mouse, relative to the window. Below, button 1 is left, 3 is right, and 4 and 5 are the
 * wheel. */
void x_display_move(XDisplay *x, int to_x, int to_y);
/* presses or releases a button at the position of the mouse */
void x_display_press(XDisplay *x, int button, gboolean down);
void x_display_drag(XDisplay *x, int button, int from_x, int from_y, int by_x, int by_y);
void x_display_click(XDisplay *x, int button, int at_x, int at_y);

void x_display_size(XDisplay *x, int *ret_width, int *ret_height); /* of the window */

/* Drops files and folders on the window, as if dragged from another program (XDND version 5). paths
 * ends with NULL. Returns when the window has taken them. */
void x_display_drop(XDisplay *x, const char *const *paths);

/* Asks the window to close, as the frame of a window manager would. */
void x_display_ask_to_close(XDisplay *x);

/* Returns the picture of the window: width × height × 3 bytes; g_free(). */
guint8 *x_display_picture(XDisplay *x, int *ret_width, int *ret_height);

/* Ends the server, which closes all its connections. */
void x_display_kill(XDisplay *x);
