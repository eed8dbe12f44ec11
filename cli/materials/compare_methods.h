/* Private header of the command compare: errors of codecs at directions that were left out. */
#pragma once

#include "codecs/codecs.h"
#include "left_out.h"

struct compare_methods_asked {
    const char *path; /* the session */
    struct left_out left_out;
    const struct codec *codec; /* the only codec to measure; NULL for all codecs */
};

/* Measures codecs at directions that were left out. The BTF without these views and lights is
 * encoded by each codec with its default options. The errors at these views and lights are added to
 * the record. */
gboolean compare_methods(const struct compare_methods_asked *asked, Record *to, GError **error);
