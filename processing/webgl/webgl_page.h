/* Makes the page that shows a material in a browser. The page is one file, which contains the
 * program of renderer/web, its shaders and the material. Any thread. */
#pragma once

#include <glib.h>

/* Returns the maximum number of bytes of a page with a material file of `material` bytes and a
 * title of up to 1000 bytes, as escaped in HTML. */
gint64 webgl_page_bytes(gint64 material);

/* Returns the page. name is its title, which is escaped here. g_bytes_unref() */
GBytes *webgl_page(const char *name, GBytes *material);
