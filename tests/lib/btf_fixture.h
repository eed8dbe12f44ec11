/* A BTF for tests: 0 everywhere, directions that tell one from another. */
#pragma once

#include "btf/btf_matrix.h"

typedef struct btf_matrix BtfMatrix;
G_DEFINE_AUTOPTR_CLEANUP_FUNC(BtfMatrix, btf_matrix_free)

struct btf_matrix *btf_fixture_new(const char *name, int width, int height, int n_views,
                                   int n_lights);
