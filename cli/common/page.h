/* This module makes HTML pages that a person can mail. A page is one file and needs no other files.
 * It can be read on a phone and on paper, in light and dark colours. Any thread may call the
 * functions. */
#pragma once

#include <glib.h>

/* Begins a page, including its style. These classes may be used:
 * - "wide" for an element that contains a table, which can then be scrolled,
 * - "n" for cells with numbers,
 * - "pass", "warning", "failure" and "faint" for colours.
 *
 * Returns the page. page_end() takes ownership of it. */
GString *page_begin(const char *title);

/* Appends HTML by a format. Text arguments (%s) are escaped. */
void page_add(GString *to, const char *format, ...) G_GNUC_PRINTF(2, 3);

/* Appends a row of a table with the cells name and value. Appends nothing if value is NULL or
 * empty. */
void page_add_row(GString *to, const char *name, const char *value);

/* Appends a figure. caption is also the alternative text for people who do not see the picture. */
void page_add_picture(GString *to, GBytes *png, const char *caption);

/* Ends the page and frees it. Returns its text, to be freed with g_free(). */
char *page_end(GString *page);
