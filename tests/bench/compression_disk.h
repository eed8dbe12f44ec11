/* The part of bench_compression on BTFs larger than memory: a local PCA from a file of halves,
 * against reading that file and the two products of matrices that no local PCA can do without. */
#pragma once

#include <glib.h>

struct btf_matrix;

/* like: sizes and directions; value: of a texel, view, light and colour. Returns what a program
 * does. */
int bench_disk(struct btf_matrix *like, float (*value)(int texel, int view, int light, int colour),
               int clusters, int components, gboolean json);

/* Gives btf its values in a file, view by view, so that no more than one is in memory. */
gboolean bench_fill(struct btf_matrix *btf,
                    float (*value)(int texel, int view, int light, int colour), GError **error);

double bench_peak_mib(void); /* resident memory of this process at most so far */
