/* The part of bench_compression on eigen-maps of a BTF in a file of halves, of which only so much
 * may be in memory: the exact way against the randomised one. */
#pragma once

#include <glib.h>

struct btf_matrix;

/* As bench_disk(); columns: views that fit into memory. Returns what a program does. */
int bench_eigenmaps(struct btf_matrix *like,
                    float (*value)(int texel, int view, int light, int colour), int columns,
                    gboolean json);
