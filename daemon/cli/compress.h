/* Private header of the command compress. Its methods are the entries of codecs[] and mdf_codecs[].
 */
#pragma once

#include "codecs/codecs.h"
#include "command/cli.h"
#include "mdf_codecs/mdf_codec.h"

/* One of codecs[] or of mdf_codecs[], as the command line sees it. */
struct compress_method {
    const char *name, *help;
    const struct option *options;
    gsize options_size;
    const struct codec *codec;   /* NULL for a method of mdf_codecs[] */
    const struct mdf_codec *mdf; /* NULL for a method of codecs[] */
};

struct compress_asked {
    struct compress_method method;
    const char *path, *output; /* output: NULL if not given */
    gint64 memory;             /* 0: any */
    gpointer options;          /* of method.options_size bytes */
    char *made_by; /* the command with its options, for the session's list of products */
};

/* The options of all methods, one for each name. */
const GOptionEntry *compress_entries(void);

/* Reads the options of the call. FALSE: bad usage, which has been reported. compress_clear() frees
 * it in either case. */
gboolean compress_ask(const struct call *call, struct compress_asked *ret);
void compress_clear(struct compress_asked *asked);

/* All that the result depends on besides the BTF; the same however it was written. g_free() */
char *compress_inputs(const struct compress_asked *asked);

int compress_mdf(const struct compress_asked *asked, Record *to, GError **error);
