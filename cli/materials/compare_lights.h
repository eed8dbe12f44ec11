/* Private header of the command compare: errors of relighting when each light is left out. */
#pragma once

#include "common/record.h"

/* Predicts the picture under each light of a session's view from the pictures under all other
 * lights, by each basis of relighting/relighting.h (PTM, HSH, RBF, kriging), and adds the errors to
 * the record. */
gboolean compare_lights(const char *session, Record *to, GError **error);
