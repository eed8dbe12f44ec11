/* What compress shares with compare. */
#pragma once

#include "processing/eigenmaps.h"
#include "processing/lpca.h"

/* Eigen-maps of a whole matrix; stage "eigenmaps". progress may not be NULL. */
struct eigenmaps *compress_eigenmaps(const struct btf_matrix *btf, int n_terms,
                                     PipelineFunc progress, gpointer data,
                                     GCancellable *cancellable, double *ret_error, GError **error);
