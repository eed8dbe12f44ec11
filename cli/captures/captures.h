/* The commands that plan and run captures: plan, capture, status and those of a running capture. */
#pragma once

#include "common/cli.h"

extern const struct command cli_plan, cli_capture, cli_resume, cli_status, cli_watch, cli_pause,
    cli_continue, cli_finish, cli_abort, cli_safe, cli_release, cli_close, cli_drivers, cli_devices,
    cli_new_rig;
