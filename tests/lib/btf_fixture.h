/* A BTF for tests. All values are 0, and the directions differ from each other. */
#pragma once

#include "btf/btf_matrix.h"
#include "direction.h"

typedef struct btf_matrix BtfMatrix;
G_DEFINE_AUTOPTR_CLEANUP_FUNC(BtfMatrix, btf_matrix_free)

struct btf_matrix *btf_fixture_new(const char *name, int width, int height, int n_views,
                                   int n_lights);
/* Makes the BTF and takes ownership of the directions. */
struct btf_matrix *btf_fixture_of(const char *name, int width, int height,
                                  struct direction_list views, struct direction_list lights);

/* Returns n directions. Direction i has i times each of the two angles. */
struct direction_list btf_fixture_line(int n, float theta_deg, float phi_deg);
/* Returns the pole, and 6, 12, 18 … directions on rings at equal distances down to most_deg. All
 * rings are turned by turn_deg. */
struct direction_list btf_fixture_rings(int rings, float most_deg, float turn_deg);
/* Returns six directions at 25° from the normal, and six at 55°, whose azimuths are between those
 * of the first six. */
struct direction_list btf_fixture_two_rings(float turn_deg);

struct vec3 btf_fixture_direction(const struct direction_list *list, gsize k);
