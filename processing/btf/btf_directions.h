/* Sets of directions at which a BTF is resampled. Any thread. */
#pragma once

#include "base/data_error.h"
#include "btf_layout.h"

struct btf_directions {
    char *name; /* for messages and reports */
    struct direction_list views, lights;
};

void btf_directions_free(struct btf_directions *directions); /* NULL is ignored */

/* Returns the 81 × 81 directions of the papers (Schneider 2004 §3, Meseth et al. 2003 §2), in
 * the rings of the Bonn data. Number of directions at each θ: 1 at 0°, 6 at 15°, 12 at 30°, 18
 * at 45°, 20 at 60°, 24 at 75°. */
struct btf_directions *btf_directions_81(void);

/* Reads a table (text_table.h) with the columns "of", "theta_deg" and "phi_deg". Each row is a
 * direction. The column "of" says whether it is a direction of a view, a light or both ("view",
 * "light" or "both"). A table has 1 to 4096 views and 1 to 4096 lights. θ is 0 … 89°, and φ is −720
 * … 720°.
 *
 * The error is DATA_ERROR_INVALID if
 * - the file is not such a table
 * - a number is out of these ranges
 * - a column is missing or unknown
 * - "of" has another text
 * - a view is within 0.01° of an earlier view, or a light of an earlier light.
 *
 * The message names the file and, for an error in a row, the line. */
struct btf_directions *btf_directions_read(const char *path, GError **error);
