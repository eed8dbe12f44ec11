/*
 * The material of a session, while the session is captured. It consists of the pictures under lamps
 * that exist so far. Each picture is rectified to a small grid of texels and divided by the
 * radiance of a white diffuser, as in the BTF (btf/btf.h). Pictures are kept in memory, 4 bytes per
 * texel (shared_exponent.h). A pair (view, light) has the index view · n_lights + light. The files
 * of the session are only read.
 *
 * The differences from the BTF are:
 * - The grid is coarser.
 * - Each picture of a colour filter is its own guide (frames/rectify.h), because the other pictures
 *   of the view do not exist yet.
 * - The output of a lamp is the one that is known when its picture is read.
 *
 * A Partial belongs to one thread at a time. A struct partial_sample may be used by another thread.
 */
#pragma once

#include "selection/session_pairs.h"

typedef struct Partial Partial;

/* Maximum width and height of the grid in texels, and maximum memory for all pictures. */
#define PARTIAL_MAX_TEXELS 128
#define PARTIAL_MAX_BYTES  ((gsize)256 << 20)

/* Opens a session that is or was being captured. The grid has the proportions of the session's
 * grid. The error is DATA_ERROR_INCOMPLETE if the session has no views or no lights. Other errors
 * are those of session_open() and of reading the session. */
Partial *partial_open(const char *directory, GError **error);
void partial_free(Partial *partial); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Partial, partial_free)

const struct session_grid *partial_grid(const Partial *partial);
const GPtrArray *partial_views(const Partial *partial); /* of struct session_direction */
const GPtrArray *partial_lights(const Partial *partial);
int partial_n_pairs(const Partial *partial);
int partial_n_measured(const Partial *partial);

/* Reads the pictures that were committed since the last call, at most `most` of them, in the order
 * of their shots. ret_pairs (of int) receives their pairs, which are appended. A picture whose shot
 * was taken again is read again.
 *
 * A file that cannot be read is left out, and so is a picture whose camera does not see the whole
 * sample. If *ret_problem is NULL, it then receives a line about the cause; g_free(). Returns FALSE
 * with an error if the session cannot be read. */
gboolean partial_read(Partial *partial, int most, GArray *ret_pairs, char **ret_problem,
                      GError **error);

/* Returns the picture of a pair: height × width texels (shared_exponent.h), row by row. Returns
 * NULL if the pair is not measured. The bytes never change. They are owned by the Partial; take a
 * reference to keep them. */
GBytes *partial_picture(const Partial *partial, int pair);

/* What a prediction needs: the values of some texels (the probes), and the pairs that the remaining
 * shots will take. */
struct partial_sample {
    const struct prediction_pairs *pairs; /* borrowed from the Partial, constant */
    int n_probes, n_measured;
    float *values;      /* n_probes × 3 × n_pairs, NAN if not measured */
    struct vec3 *at_mm; /* positions of the n_probes probes in the sample frame */
    /* planned: the n_planned pairs that are not measured yet, in the planned order of their shots
     * shots: for each of these pairs, the number of shots that must still be taken until the pair
     *   is measured */
    int n_planned, *planned, *shots;
};
#define PARTIAL_PROBES 96

/* Returns NULL if the session cannot be read. */
struct partial_sample *partial_sample(Partial *partial, GError **error);
void partial_sample_free(struct partial_sample *sample); /* NULL is ignored */

/* Returns the point of the reference plane at a fractional column and row, in the sample frame.
 * Whole numbers are the centres of texels. */
struct vec3 partial_point_mm(const Partial *partial, double column, double row);
