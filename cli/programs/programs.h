/* The command for programs that are devices: conformance. */
#pragma once

#include "common/cli.h"

extern const struct command programs_conformance;
