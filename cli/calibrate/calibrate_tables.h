/*
 * This module writes the tables of `mesorig calibrate report` about lamps, lasers and light, as
 * HTML. Any thread may call the functions.
 */
#pragma once

#include "calibration/calibration.h"

/* Add tables of the lamps, of the lasers, and of the light. Nothing is added for a part that was
 * not calibrated. */
void calibrate_table_lamps(GString *to, const struct calibration *calibration);
void calibrate_table_lasers(GString *to, const struct calibration *calibration);
void calibrate_table_light(GString *to, const struct calibration *calibration);
