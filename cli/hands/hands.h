/* The commands for devices by hand: snap, live, lamp, laser, move, home and test. */
#pragma once

#include "common/cli.h"

extern const struct command hands_snap, hands_live, hands_lamp, hands_laser, hands_move, hands_home,
    hands_test;
