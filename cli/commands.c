/* The table of commands, and the search for a command. */
#include "commands.h"
#include "captures/captures.h"
#include "sessions/sessions.h"

#include "base/nearest.h"
#include "calibrate/calibrate.h"
#include "captures/unattended.h"
#include "exchange/exchange.h"
#include "hands/hands.h"
#include "materials/materials.h"
#include "programs/programs.h"

#include <string.h>

/* One row per line, in the order of --help. */
// clang-format off
static const struct command *const commands[] = {
    &cli_plan,
    &cli_capture,
    &cli_resume,
    &cli_status,
    &cli_watch,
    &cli_pause,
    &cli_continue,
    &cli_finish,
    &cli_abort,
    &cli_safe,
    &cli_release,
    &cli_close,
    &unattended_queue,
    &cli_drivers,
    &cli_devices,
    &cli_new_rig,
    &hands_test,
    &programs_conformance,
    &hands_snap,
    &hands_live,
    &hands_lamp,
    &hands_laser,
    &hands_move,
    &hands_home,
    &cli_board,
    &cli_calibrate,
    &cli_process,
    &cli_compress,
    &cli_resample,
    &textures_synthesize,
    &cli_info,
    &cli_verify,
    &cli_check,
    &cli_compare,
    &cli_report,
    &exchange_import,
    &exchange_export,
    NULL,
};

/* The headings of --help. Each precedes the first command of its group. */
static const struct {
    const struct command *first;
    const char *head;
} groups[] = {
    {&cli_plan, "Capture a session"},
    {&cli_drivers, "Devices"},
    {&cli_board, "Calibrate"},
    {&cli_process, "Process a session"},
    {&cli_info, "Look at results"},
    {&exchange_import, "Exchange data with other programs"},
};
// clang-format on

const struct command *const *cli_commands(void) {
    return commands;
}

/* Lists all commands, each with the first sentence of its help. */
static void print_help(void) {
    g_print("Usage: mesorig COMMAND …\n");
    for (gsize i = 0; commands[i]; i++) {
        for (gsize k = 0; k < G_N_ELEMENTS(groups); k++)
            if (groups[k].first == commands[i])
                g_print("\n%s:\n", groups[k].head);
        const char *end = strstr(commands[i]->help, ". ");
        const int length = end ? (int)(end + 1 - commands[i]->help) : -1;
        g_print("  %-11s %.*s\n", commands[i]->name, length, commands[i]->help);
    }
    g_print("\n“mesorig COMMAND --help” describes a command. Every command takes --json.\nExit "
            "codes: 0 done, 1 failed, 2 bad usage.\n");
}

int cli_main(int argc, char **argv) {
    static const char *const help[] = {"--help", "-h", "help", NULL};
    if (argc < 2 || g_strv_contains(help, argv[1])) {
        print_help();
        return argc < 2 ? CLI_USAGE : CLI_DONE;
    }
    if (strcmp(argv[1], "--version") == 0) {
        g_print("mesorig %s\n", MESORIG_VERSION);
        return CLI_DONE;
    }
    if (strcmp(argv[1], "--complete") == 0) {
        complete_words(commands, argv + 2, argc - 2);
        return CLI_DONE;
    }
    for (gsize i = 0; commands[i]; i++)
        if (strcmp(commands[i]->name, argv[1]) == 0)
            return cli_run(commands[i], argc - 1, argv + 1);
    struct nearest nearest = nearest_new(argv[1]);
    for (gsize i = 0; commands[i]; i++)
        nearest_consider(&nearest, commands[i]->name);
    if (nearest.name)
        g_printerr("mesorig: no command “%s”: did you mean “%s”?\n", argv[1], nearest.name);
    else
        g_printerr("mesorig: no command “%s”; “mesorig --help” lists the commands\n", argv[1]);
    return CLI_USAGE;
}
