/* The commands `mesorig import …` and `mesorig export …`. Each kind of import or export, or group
 * of similar kinds, has a file of its own, and a row in the table in import.c or exports.c. */
#pragma once

#include "common/cli.h"
#include "formats/import.h"

extern const struct command exchange_import, exchange_export;

/* The kinds of import, commands of `mesorig import`. */
extern const struct command exchange_import_btf, exchange_import_pictures, exchange_import_rti,
    exchange_import_relight, exchange_import_ptm, exchange_import_poses, exchange_import_bsdf,
    exchange_import_merl, exchange_import_utia;

/* The kinds of export, commands of `mesorig export`. */
extern const struct command exchange_btf, exchange_points, exchange_mesh, exchange_height,
    exchange_normals, exchange_web, exchange_maps, exchange_gltf, exchange_materialx, exchange_usd,
    exchange_blender, exchange_bsdf, exchange_merl, exchange_ptm, exchange_relight;

/* The format that an export writes. */
struct exchange_format {
    const char *what;   /* the plural of the product, for instance "BTFs" */
    const char *format; /* name of the format, as it precedes the word "format": "Bonn's" */
    /* the ending of the file's name, with the dot; NULL if any name is accepted */
    const char *end;
    /* the kind of product for output_file_new(); NULL if a file of this format cannot say its
     * kind */
    const char *kind;
};

/* Checks -o and returns the output file. Returns NULL with an error if -o is missing, if its name
 * lacks the ending of the format, or if the file exists and may not be replaced (output_file.h). */
OutputFile *exchange_output(const char *output, const struct exchange_format *format,
                            GError **error);
/* Checks -o of an export that writes a folder of several files; see cli_check_folder(). */
gboolean exchange_check_folder(const char *output, GError **error);

/* Reads --region. Returns FALSE if the text is not X,Y,WIDTH,HEIGHT. */
gboolean exchange_parse_region(const char *text, struct import_region *ret);

/* Reads --transfer, which is linear, srgb or not given (NULL). Returns FALSE for other texts. */
gboolean exchange_parse_transfer(const char *text, enum picture_tones *ret);
#define EXCHANGE_TRANSFER_HELP                                                                     \
    "Tone curve of the pictures (as their files say, otherwise sRGB for 8 bits and linear for "    \
    "others)"
#define EXCHANGE_TRANSFER_WRONG "there is no --transfer=%s; choose from: linear, srgb"

/* Reads a number of bytes, such as "20MB". `text` is the value of the option --NAME. If text is
 * NULL, *ret does not change. Returns FALSE on bad usage, which has then been reported. */
gboolean exchange_parse_bytes(const struct command *command, const char *name, const char *text,
                              gint64 *ret);

/* Adds the result of an import to the record. */
void exchange_tell_import(Record *to, const char *session, const struct import_result *result,
                          double seconds);
