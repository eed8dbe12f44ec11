/* A BTF for tests: 0 everywhere, directions that tell one from another. */
#pragma once

#include "btf/btf_matrix.h"

typedef struct btf_matrix BtfMatrix;
G_DEFINE_AUTOPTR_CLEANUP_FUNC(BtfMatrix, btf_matrix_free)

struct btf_matrix *btf_fixture_new(const char *name, int width, int height, int n_views,
                                   int n_lights);
/* Takes the directions. */
struct btf_matrix *btf_fixture_of(const char *name, int width, int height,
                                  struct direction_list views, struct direction_list lights);

/* Direction i at i times both angles. */
struct direction_list btf_fixture_line(int n, float theta_deg, float phi_deg);
/* The pole, and 6, 12, 18 … directions on rings of equal distance down to most_deg, each turned. */
struct direction_list btf_fixture_rings(int rings, float most_deg, float turn_deg);
/* Six directions at 25° from the normal, and six at 55° between them. */
struct direction_list btf_fixture_two_rings(float turn_deg);
