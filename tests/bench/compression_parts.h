/* The parts of bench_compression, a file each. They return the exit status. */
#pragma once

#include <glib.h>

struct btf_matrix;

/* Of a texel, view, light and colour. */
typedef float (*BenchValue)(int texel, int view, int light, int colour);

/* BTFs larger than memory: a local PCA from a file of halves, against reading that file and the two
 * products of matrices that no local PCA can do without. like: sizes and directions. */
int bench_disk(struct btf_matrix *like, BenchValue value, int clusters, int components);

/* Gives btf its values in a file, view by view, so that no more than one is in memory. */
gboolean bench_fill(struct btf_matrix *btf, BenchValue value, GError **error);

double bench_peak_mib(void); /* resident memory of this process at most so far */

/* Eigen-maps of a BTF in a file of half floats, with a limited number of columns (views) in memory:
 * compares the exact way with the randomised one. */
int bench_eigenmaps(struct btf_matrix *like, BenchValue value, int columns);

/* Models of a texel: errors of reflectance fields, polynomials and Lafortune models (Meseth et al.
 * 2003, Table 1) of these sessions, and the batch solver against others. fits: so many problems of
 * each session are given to all solvers. */
int bench_fields(char *const *sessions, int fits);

int bench_mdf_compression(char **sessions); /* sessions: NULL-ended */

/* Wall time and CPU time of mesorig-compress-mpi on a session, with 1, 2 and 4 processes of one
 * thread. */
int bench_ranks(const char *session, int clusters, int components);

/* Error against size: local PCAs of a noisy capture, compared with the same capture without noise,
 * besides those as they were published. sessions: a capture and the same without noise, pair by
 * pair. every: every N-th view is taken. */
int bench_rate(char *const *sessions, int every);

/* One way to store a material. */
struct bench_point {
    char *label; /* g_free() */
    double bytes, error;
};

/* points: of struct bench_point. Leaves out those that a smaller one is as good as, in order of
 * size. */
void bench_keep_best(GArray *points);

/* Measures a capture and the same without noise. */
typedef void (*BenchPair)(const struct btf_matrix *noisy, const struct btf_matrix *quiet,
                          GError **error);

/* Measures each pair of sessions, as bench_rate() takes them, within a list of this name. option is
 * that of the command line. */
int bench_pairs(char *const *sessions, int every, const char *option, const char *list,
                BenchPair measure_pair);

/* What a local PCA could take that is drawn from codes of fixed length, chosen for each component,
 * and for each component and light of its eigen-BRDFs: all are rounded to one step. Errors and
 * arguments as of bench_rate(). */
int bench_bits(char *const *sessions, int every);

/* Eigen-BRDFs on a grid: what that costs at and between the measured directions, against
 * interpolation of the measured ones by nine pairs. sessions: a material and the same from
 * directions between, pair by pair. */
int bench_resample(char *const *sessions, int clusters, int components);
