/* Drivers of lamps that are reached by UDP. The driver of WLED also uses HTTP. */
#pragma once

#include "drivers/lamps.h"

extern const struct lamps_driver artnet_lamps_driver;
extern const struct lamps_driver sacn_lamps_driver;
extern const struct lamps_driver wled_lamps_driver;
