/*
 * Opens files from outside, which may be anything: a path may name a FIFO, a device or a folder; a
 * file may be far too large, or its header may announce more pixels than there is memory for.
 * Nothing here blocks, and nothing is mapped: a file that is truncated while it is read gives an
 * error.
 *
 * Errors name the file and what is wrong with it: G_FILE_ERROR for an error of the system, else
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
    INPUT_FILE_ERROR_TOO_LARGE, /* larger than the limit, or it grows beyond it */
    INPUT_FILE_ERROR_TEXT,      /* not text */
    INPUT_FILE_ERROR_CUT,       /* it became shorter while it was read */
};

/* Propagates an error of this module, of which it takes ownership, in another domain: with the code
 * io for an error of the system (−1: as it is), and with the code unfit for a file of the wrong
 * kind or content. */
void input_file_propagate(GError *from, GQuark domain, int io, int unfit, GError **error);

/* Limit of a picture's pixels: INPUT_FILE_PIXELS, or INPUT_FILE_PIXELS_PER_BYTE times the length of
 * its file if that is more. No photograph compresses to less than two bits per pixel. */
#define INPUT_FILE_PIXELS          (48 << 20)
#define INPUT_FILE_PIXELS_PER_BYTE 4

/* Returns the kind of a file by its mode: "a FIFO", "a directory", … */
const char *input_file_kind(mode_t mode);

/* Opens a regular file of at most max_bytes for reading; links are followed. Returns the
 * descriptor; −1: error. ret_bytes, which may be NULL: the file's length. */
int input_file_open(const char *path, guint64 max_bytes, guint64 *ret_bytes, GError **error);

/* Reads a whole file of at most max_bytes and appends a NUL; g_free(). ret_length may be NULL. */
char *input_file_read(const char *path, gsize max_bytes, gsize *ret_length, GError **error);

/* The same for a file that must be text: without a NUL in it, and not in UTF-16. The byte-order
 * mark with which editors of Windows begin a file in UTF-8 is removed. */
char *input_file_read_text(const char *path, gsize max_bytes, GError **error);

/* The byte-order mark U+FEFF in UTF-8. */
#define INPUT_FILE_MARK "\xef\xbb\xbf"

/* Whether a text that should begin with ASCII is in UTF-16, and the message for it. */
gboolean input_file_is_utf16(const char *text, gsize length);
#define INPUT_FILE_UTF16 "it is a text in UTF-16; save it as UTF-8"

/* Reads n bytes from offset on; an error if the file has become too short for them. */
gboolean input_file_read_at(int fd, const char *path, gpointer to, gsize n, guint64 offset,
                            GError **error);

/* Limit of the memory for the decoded content of a file of this length: INPUT_FILE_MEMORY, or
 * INPUT_FILE_MEMORY_PER_BYTE times the length if that is more. Measured data never compresses more.
 */
#define INPUT_FILE_MEMORY          ((guint64)384 << 20)
#define INPUT_FILE_MEMORY_PER_BYTE 40
guint64 input_file_memory(guint64 file_bytes);

/* Checks, before a picture is decoded, that a file of this length may hold a picture of this size.
 */
gboolean input_file_check_pixels(const char *path, guint64 width, guint64 height,
                                 guint64 file_bytes, GError **error);

G_END_DECLS
