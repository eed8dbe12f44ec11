/* The command `mesorig synthesize`: larger materials from samples. */
#pragma once

#include "command/cli.h"

extern const struct command textures_synthesize;
