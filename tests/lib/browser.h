/* A page in a browser without a window: Chromium, driven by the WebDriver protocol of Debian's
 * chromium-driver. What goes wrong in here fails the test. */
#pragma once

#include <glib.h>

typedef struct Browser Browser;

Browser *browser_new(int width, int height);
void browser_free(Browser *browser); /* NULL is ignored */

void browser_open(Browser *browser, const char *uri);

/* What a JavaScript expression is, as a text; g_free(). */
char *browser_value(Browser *browser, const char *expression);

/* Waits for an expression to be true, 30 s at most. */
void browser_wait(Browser *browser, const char *expression);
