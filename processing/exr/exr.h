/*
 * Pictures and tables on disk: multi-part scan line OpenEXR with custom attributes, through
 * OpenEXRCore. In memory all values are float; on disk each part is half or float. A file is
 * written under a temporary name, synced and renamed, so that an existing file is complete.
 *
 * Hostile files are refused with an error: sizes are checked against the file's length and
 * EXR_MAX_PIXELS before anything is allocated. Any thread; one call per file at a time.
 */
#pragma once

#include <gio/gio.h>

#define EXR_MAX_PIXELS   (1 << 28) /* of one channel of one part */
#define EXR_MAX_CHANNELS 64

#define EXR_ERROR exr_error_quark()
GQuark exr_error_quark(void);
enum exr_error {
    EXR_ERROR_IO,
    EXR_ERROR_FORMAT, /* not an EXR, truncated, or of an unsupported kind (deep, tiled) */
    EXR_ERROR_TOO_LARGE,
    EXR_ERROR_MISSING,   /* a requested part, channel or attribute does not exist */
    EXR_ERROR_FULL,      /* the disk is full: an existing file of that name is unchanged */
    EXR_ERROR_CANCELLED, /* by the callback of exr_watch() */
};

enum exr_type { EXR_HALF, EXR_FLOAT };
enum exr_compression { EXR_NONE, EXR_ZIP, EXR_PIZ };

enum exr_kind { EXR_KIND_STRING, EXR_KIND_INT, EXR_KIND_DOUBLE, EXR_KIND_V3D };

struct exr_attribute {
    char *name;
    enum exr_kind kind;
    char *string;
    int integer;
    double v[3]; /* DOUBLE uses v[0] */
};

typedef struct exr_part {
    char *name; /* unique in the file */
    int width, height;
    int left_px, top_px; /* of exr_read_picture(): the corner of the display window; else 0 */
    gint64 outside;      /* likewise: pixels that the file does not hold, NaN in all channels */
    int n_channels;
    char **channels; /* names in alphabetical order, as EXR requires: "B","G","R" */
    float **planes;  /* one per channel, height × width, top row first; NULL if not read */
    enum exr_type type;
    GPtrArray *attributes; /* of struct exr_attribute */
} ExrPart;

typedef struct exr_file {
    GPtrArray *parts; /* of struct exr_part */
} ExrFile;

/* planes are allocated and zeroed. channels is NULL-terminated and in alphabetical order. */
struct exr_part *exr_part_new(const char *name, int width, int height, const char *const *channels,
                              enum exr_type type);
void exr_part_free(struct exr_part *part); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(ExrPart, exr_part_free)
float *exr_part_plane(const struct exr_part *part, const char *channel); /* NULL: no such */
gboolean exr_all_finite(const float *values, gsize n);

void exr_set_string(struct exr_part *part, const char *name, const char *value);
void exr_set_int(struct exr_part *part, const char *name, int value);
void exr_set_double(struct exr_part *part, const char *name, double value);
void exr_set_v3d(struct exr_part *part, const char *name, double x, double y, double z);
gboolean exr_get_string(const struct exr_part *part, const char *name, const char **ret,
                        GError **error);
gboolean exr_get_int(const struct exr_part *part, const char *name, int *ret, GError **error);
gboolean exr_get_double(const struct exr_part *part, const char *name, double *ret, GError **error);
gboolean exr_get_v3d(const struct exr_part *part, const char *name, double ret[3], GError **error);

struct exr_file *exr_file_new(void);
void exr_file_add(struct exr_file *file, struct exr_part *part); /* takes ownership */
void exr_file_free(struct exr_file *file);                       /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(ExrFile, exr_file_free)
struct exr_part *exr_file_part(const struct exr_file *file, const char *name); /* NULL: no such */

/* Writes a file. Values beyond ±65504 are written to half parts as ±65504, NaN as NaN. sync: the
 * file and its directory entry are on disk when the function returns. The bytes depend on the
 * arguments only. */
gboolean exr_write(const char *path, const struct exr_file *file, enum exr_compression compression,
                   gboolean sync, GError **error);

/* Callback: fills the planes of a part, which are all 0 before. FALSE ends the writing. */
typedef gboolean (*ExrFill)(struct exr_part *part, gpointer data, GError **error);

/* The same as exr_write() for parts that do not fit into memory together: if the planes of a part
 * are NULL, they are allocated when its turn comes, filled by the callback, and freed when it is
 * written. A part may be filled twice. */
gboolean exr_write_filled(const char *path, const struct exr_file *file,
                          enum exr_compression compression, gboolean sync, ExrFill fill,
                          gpointer data, GError **error);
/* Frees the planes of a part, which exr_write_filled() makes. */
void exr_part_drop_planes(struct exr_part *part);

/* The same as exr_write() for a file below a directory: symbolic links among the folders of the
 * relative name are not followed. */
gboolean exr_write_below(const char *directory, const char *relative, const struct exr_file *file,
                         enum exr_compression compression, gboolean sync, GError **error);

/* Sets the calling thread's callback for the share of a file (0 … 1) that has been read; FALSE
 * cancels. NULL: none. */
typedef gboolean (*ExrWatch)(double share, gpointer data);
void exr_watch(ExrWatch watch, gpointer data);

/* Read a whole file; its headers only, with planes NULL; or one part with its planes. Channels of
 * integers are read as numbers. */
struct exr_file *exr_read(const char *path, GError **error);
struct exr_file *exr_read_headers(const char *path, GError **error);
struct exr_part *exr_read_part(const char *path, const char *name, GError **error);

/* Reads a picture of others, the first part of its file: the part has the size of its display
 * window, pixels lie where the data window places them, and what the file has beyond the display
 * window is left out. (The parts of Mesorig's own files differ in size, but have one display
 * window, which means nothing.) */
struct exr_part *exr_read_picture(const char *path, GError **error);

/* SHA-256 of any file as 64 hexadecimal digits; g_free(). NULL on error. ret_bytes may be NULL. */
char *exr_sha256(const char *path, gint64 *ret_bytes, GError **error);
