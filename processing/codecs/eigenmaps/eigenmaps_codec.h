/* Eigen-maps as a codec. */
#pragma once

#include "codecs/codec/codec.h"
#include "eigenmaps.h"

extern const struct codec eigenmaps_codec;

/* Computes n_terms eigen-maps of a whole BTF with eigenmaps_compute_with(), which gives *ret_error.
 * The progress stage is "eigenmaps"; cancelling the work is an error. eigenmaps_free() */
struct eigenmaps *eigenmaps_of_matrix(const struct btf_matrix *btf, int n_terms,
                                      const struct eigenmaps_options *options,
                                      const struct work *work, double *ret_error, GError **error);
