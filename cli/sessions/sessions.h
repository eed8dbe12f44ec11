/* The commands for a session directory: process, check, verify, info, report and resample. */
#pragma once

#include "common/cli.h"

extern const struct command cli_process, cli_check, cli_info, cli_verify, cli_report, cli_resample;
