/*
 * How files that others give are opened: a path may name a FIFO, a device or a folder, a file may
 * be far larger than what it should hold, or promise more pixels than there is memory for. Nothing
 * here waits, and nothing is mapped: a file that is cut off while it is read gives an error.
 *
 * Errors name the file and what is wrong with it: of G_FILE_ERROR where the system says so, else of
 * INPUT_FILE_ERROR. Any thread.
 */
#pragma once

#include <glib.h>
#include <sys/types.h>

G_BEGIN_DECLS

#define INPUT_FILE_ERROR input_file_error_quark()
GQuark input_file_error_quark(void);
enum input_file_error {
    INPUT_FILE_ERROR_KIND,      /* not a regular file */
    INPUT_FILE_ERROR_TOO_LARGE, /* or it grows */
    INPUT_FILE_ERROR_TEXT,      /* not a text */
    INPUT_FILE_ERROR_CUT,       /* it has become shorter */
};

/* Hands on an error of this module, which is taken, as one of another module: io for what the
 * system says (−1: as it is), unfit for the file's being what it is. */
void input_file_propagate(GError *from, GQuark domain, int io, int unfit, GError **error);

/* A picture may have so many pixels whatever its file's length is, and more where its file has two
 * bits or more for each: what compresses to less is no photograph. */
#define INPUT_FILE_PIXELS          (48 << 20)
#define INPUT_FILE_PIXELS_PER_BYTE 4

/* What a file of such a mode is: "a FIFO", "a directory", … */
const char *input_file_kind(mode_t mode);

/* A descriptor to read a regular file of at most max_bytes; links are followed. −1: error.
 * ret_bytes, which may be NULL: its length. */
int input_file_open(const char *path, guint64 max_bytes, guint64 *ret_bytes, GError **error);

/* All of a file of at most max_bytes, and a NUL after it; g_free(). ret_length may be NULL. */
char *input_file_read(const char *path, gsize max_bytes, gsize *ret_length, GError **error);

/* The same of a file that must be text: without a NUL in it. */
char *input_file_read_text(const char *path, gsize max_bytes, GError **error);

/* n bytes from offset on; an error if the file has become shorter than that. */
gboolean input_file_read_at(int fd, const char *path, gpointer to, gsize n, guint64 offset,
                            GError **error);

/* Bytes of memory that what a file of this length holds may take once it is decoded: some whatever
 * its length is, and more where it is longer. Nothing measured compresses to less than that. */
#define INPUT_FILE_MEMORY          ((guint64)384 << 20)
#define INPUT_FILE_MEMORY_PER_BYTE 40
guint64 input_file_memory(guint64 file_bytes);

/* Before a picture is decoded: whether its size is one that a file of that length may have. */
gboolean input_file_check_pixels(const char *path, guint64 width, guint64 height,
                                 guint64 file_bytes, GError **error);

G_END_DECLS
