/* Values of a camera's settings, as libgphoto2 writes them. The functions are pure, and any thread
 * may call them. */
#pragma once

#include <glib.h>

/* Returns the number that a text states: 0.005 for "1/200" and "0.0050s", 8 for "f/8", 400 for "ISO
 * 400", 50 for "50%". Returns −1 for a text such as "bulb" or "Auto". */
double setting_text_number(const char *text);

/* Returns whether two texts state the same value. Two texts that state numbers are compared by
 * their numbers. Any other texts are compared as a whole, ignoring the case of the letters. */
gboolean setting_text_equal(const char *a, const char *b);

/* Returns the index of the text whose number differs from the number of `value` by the smallest
 * factor. The array ends with NULL. Returns −1 if `value` does not state a number above 0, or if no
 * text does. */
int setting_text_nearest(const char *value, const char *const *texts);
