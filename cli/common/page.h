/* This module makes HTML pages that a person can mail. A page is one file without references to
 * others. It is readable on a phone and on paper, in light and dark colours. Any thread may call
 * the functions. */
#pragma once

#include <glib.h>

/* Begins a page, with its style. A table in an element of the class "wide" can be scrolled. Cells
 * of the class "n" have numbers. The classes "pass", "warning", "failure" and "faint" are colours.
 * Returns the page; page_end() takes it. */
GString *page_begin(const char *title);

/* Appends HTML by a format. Every argument that is text is escaped. */
void page_add(GString *to, const char *format, ...) G_GNUC_PRINTF(2, 3);

/* Appends a row of a table with two cells, unless value is NULL or empty. */
void page_add_row(GString *to, const char *name, const char *value);

/* Appends a figure. caption is also the text for people who do not see the picture. */
void page_add_picture(GString *to, GBytes *png, const char *caption);

/* Ends the page, and returns its text; g_free(). */
char *page_end(GString *page);
