/* The commands for materials: compress, compare and synthesize. */
#pragma once

#include "common/cli.h"

extern const struct command cli_compress, cli_compare, textures_synthesize;
