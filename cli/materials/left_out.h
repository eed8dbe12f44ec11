/* Private header of the command compare: the directions that are left out of a BTF. */
#pragma once

#include "codecs/codec/held_out.h"
#include "common/record.h"

struct left_out {
    int views, lights; /* numbers of views and lights to leave out; −1 means the default, a tenth */
    guint32 seed;      /* seed of the random choice of the directions */
};

/* Parses "4", "views=4" or "lights=4" into the numbers. Returns FALSE if the text is wrong. */
gboolean left_out_parse(const char *text, struct left_out *to);

/* Chooses the directions at random. path names the session in errors. Returns FALSE with an error
 * if the BTF has too few directions to leave any out. */
gboolean left_out_draw(const struct left_out *left_out, const char *path,
                       const struct btf_layout *layout, struct held_out *ret, GError **error);

/* Tells the user how many directions were left out, and adds these directions to the record. */
void left_out_tell(Record *to, const struct left_out *left_out, const struct btf_layout *layout,
                   const struct held_out *held);
