/* What products/eigenmaps.exr is made of. Any thread. */
#pragma once

#include "catalogue.h"
#include "eigenmaps/eigenmaps.h"

/* Eigen-maps of some views (indices of the catalogue's) and all lights, to be computed: everything
 * is set but weights and maps. eigenmaps_free() */
struct eigenmaps *eigenmaps_product_new(const char *name, const struct catalogue *catalogue,
                                        const int *views, int n_views, int n_terms);
