/* Prepares the content of products/eigenmaps.exr. Any thread. */
#pragma once

#include "catalogue.h"
#include "codecs/eigenmaps/eigenmaps.h"

/* Returns the eigen-maps of some views (indices of the catalogue's) and all lights, ready to be
 * computed: all members are set except weights and maps. eigenmaps_free() */
struct eigenmaps *eigenmaps_product_new(const char *name, const struct catalogue *catalogue,
                                        const int *views, int n_views, int n_terms);
