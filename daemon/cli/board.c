/* board: calibration boards to print. */
#include "cameras/board.h"
#include "cli.h"

static char *board_option;
static double margin_mm, pixels_a_mm;
static const GOptionEntry entries[] = {
    {"board", 'b', 0, G_OPTION_ARG_STRING, &board_option,
     "Squares across and down, their size and their markers', in mm; without marker a chessboard",
     "8x8,square=9,marker=6.75,dictionary=4x4_50"},
    {"margin", 0, 0, G_OPTION_ARG_DOUBLE, &margin_mm, "White around the board, 0 if not given",
     "MM"},
    {"pixels", 0, 0, G_OPTION_ARG_DOUBLE, &pixels_a_mm,
     "Pixels a millimetre of a PNG, 10 if not given", "N"},
    {NULL},
};

static void cli_board_tell(const struct board *board, const char *path) {
    g_autofree char *spec = board_spec(board);
    if (cli_json) {
        GVariantBuilder builder;
        g_variant_builder_init(&builder, G_VARIANT_TYPE_VARDICT);
        g_variant_builder_add(&builder, "{sv}", "file", g_variant_new_string(path));
        g_variant_builder_add(&builder, "{sv}", "board", g_variant_new_string(spec));
        g_variant_builder_add(&builder, "{sv}", "corners",
                              g_variant_new_int32(board_n_corners(board)));
        cli_print_json(g_variant_builder_end(&builder));
    } else {
        g_print("%s: %g × %g mm, %d corners\nPrint it at its true size, glue it to something flat, "
                "measure some squares, and give what you measured:\n  --board %s\n",
                path, board->columns * board->square_mm, board->rows * board->square_mm,
                board_n_corners(board), spec);
    }
}

static int cli_board_run(const struct command *command, int argc, char **argv) {
    g_autoptr(GError) error = NULL;
    struct board board;
    margin_mm = 0;
    pixels_a_mm = 10;
    if (!cli_parse(command, entries, FALSE, &argc, &argv, 1, 1))
        return CLI_USAGE;
    if (!board_option)
        return cli_usage(command, "which board? Give --board");
    if (!(margin_mm >= 0 && margin_mm <= 1000) || !(pixels_a_mm > 0 && pixels_a_mm <= 1000))
        return cli_usage(command, "--margin is 0 to 1000 mm and --pixels up to 1000 a mm");
    if (!board_parse(&board, board_option, &error))
        return cli_usage(command, "%s", error->message);
    const struct board_drawing drawing = {margin_mm, pixels_a_mm};
    if (!board_draw(&board, argv[1], &drawing, &error))
        return cli_fail(error);
    cli_board_tell(&board, argv[1]);
    return CLI_DONE;
}

const struct command cli_board = {.name = "board",
                                  .arguments = "FILE.svg|FILE.pdf|FILE.png",
                                  .help = "Draw a calibration board to print.",
                                  .run_arguments = cli_board_run};
