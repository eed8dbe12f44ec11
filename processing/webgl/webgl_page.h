/* Makes the page that shows a material in a browser. The page is one file, which contains the
 * program of renderer/web, its shaders and the material. Any thread. */
#pragma once

#include <glib.h>

/* Returns the maximum number of bytes of a page. `material` is the number of bytes of the material
 * file. The title may have up to 1000 bytes after it is escaped for HTML. */
gint64 webgl_page_bytes(gint64 material);

/* Returns the page; g_bytes_unref(). name is the title of the page, which the function escapes. */
GBytes *webgl_page(const char *name, GBytes *material);
