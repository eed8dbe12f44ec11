/* Private header of the command compare: errors of codecs at directions that were left out. */
#pragma once

#include "codecs/codecs.h"
#include "common/record.h"

struct compare_methods_asked {
    const char *path;          /* the session */
    int views, lights;         /* number to leave out; −1 is the default, a tenth */
    guint32 seed;              /* draws the directions */
    const struct codec *codec; /* NULL: all codecs */
};

/* Parses "4", "views=4" or "lights=4" into the numbers. Returns FALSE if the text is wrong. */
gboolean compare_methods_parse(const char *text, int *ret_views, int *ret_lights);

/* Encodes the BTF without some views and lights by each codec with its default options, and adds
 * the errors at the directions that were left out to the record. */
gboolean compare_methods(const struct compare_methods_asked *asked, Record *to, GError **error);
