/*
 * The ".btf" container of the University of Bonn's BTF database, read and written.
 *
 * Little-endian; u32, f32, and halves as EXR has them. After a signature of ten bytes:
 *   metadata  u32 bytes of this block, itself included; u32 version; three texts of 80 bytes
 *             (set-up, sensor, light source); f32 texels per mm; f32[3] scale of R, G, B; from
 *             version 2 on u32 whether values hold n·l; from 3 on u32 length and text (XML);
 *             from 4 on u32 channels, for each u32 length and name
 *   sampling  u32 views; for each view f32 θ, φ (radians), u32 lights, and θ, φ of each light
 *   size      u32 width, height
 * and then one of these:
 *   BDI    "!BDIF06R2!" or "!BDI06R2!". u32 scan lines per chunk; u8 0: full, 2: sparse (1, bzip2,
 *          is not read); a mask, one byte per texel, row by row; u32 n and n rotations of 9 f32;
 *          then chunks, each u32 bytes and one ABRDF of halves per texel (in a sparse file, only
 *          of the texels in the mask), channel fastest, then light, then view
 *   FMF    "!FMF06FCR", or "!FMF12FCER", which has a version and further fields. A matrix of rows
 *          (view, light, channel) and columns (texel), or of rows (texel, channel) and columns
 *          (view, light), in factors U and S·V
 *   DFMF   "!DFMF08FCR". One matrix per channel; one of several models has made the channels
 *          independent
 *
 * Rows of all matrices, and texels, lie row by row, the first row of texels at +y. Hostile files
 * are refused: everything is checked against the file's length before it is allocated. One BonnFile
 * may be read from several threads at once.
 */
#pragma once

#include <gio/gio.h>

#define BONN_ERROR bonn_error_quark()
GQuark bonn_error_quark(void);
enum bonn_error {
    BONN_ERROR_IO,
    BONN_ERROR_FORMAT,      /* not such a file, truncated, or it contradicts itself */
    BONN_ERROR_UNSUPPORTED, /* of a kind that is not read; says which */
    BONN_ERROR_FULL,        /* the disk is full */
};

#define BONN_CHANNELS 3

enum bonn_kind { BONN_BDI, BONN_BDI_SPARSE, BONN_FMF, BONN_DFMF };

struct bonn_header {
    enum bonn_kind kind;
    char *setup, *sensor, *light_source, *xml; /* made UTF-8; NULL is empty, when written */
    double texels_a_mm;
    double rgb_scale[BONN_CHANNELS];        /* as the file says; not applied */
    gboolean cosine;                        /* values hold n·l */
    int n_rotations;                        /* of local frames; not applied */
    int width, height;                      /* texels */
    int n_views, n_lights;                  /* the same lights for every view */
    float *view_theta_deg, *view_phi_deg;   /* n_views */
    float *light_theta_deg, *light_phi_deg; /* n_lights */
};

void bonn_header_clear(struct bonn_header *header);

const char *bonn_kind_name(enum bonn_kind kind); /* "bdi", "sparse", "fmf", "dfmf" */
gboolean bonn_kind_parse(const char *name, enum bonn_kind *ret);

typedef struct BonnFile BonnFile;

/* Values of a BDI are read from the file when a view is read, so that a BDI of many gigabytes takes
 * no memory; matrices of FMF and DFMF are held as floats. */
BonnFile *bonn_open(const char *path, GError **error);
void bonn_close(BonnFile *file); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(BonnFile, bonn_close)

const struct bonn_header *bonn_header(const BonnFile *file);

/* One view: n_lights × height × width × 3 (R, G, B), as stored, with logarithms undone. Texels that
 * the mask leaves out, or that have a value that is not finite, are 0; ret_holes (n_lights) counts
 * them for each light. FALSE: the file has been cut off since it was opened. */
gboolean bonn_read_view(const BonnFile *file, int view, float *ret_rgb, int *ret_holes,
                        GError **error);

/* Writing a BDI, a view at a time in any order. The file appears, synced, when it is finished. */
typedef struct BonnWriter BonnWriter;

/* header->kind is BONN_BDI or BONN_BDI_SPARSE; the header is copied as far as needed. mask: one
 * byte per texel, 0 where there is no texel; NULL: all are there. */
BonnWriter *bonn_writer_new(const char *path, const struct bonn_header *header, const guint8 *mask,
                            GError **error);
void bonn_writer_free(BonnWriter *writer); /* what is not finished is removed; NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(BonnWriter, bonn_writer_free)

/* rgb as bonn_read_view() gives it. Values beyond ±65504 are written as ±65504. */
gboolean bonn_writer_view(BonnWriter *writer, int view, const float *rgb, GError **error);
gboolean bonn_writer_finish(BonnWriter *writer, GError **error);

/* One matrix M ≈ U · (S·V)ᵀ in row-major factors. */
struct bonn_factors {
    int n_components, n_rows, n_columns;
    const float *s;  /* n_components singular values, for information */
    const float *u;  /* n_rows × n_components */
    const float *sv; /* n_columns × n_components */
};

/* kind BONN_FMF: one matrix with rows (view, light, channel) and columns (texel); BONN_DFMF: three
 * matrices with rows (view, light), one each for R, G and B, which are not transformed. Writes
 * halves. */
gboolean bonn_write_factors(const char *path, const struct bonn_header *header,
                            const struct bonn_factors *factors, GError **error);
