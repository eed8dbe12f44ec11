/*
 * Libraries that read whatever a file says (LibRaw, FFmpeg) run in a child process: a file on which
 * one of them crashes is an error that names it, and does not end the program. Any thread, since
 * the child is this program without its other threads; it must not use pools of threads that exist
 * already. What the libraries print is dropped.
 */
#pragma once

#include <glib.h>

G_BEGIN_DECLS

struct picture_child;

/* Runs in the child: reads a file and writes the result in any form by picture_child_write(). */
typedef gboolean (*PictureChildFunc)(struct picture_child *child, gpointer data, GError **error);

/* Runs in the parent for each picture_child_tell(). FALSE with an error kills the child. */
typedef gboolean (*PictureChildTold)(int done, int n, gpointer data, GError **error);

/* Returns FALSE if the bytes cannot be written; the child then ends with that error. */
gboolean picture_child_write(struct picture_child *child, gconstpointer bytes, gsize n);
void picture_child_tell(struct picture_child *child, int done, int n);

/* Runs func in a child with this much processor time, and returns what it has written; NULL: its
 * error, of told, or VISION_ERROR_IO: reader, the library's name, has crashed on path. told may be
 * NULL. */
GBytes *picture_child_run(const char *path, const char *reader, int cpu_s, PictureChildFunc func,
                          gpointer data, PictureChildTold told, gpointer told_data, GError **error);

/* Takes the next n bytes of a result. Returns FALSE if fewer are left. */
gboolean picture_child_take(GBytes *from, gsize *at, gpointer to, gsize n);

G_END_DECLS
