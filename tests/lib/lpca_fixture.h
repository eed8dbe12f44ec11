/* BTFs that local PCAs are made of in tests, and whether two of those are one. */
#pragma once

#include "btf_fixture.h"
#include "codecs/lpca/lpca.h"

int lpca_fixture_row_length(const struct btf_matrix *btf);

/* Texel i is of group i % groups: a mean, and a random sum of that group's own directions. */
struct btf_matrix *lpca_fixture_mixture(int width, int height, int n_views, int n_lights,
                                        int groups, int rank, double noise);
void lpca_fixture_assert_same(const struct lpca *a, const struct lpca *b);
