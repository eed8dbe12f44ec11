/* Private header of the command compare: errors of codecs at directions that were left out. */
#pragma once

#include "codecs/codecs.h"
#include "left_out.h"

struct compare_methods_asked {
    const char *path; /* the session */
    struct left_out left_out;
    const struct codec *codec; /* the only codec to measure; NULL for all codecs */
};

/* Encodes the BTF without some views and lights by each codec with its default options, and adds
 * the errors at the directions that were left out to the record. */
gboolean compare_methods(const struct compare_methods_asked *asked, Record *to, GError **error);
