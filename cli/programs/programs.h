/* The command conformance, for programs that operate devices. */
#pragma once

#include "common/cli.h"

extern const struct command programs_conformance;
