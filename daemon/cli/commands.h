/* The commands that are not in a room with other commands. */
#pragma once

#include "command/cli.h"

extern const struct command cli_plan, cli_capture, cli_resume, cli_status, cli_watch, cli_pause,
    cli_continue, cli_abort, cli_safe, cli_release, cli_close, cli_process, cli_compress,
    cli_compare, cli_check, cli_board, cli_info, cli_drivers, cli_devices, cli_resample, cli_verify,
    cli_report;

/* Returns all commands. The table ends with NULL. */
const struct command *const *cli_commands(void);

/* For mesorig --complete. Prints the candidates for the last of n words that follow the program's
 * name. Each line has the word, a tab, and its description. */
void complete_words(const struct command *const *commands, char *const *words, int n);

/* Runs the whole program mesorig: finds the command and runs it. Returns an exit code. */
int cli_main(int argc, char **argv);
