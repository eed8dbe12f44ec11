/* A page in a browser without a window: Chromium, controlled via the WebDriver protocol of Debian's
 * chromium-driver. Errors in these functions fail the test. */
#pragma once

#include <glib.h>

typedef struct Browser Browser;

Browser *browser_new(int width, int height);
void browser_free(Browser *browser); /* NULL is ignored */

void browser_open(Browser *browser, const char *uri);

/* Returns the value of a JavaScript expression as text; g_free(). */
char *browser_value(Browser *browser, const char *expression);

/* Waits until the element with this id is visible and not disabled, and clicks it. */
void browser_press(Browser *browser, const char *id);

/* Waits until an expression is true, for at most WAIT_S (lib/wait.h). */
void browser_wait(Browser *browser, const char *expression);

/* Sets the value of an input or select, and tells the page that a user did so. */
void browser_set(Browser *browser, const char *id, const char *value);

/* Waits until the element is visible, moves it to the top of the window, and writes the window as a
 * JPEG file. */
void browser_picture(Browser *browser, const char *id, const char *path);
