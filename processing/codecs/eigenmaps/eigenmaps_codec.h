/* Eigen-maps as a codec. */
#pragma once

#include "codecs/codec/codec.h"
#include "eigenmaps.h"

extern const struct codec eigenmaps_codec;

/* Computes the eigen-maps of a whole matrix. The progress stage is "eigenmaps". */
struct eigenmaps *eigenmaps_of_matrix(const struct btf_matrix *btf, int n_terms,
                                      const struct eigenmaps_options *options,
                                      const struct work *work, double *ret_error, GError **error);
