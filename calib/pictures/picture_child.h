/*
 * LibRaw and FFmpeg read files of any content. They run in separate programs, mesorig-read-raw and
 * mesorig-read-video, with limited processor time. If a library crashes on a file, the result is an
 * error that names the file, and the program that needs the picture continues. The output of the
 * libraries is dropped.
 *
 * FFmpeg has a program of its own, because its 200 libraries take longer to load than a raw file
 * takes to read. Any thread may call the functions.
 */
#pragma once

#include <glib.h>

G_BEGIN_DECLS

/* A file for a program to read. */
struct picture_job {
    const char *program; /* "mesorig-read-raw" or "mesorig-read-video" */
    const char *path;    /* for messages; it may name another file by now */
    int fd;              /* the file, open for reading */
    guint64 length;      /* bytes of the file */
    int most;            /* largest number of frames of a video to keep; 0 for a raw file */
};

/* Called when the program calls picture_child_tell(). Of n steps, `done` are finished. If this
 * function returns FALSE with an error, the program is killed. */
typedef gboolean (*PictureChildTold)(int done, int n, gpointer data, GError **error);

/* Runs the program and returns what it has written. `library` is the name of the library that reads
 * the file, for messages. `told` may be NULL. On failure returns NULL with one of these errors:
 * - the error of the program or of `told`;
 * - PICTURE_FILE_ERROR_IO if the program has crashed or has ended without a result;
 * - another error if the program cannot be started. */
GBytes *picture_child_run(const struct picture_job *job, const char *library, PictureChildTold told,
                          gpointer told_data, GError **error);

/* Copies the next n bytes of a result, from the offset *at, and increases *at. Returns FALSE if
 * fewer bytes are left. */
gboolean picture_child_take(GBytes *from, gsize *at, gpointer to, gsize n);

/* The following functions are for the programs. */

/* Reads a file, and writes the result with picture_child_write(). The reader of the result defines
 * its format. Returns FALSE with an error if the file cannot be read. The program ends afterwards,
 * so nothing needs to be freed. */
typedef gboolean (*PictureChildFunc)(const struct picture_job *job, GError **error);

/* Appends n bytes to the result. Returns FALSE, without an error, if there is too little memory for
 * the bytes. The PictureChildFunc must then return FALSE. */
gboolean picture_child_write(gconstpointer bytes, gsize n);
/* Reports to the caller of picture_child_run() that `done` of n steps are finished. */
void picture_child_tell(int done, int n);

/* Takes the arguments of picture_child_run(), and runs func with at most cpu_s seconds of processor
 * time. Does not return. Wrong arguments end the program with exit code 2. */
void picture_child_main(int argc, char **argv, int cpu_s, PictureChildFunc func) G_GNUC_NORETURN;

G_END_DECLS
