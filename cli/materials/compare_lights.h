/* Private header of the command compare: errors of relighting when each light is left out. */
#pragma once

#include "common/record.h"

/* Measures relighting of a session's view. The picture under each light is predicted from the
 * pictures under all other lights, by each basis of relighting/relighting.h (PTM, HSH, RBF,
 * kriging). The errors are added to the record. */
gboolean compare_lights(const char *session, Record *to, GError **error);
