/* Opens files that come from users or from other programs. Such a file may be anything. Its path
 * may name a FIFO, a device or a folder. The file may be far too large, or its header may announce
 * more pixels than fit into memory.
 *
 * The functions do not wait for other programs. The one exception is a program that holds a lease
 * on the file (fcntl(2)): the functions wait for it, up to 60 s. The functions never map a file
 * into memory. A file that is truncated while it is read gives an error.
 *
 * Errors name the file and say what is wrong with it. They are G_FILE_ERROR for errors of the
 * system, and INPUT_FILE_ERROR otherwise. Any thread may call these functions. */
#pragma once

#include <glib.h>
#include <sys/types.h>

G_BEGIN_DECLS

#define INPUT_FILE_ERROR input_file_error_quark()
GQuark input_file_error_quark(void);
enum input_file_error {
    INPUT_FILE_ERROR_KIND,      /* not a regular file */
    INPUT_FILE_ERROR_TOO_LARGE, /* the file is larger than the limit, or its picture has too many
                                   pixels */
    INPUT_FILE_ERROR_TEXT,      /* not text */
    INPUT_FILE_ERROR_CUT,       /* the file has become shorter while it was read */
};

/* Propagates an error of this module in another domain, and takes ownership of it. An
 * INPUT_FILE_ERROR gets the code `unfit`. An error of the system gets the code `io`; if `io` is −1,
 * it keeps its own domain and code. */
void input_file_propagate(GError *from, GQuark domain, int io, int unfit, GError **error);

/* The largest number of pixels of a picture is INPUT_FILE_PIXELS, or INPUT_FILE_PIXELS_PER_BYTE
 * times the number of bytes of its file if that is more. Cameras use at least two bits per pixel in
 * compressed photographs, so 4 pixels per byte are sufficient. */
#define INPUT_FILE_PIXELS          (48 << 20)
#define INPUT_FILE_PIXELS_PER_BYTE 4

/* Returns the kind of a file (st_mode of struct stat) in words: "a FIFO", "a directory", … */
const char *input_file_kind(mode_t mode);

/* Opens a regular file of at most max_bytes for reading. Links are followed. Returns the
 * descriptor, or −1 with an error. *ret_bytes is the length of the file; ret_bytes may be NULL. */
int input_file_open(const char *path, guint64 max_bytes, guint64 *ret_bytes, GError **error);

/* Reads a whole file of at most max_bytes and appends a NUL. ret_length may be NULL. Free the
 * result with g_free(). */
char *input_file_read(const char *path, gsize max_bytes, gsize *ret_length, GError **error);

/* The same as input_file_read() for a file that must be text. The text must not contain a NUL and
 * must not be in UTF-16. The byte-order mark at the start of UTF-8 files from Windows editors is
 * removed. */
char *input_file_read_text(const char *path, gsize max_bytes, GError **error);

/* The byte-order mark U+FEFF in UTF-8. */
#define INPUT_FILE_MARK "\xef\xbb\xbf"

/* Returns whether a text that should begin with ASCII is in UTF-16. INPUT_FILE_UTF16 is the error
 * message for such a text. */
gboolean input_file_is_utf16(const char *text, gsize length);
#define INPUT_FILE_UTF16 "it is a text in UTF-16; save it as UTF-8"

/* Reads n bytes of an open file into `to`, from offset on. path is the name of the file in errors.
 * Fails if the file has fewer than n bytes after offset. */
gboolean input_file_read_at(int fd, const char *path, gpointer to, gsize n, guint64 offset,
                            GError **error);

/* Returns the maximum number of bytes of memory for the decoded content of a file with file_bytes:
 * INPUT_FILE_MEMORY, or INPUT_FILE_MEMORY_PER_BYTE times file_bytes if that is more. Measured data
 * is never compressed by a larger factor. */
#define INPUT_FILE_MEMORY          ((guint64)384 << 20)
#define INPUT_FILE_MEMORY_PER_BYTE 40
guint64 input_file_memory(guint64 file_bytes);

/* Checks that a picture in a file with file_bytes does not have more pixels than such a file may
 * have. Call it before the picture is decoded. */
gboolean input_file_check_pixels(const char *path, guint64 width, guint64 height,
                                 guint64 file_bytes, GError **error);

G_END_DECLS
