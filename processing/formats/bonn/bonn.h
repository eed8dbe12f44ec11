/* Reads and writes the ".btf" container of the University of Bonn's BTF database.
 *
 * Numbers are little-endian: u32, f32, and halves as in EXR. A file begins with a signature of nine
 * or ten bytes. Then follow
 *   metadata  u32 number of bytes of this block, including this number; u32 version; three texts of
 *             80 bytes (set-up, sensor, light source); f32 texels per mm; f32[3] scale of R, G, B;
 *             from version 2 on: u32 whether values contain n·l;
 *             from version 3 on: u32 length of a text, and the text (XML);
 *             from version 4 on: u32 number of channels; for each channel u32 length of its name,
 *             and the name
 *   sampling  u32 number of views; for each view f32 θ, φ (radians), u32 number of lights, and f32
 *             θ, φ of each light
 *   size      u32 width, height
 * The rest depends on the kind:
 *   BDI    Signature "!BDIF06R2!" or "!BDI06R2!". u32 scan lines per chunk; u8 storage: 0 full,
 *          2 sparse (1, bzip2, is not supported); a mask, one byte per texel, row by row; u32 n and
 *          n rotations of 9 f32; then chunks. Each chunk has u32 number of bytes, and one ABRDF of
 *          halves per texel. A sparse file has only the texels in the mask. The channel varies
 *          fastest, then the light, then the view.
 *   FMF    Signature "!FMF06FCR", or "!FMF12FCER", which has a version and further fields. One
 *          matrix, factored into U and S·V. Its rows are (view, light, channel) and its columns
 *          texels, or its rows are (texel, channel) and its columns (view, light).
 *   DFMF   Signature "!DFMF08FCR". One matrix per channel. A colour model has made the channels
 *          independent before the factorisation.
 *
 * Matrices are stored row by row. Texels are stored row by row too, and the first row is at +y.
 * Hostile files are refused: all sizes are compared with the file's length before memory is
 * allocated. One BonnFile may be read from several threads at the same time. */
#pragma once

#include <glib.h>

#define BONN_ERROR bonn_error_quark()
GQuark bonn_error_quark(void);
enum bonn_error {
    BONN_ERROR_IO,
    BONN_ERROR_FORMAT, /* the file is not a ".btf", or is truncated or inconsistent */
    /* the file is of a kind that is not supported; the message says which */
    BONN_ERROR_UNSUPPORTED,
    BONN_ERROR_FULL, /* the disk is full */
};

#define BONN_CHANNELS 3

enum bonn_kind { BONN_BDI, BONN_BDI_SPARSE, BONN_FMF, BONN_DFMF };

struct bonn_header {
    enum bonn_kind kind;
    char *setup, *sensor, *light_source,
        *xml; /* texts, converted to UTF-8; the writer writes NULL as "" */
    double texels_a_mm;
    double rgb_scale[BONN_CHANNELS]; /* scale of R, G, B in the file, which is not applied */
    gboolean cosine;                 /* whether values contain n·l */
    /* number of rotations in the file; they are for local frames, and are not applied */
    int n_rotations;
    int width, height;                      /* texels */
    int n_views, n_lights;                  /* the same lights for every view */
    float *view_theta_deg, *view_phi_deg;   /* directions of the n_views views */
    float *light_theta_deg, *light_phi_deg; /* directions of the n_lights lights */
};

void bonn_header_clear(struct bonn_header *header);

/* Convert between a kind and its name: "bdi", "sparse", "fmf" or "dfmf". bonn_kind_parse() returns
 * FALSE if no kind has the name. */
const char *bonn_kind_name(enum bonn_kind kind);
gboolean bonn_kind_parse(const char *name, enum bonn_kind *ret);

typedef struct BonnFile BonnFile;

/* Opens a file. The values of a BDI are read from the file when a view is read, so that a BDI of
 * many gigabytes takes no memory. The matrices of FMF and DFMF are kept in memory as floats. */
BonnFile *bonn_open(const char *path, GError **error);
void bonn_close(BonnFile *file); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(BonnFile, bonn_close)

const struct bonn_header *bonn_header(const BonnFile *file);

/* Reads one view to ret_rgb, n_lights × height × width × 3 (R, G, B). Values are as stored, except
 * that logarithms and colour models are undone. Texels that the mask leaves out, and texels with a
 * value that is not finite, are 0. ret_holes (n_lights) receives the number of such texels for each
 * light. Returns FALSE with an error if the file cannot be read, or has become shorter since it was
 * opened. */
gboolean bonn_read_view(const BonnFile *file, int view, float *ret_rgb, int *ret_holes,
                        GError **error);

/* Consecutive views of a BDI, in memory as halves. A file has the views of each texel together, so
 * that several views are read in little more time than one. */
typedef struct BonnViews BonnViews;
/* Reads views first … first + n − 1 of a BDI. The work is divided among n_threads threads (0: one
 * per processor). Returns NULL with an error as bonn_read_view() does. */
BonnViews *bonn_views_read(const BonnFile *file, int first, int n, int n_threads, GError **error);
void bonn_views_free(BonnViews *views); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(BonnViews, bonn_views_free)
/* Copies the picture of one view and light to ret_rgb (height × width × 3), with the values that
 * bonn_read_view() gives. Returns the number of texels without values. Any thread. */
int bonn_views_picture(const BonnViews *views, int view, int light, float *ret_rgb);

/* Writes a BDI view by view, in any order. bonn_writer_finish() syncs the file and gives it its
 * name. */
typedef struct BonnWriter BonnWriter;

/* header->kind is BONN_BDI or BONN_BDI_SPARSE. The necessary parts of the header are copied. mask
 * has one byte for each texel: 0 if the texel has no values. mask = NULL means that all texels have
 * values. */
BonnWriter *bonn_writer_new(const char *path, const struct bonn_header *header, const guint8 *mask,
                            GError **error);
/* deletes the data of a file that is not finished; NULL is ignored */
void bonn_writer_free(BonnWriter *writer);
G_DEFINE_AUTOPTR_CLEANUP_FUNC(BonnWriter, bonn_writer_free)

/* Writes one view. rgb has the layout of ret_rgb in bonn_read_view(). Values beyond ±65504 are
 * written as ±65504. */
gboolean bonn_writer_view(BonnWriter *writer, int view, const float *rgb, GError **error);
/* Writes views first … first + n − 1, with the texels divided among n_threads threads (0: one per
 * processor). halves has n_texels × n × n_lights × 3 halves in the byte order of the file
 * (exr_half_from_floats()), so that the n views of a texel are written together. */
gboolean bonn_writer_views(BonnWriter *writer, int first, int n, const guint16 *halves,
                           int n_threads, GError **error);
gboolean bonn_writer_finish(BonnWriter *writer, GError **error);

/* One matrix M ≈ U · (S·V)ᵀ in row-major factors. */
struct bonn_factors {
    int n_components, n_rows, n_columns;
    const float *s;  /* n_components singular values, for information */
    const float *u;  /* n_rows × n_components */
    const float *sv; /* n_columns × n_components */
};

/* Writes factors as halves. The kind BONN_FMF has one matrix with rows (view, light, channel) and
 * columns (texel). BONN_DFMF has three matrices with rows (view, light), one each for R, G and B.
 * The colours are written without a transformation. */
gboolean bonn_write_factors(const char *path, const struct bonn_header *header,
                            const struct bonn_factors *factors, GError **error);
