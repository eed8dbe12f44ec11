/* Pictures and tables on disk as multi-part scan line OpenEXR with custom attributes, through
 * OpenEXRCore. In memory all values are float. On disk each part is half or float. A file is
 * written under a temporary name, synced and renamed, so that an existing file is always complete.
 *
 * Hostile files are refused with an error: sizes are checked against the length of the file and
 * EXR_MAX_PIXELS before memory is allocated. The functions may be called from any thread, but only
 * one call at a time may use the same file. */
#pragma once

#include <glib.h>

#define EXR_MAX_PIXELS   (1 << 28) /* maximum number of pixels of one channel of one part */
#define EXR_MAX_CHANNELS 64

#define EXR_ERROR exr_error_quark()
GQuark exr_error_quark(void);
enum exr_error {
    EXR_ERROR_IO,
    /* not an EXR, truncated, of an unsupported kind (deep, tiled), or with content that its reader
     * refuses */
    EXR_ERROR_FORMAT,
    EXR_ERROR_TOO_LARGE, /* more pixels than the file, EXR_MAX_PIXELS or the memory allow */
    /* a requested part, channel or attribute does not exist, or an attribute has another type */
    EXR_ERROR_MISSING,
    /* The disk is full, or the file too large for it. An existing file of that name stays as it
     * was. */
    EXR_ERROR_FULL,
    EXR_ERROR_CANCELLED, /* cancelled by the callback of exr_watch() */
};

enum exr_type { EXR_HALF, EXR_FLOAT };
enum exr_compression { EXR_NONE, EXR_ZIP, EXR_PIZ };

enum exr_kind { EXR_KIND_STRING, EXR_KIND_INT, EXR_KIND_DOUBLE, EXR_KIND_V3D };

struct exr_attribute {
    char *name;
    enum exr_kind kind;
    char *string;
    int integer;
    double v[3]; /* EXR_KIND_DOUBLE uses only v[0] */
};

typedef struct exr_part {
    char *name; /* name of the part, unique in the file */
    int width, height;
    /* after exr_read_picture() the upper left corner of the display window, otherwise 0 */
    int left_px, top_px;
    /* after exr_read_picture() the number of pixels that the file does not contain, which are NaN
     * in all channels; otherwise 0 */
    gint64 outside;
    int n_channels;
    char **channels; /* names in alphabetical order, as EXR requires: "B","G","R" */
    float **planes;  /* one per channel, height × width, top row first; NULL if not read */
    enum exr_type type;
    GPtrArray *attributes; /* of struct exr_attribute */
} ExrPart;

typedef struct exr_file {
    GPtrArray *parts; /* of struct exr_part */
} ExrFile;

/* Creates a part whose planes are allocated and zeroed. channels is NULL-terminated and in
 * alphabetical order. */
struct exr_part *exr_part_new(const char *name, int width, int height, const char *const *channels,
                              enum exr_type type);
void exr_part_free(struct exr_part *part); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(ExrPart, exr_part_free)
/* Returns the values of a channel, or NULL if the part has no such channel or its planes were not
 * read. */
float *exr_part_plane(const struct exr_part *part, const char *channel);
gboolean exr_all_finite(const float *values, gsize n);

/* Set an attribute of a part. An attribute of the same name is replaced. */
void exr_set_string(struct exr_part *part, const char *name, const char *value);
void exr_set_int(struct exr_part *part, const char *name, int value);
void exr_set_double(struct exr_part *part, const char *name, double value);
void exr_set_v3d(struct exr_part *part, const char *name, double x, double y, double z);
/* Get the value of an attribute. A string is owned by the part. If the attribute is missing or has
 * another type, return FALSE with EXR_ERROR_MISSING and leave the result unchanged. */
gboolean exr_get_string(const struct exr_part *part, const char *name, const char **ret,
                        GError **error);
gboolean exr_get_int(const struct exr_part *part, const char *name, int *ret, GError **error);
gboolean exr_get_double(const struct exr_part *part, const char *name, double *ret, GError **error);
gboolean exr_get_v3d(const struct exr_part *part, const char *name, double ret[3], GError **error);

struct exr_file *exr_file_new(void);
void exr_file_add(struct exr_file *file, struct exr_part *part); /* takes ownership */
void exr_file_free(struct exr_file *file);                       /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(ExrFile, exr_file_free)
/* Returns the part with this name, or NULL if the file has no such part. */
struct exr_part *exr_file_part(const struct exr_file *file, const char *name);

/* Writes a file. In half parts, values beyond ±65504 are written as ±65504 and NaN as NaN. With
 * sync, the file and its directory entry are on disk when the function returns. The bytes of the
 * file depend only on the arguments. The error is EXR_ERROR_FORMAT if there are no parts, or if a
 * name, a channel or an attribute is not valid. It is EXR_ERROR_TOO_LARGE if a part has no pixels
 * or more than EXR_MAX_PIXELS. */
gboolean exr_write(const char *path, const struct exr_file *file, enum exr_compression compression,
                   gboolean sync, GError **error);

/* Callback that fills the planes of a part. All values are 0 before. If it returns FALSE, it sets
 * the error with which the writing fails. */
typedef gboolean (*ExrFill)(struct exr_part *part, gpointer data, GError **error);

/* Writes a file as exr_write() does, for parts that do not fit into memory together. If the planes
 * of a part are NULL, they are allocated when the part is written, filled by the callback, and
 * freed afterwards. The callback is called a second time for each part if the compressed file is so
 * small that exr_read() would refuse it; the file is then written without compression. */
gboolean exr_write_filled(const char *path, const struct exr_file *file,
                          enum exr_compression compression, gboolean sync, ExrFill fill,
                          gpointer data, GError **error);
/* Frees the planes of a part, which exr_write_filled() allocates again. */
void exr_part_drop_planes(struct exr_part *part);

/* Writes a file below a directory as exr_write() does. Symbolic links among the folders of the
 * relative name are not followed. */
gboolean exr_write_below(const char *directory, const char *relative, const struct exr_file *file,
                         enum exr_compression compression, gboolean sync, GError **error);

/* Sets a callback for the calling thread. While a file is read, the callback is told which share of
 * the file has been read, 0 … 1. If the callback returns FALSE, reading is cancelled. NULL removes
 * the callback. */
typedef gboolean (*ExrWatch)(double share, gpointer data);
void exr_watch(ExrWatch watch, gpointer data);

/* exr_read() reads a whole file, exr_read_headers() only its headers (planes are NULL), and
 * exr_read_part() one part with its planes. Channels of integers are converted to float. */
struct exr_file *exr_read(const char *path, GError **error);
struct exr_file *exr_read_headers(const char *path, GError **error);
struct exr_part *exr_read_part(const char *path, const char *name, GError **error);

/* Reads a file some parts at a time, for files that are larger than memory. */
typedef struct ExrReader ExrReader;
/* Opens a file and reads the headers of all its parts. Fails as exr_read() does. */
ExrReader *exr_reader_new(const char *path, GError **error);
void exr_reader_free(ExrReader *reader); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(ExrReader, exr_reader_free)
int exr_reader_parts(const ExrReader *reader); /* number of parts of the file */
/* Returns the name of the next part (ahead 0) or of a later one, or NULL after the last part. */
const char *exr_reader_name(const ExrReader *reader, int ahead);
void exr_reader_skip(ExrReader *reader); /* skips the next part */
/* Returns the next n parts with their planes, or as many as are left. The parts are decoded in
 * n_threads threads (0: one per processor). Several parts per thread are best. Returns NULL with an
 * error if one of them cannot be read. exr_watch() has no effect. */
struct exr_file *exr_reader_next(ExrReader *reader, int n, int n_threads, GError **error);

/* Reads a picture that another program has made: the first part of its file. The returned part has
 * the size of the display window, and the pixels lie where the data window places them. Pixels
 * outside the display window are left out. (This function is not for Mesorig's own files. Their
 * parts differ in size, and their display window has no meaning.) */
struct exr_part *exr_read_picture(const char *path, GError **error);

/* Returns the SHA-256 of any file as 64 hexadecimal digits; g_free(). Returns NULL on error.
 * ret_bytes may be NULL. */
char *exr_sha256(const char *path, gint64 *ret_bytes, GError **error);
