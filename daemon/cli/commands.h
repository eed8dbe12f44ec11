/* The commands that have no room of their own. */
#pragma once

#include "command/cli.h"

extern const struct command cli_plan, cli_capture, cli_resume, cli_status, cli_watch, cli_pause,
    cli_continue, cli_abort, cli_safe, cli_release, cli_close, cli_process, cli_compress,
    cli_compare, cli_check, cli_board, cli_info, cli_drivers, cli_devices, cli_resample, cli_verify,
    cli_report;

/* All commands; the table ends with NULL. */
const struct command *const *cli_commands(void);

/* For mesorig --complete: prints what may be in the place of the last of n words that follow the
 * program's name, a line each: the word, a tab, and what it means. */
void complete_words(const struct command *const *commands, char *const *words, int n);

/* The whole program mesorig: finds the command and runs it. Returns an exit code. */
int cli_main(int argc, char **argv);
