/* Small files of text. A failure fails the test. */
#pragma once

#include <glib.h>

char *text_file_read(const char *path); /* g_free() */
void text_file_write(const char *folder, const char *name, const char *text);
void text_file_append(const char *folder, const char *name, const char *text); /* on a new line */
