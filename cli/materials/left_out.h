/* Private header of the command compare: the directions that are left out of a BTF. */
#pragma once

#include "codecs/codec/held_out.h"
#include "common/record.h"

struct left_out {
    int views, lights; /* numbers to leave out; −1 is the default, a tenth */
    guint32 seed;      /* draws the directions */
};

/* Parses "4", "views=4" or "lights=4" into the numbers. Returns FALSE if the text is wrong. */
gboolean left_out_parse(const char *text, struct left_out *to);

/* Draws the directions. path names the session in errors. Fails if the BTF has too few
 * directions to leave any out. */
gboolean left_out_draw(const struct left_out *left_out, const char *path,
                       const struct btf_layout *layout, struct held_out *ret, GError **error);

/* Says what was left out, and adds the directions that were left out to the record. */
void left_out_tell(Record *to, const struct left_out *left_out, const struct btf_layout *layout,
                   const struct held_out *held);
