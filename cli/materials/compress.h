/* Private header of the command compress. The methods of the command are the entries of codecs[]
 * and mdf_codecs[]. */
#pragma once

#include "codecs/codecs.h"
#include "codecs/mdf_codecs/mdf_codec.h"
#include "common/cli.h"

/* A method on the command line: one of codecs[] or of mdf_codecs[]. */
struct compress_method {
    const char *name, *help;
    const struct option *options;
    gsize options_size;
    const struct codec *codec;   /* NULL for a method of mdf_codecs[] */
    const struct mdf_codec *mdf; /* NULL for a method of codecs[] */
};

struct compress_asked {
    struct compress_method method;
    /* path of the session; name of the output file, or NULL if it is not given */
    const char *path, *output;
    gint64 memory;    /* 0 if not limited */
    gpointer options; /* of method.options_size bytes */
    char *made_by;    /* the command line, for the session's list of products */
};

/* Returns the options of all methods. An option that several methods have appears once. */
const GOptionEntry *compress_entries(void);

/* Reads the options of the call. Returns FALSE on bad usage, which has then been reported. Call
 * compress_clear() afterwards, also after FALSE. */
gboolean compress_ask(const struct call *call, struct compress_asked *ret);
void compress_clear(struct compress_asked *asked);

/* Returns a text of everything on which the result depends, except the BTF. Options with the same
 * values give the same text, even if they were written differently. Free it with g_free(). */
char *compress_inputs(const struct compress_asked *asked);

/* Compresses an MDF by the method of `asked`, which must be one of mdf_codecs[]. Writes the result
 * to asked->output, and adds the sizes and errors to the record. Returns CLI_DONE on success. On
 * failure, returns CLI_FAILED and sets error. */
int compress_mdf(const struct compress_asked *asked, Record *to, GError **error);
