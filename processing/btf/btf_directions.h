/* Sets of directions to resample a BTF to. Any thread. */
#pragma once

#include "base/data_error.h"
#include "btf_layout.h"

struct btf_directions {
    char *name; /* for messages and reports */
    struct direction_list views, lights;
};

void btf_directions_free(struct btf_directions *directions); /* NULL is ignored */

/* The papers' 81 × 81 (Schneider 2004 §3, Meseth et al. 2003 §2), in Bonn's rings: 0°: 1, 15°: 6,
 * 30°: 12, 45°: 18, 60°: 20, 75°: 24. */
struct btf_directions *btf_directions_81(void);

/* Reads a table (text_table.h) with the columns of, theta_deg and phi_deg; of: "view", "light" or
 * "both". DATA_ERROR_INVALID with file and line: θ is not within 0 … 89°, a direction repeats,
 * there is no view or no light, or there are more than 4096. */
struct btf_directions *btf_directions_read(const char *path, GError **error);
