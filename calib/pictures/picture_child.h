/*
 * Libraries that read whatever a file says (LibRaw, FFmpeg) run in a program of their own,
 * mesorig-read-picture, with limited processor time: a file on which one of them crashes is an
 * error that names it, and does not end the program that wants the picture. What the libraries
 * print is dropped. Any thread.
 */
#pragma once

#include <glib.h>

G_BEGIN_DECLS

/* A file for the program to read. */
struct picture_job {
    const char *path;   /* for messages; it may lead elsewhere by now */
    const char *reader; /* "raw" or "video" */
    int fd;             /* the file, open for reading */
    guint64 length;     /* bytes of the file */
    int most;           /* frames of a video to keep; otherwise 0 */
};

/* Called for each picture_child_tell(). FALSE with an error kills the program. */
typedef gboolean (*PictureChildTold)(int done, int n, gpointer data, GError **error);

/* Runs the program and returns what it has written; NULL: its error, of told, or
 * PICTURE_FILE_ERROR_IO: library, which reads this file, has crashed on it. told may be NULL. */
GBytes *picture_child_run(const struct picture_job *job, const char *library, PictureChildTold told,
                          gpointer told_data, GError **error);

/* Takes the next n bytes of a result. Returns FALSE if fewer are left. */
gboolean picture_child_take(GBytes *from, gsize *at, gpointer to, gsize n);

/* The rest is for the program. */

/* Reads a file and writes what it has read, in any form, by picture_child_write(). The program ends
 * then: nothing needs to be freed. */
typedef gboolean (*PictureChildFunc)(const struct picture_job *job, GError **error);

/* Returns FALSE if the bytes cannot be written; the program then ends with that error. */
gboolean picture_child_write(gconstpointer bytes, gsize n);
void picture_child_tell(int done, int n);

/* Takes the arguments of picture_child_run(), and runs func with this much processor time. Does not
 * return; wrong arguments end the program with exit code 2. */
void picture_child_main(int argc, char **argv, int cpu_s, PictureChildFunc func) G_GNUC_NORETURN;

G_END_DECLS
