/* BTFs from which tests compute local PCAs, and a comparison of two local PCAs. */
#pragma once

#include "btf_fixture.h"
#include "codecs/lpca/lpca.h"

int lpca_fixture_row_length(const struct btf_matrix *btf);

/* Makes a BTF in which texel i belongs to group i % groups. The values of a texel are the mean of
 * its group, plus a random combination of `rank` vectors of the group, plus uniform noise from
 * −noise to noise. A vector has one number for each value of a texel. */
struct btf_matrix *lpca_fixture_mixture(int width, int height, int n_views, int n_lights,
                                        int groups, int rank, double noise);
void lpca_fixture_assert_same(const struct lpca *a, const struct lpca *b);
