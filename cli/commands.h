/* The table of all commands, and the program mesorig. */
#pragma once

#include "common/cli.h"
