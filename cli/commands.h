/* The table of all commands, and the program mesorig. */
#pragma once

#include "common/cli.h"

/* Returns all commands. The table ends with NULL. */
const struct command *const *cli_commands(void);

/* Completes words for --complete: prints the candidates for the last of n words that follow the
 * program's name. Each line has the word, a tab, and its description. */
void complete_words(const struct command *const *commands, char *const *words, int n);

/* Runs the whole program mesorig: finds the command and runs it. Returns an exit code. */
int cli_main(int argc, char **argv);
