/* The page that shows a material in a browser: one file, with renderer/web's program, its shaders
 * and the material in it. Any thread. */
#pragma once

#include <glib.h>

/* Bytes of a page that holds a material file of so many bytes. */
gint64 webgl_page_bytes(gint64 material);

/* name: the title. g_bytes_unref() */
GBytes *webgl_page(const char *name, GBytes *material);
