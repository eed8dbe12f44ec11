/* Prepares the content of products/eigenmaps.exr. Any thread. */
#pragma once

#include "catalogue.h"
#include "codecs/eigenmaps/eigenmaps.h"

/* Returns the eigen-maps of some views and all lights, ready to be computed: all members are set
 * except weights and maps. views has indices into the catalogue's views. Free with
 * eigenmaps_free(). */
struct eigenmaps *eigenmaps_product_new(const char *name, const struct catalogue *catalogue,
                                        const int *views, int n_views, int n_terms);
