/* board: draws calibration boards to print. */
#include "cameras/board.h"
#include "calibrate.h"
#include "common/cli.h"

static char *board_option;
static double margin_mm, pixels_a_mm = 10;
static const GOptionEntry entries[] = {
    {"board", 'b', 0, G_OPTION_ARG_STRING, &board_option,
     "Numbers of squares across and down, and their size and that of their markers in mm; without "
     "marker= it is a chessboard; mesorig(1) also has grids of markers and of circles",
     "8x8,square=9,marker=6.75,dictionary=4x4_50"},
    {"margin", 0, 0, G_OPTION_ARG_DOUBLE, &margin_mm,
     "White margin around the board (0 if not given)", "MM"},
    {"pixels", 0, 0, G_OPTION_ARG_DOUBLE, &pixels_a_mm,
     "Pixels per millimetre of a PNG (10 if not given)", "N"},
    {NULL},
};

static int run(const struct call *call, GError **error) {
    g_autoptr(GError) bad = NULL;
    const char *path = call->arguments[0];
    struct board board;
    if (!board_option)
        return cli_usage(call->command, "no board is given: give --board");
    if (!(margin_mm >= 0 && margin_mm <= 1000))
        return cli_usage(call->command, "--margin=%g is out of range: give 0 to 1000 mm",
                         margin_mm);
    if (!(pixels_a_mm > 0 && pixels_a_mm <= 1000))
        return cli_usage(call->command,
                         "--pixels=%g is out of range: give more than 0 and at most 1000 per mm",
                         pixels_a_mm);
    if (!board_parse(&board, board_option, &bad))
        return cli_usage(call->command, "%s", bad->message);
    const struct board_drawing drawing = {margin_mm, pixels_a_mm};
    g_autoptr(OutputFile) to = cli_output(path, "board", error);
    const char *written = to ? output_file_path(to, error) : NULL;
    if (!written || !output_file_end(to, board_draw(&board, written, &drawing, error), error))
        return CLI_FAILED;
    double size[2];
    board_size_mm(&board, size);
    g_autofree char *spec = board_spec(&board);
    record_say(call->record,
               "%s{file}: %g × %g mm, %d{corners} corners\nPrint it at its true size, glue it to "
               "something flat, measure it, and give the measured sizes:\n  --board %s{board}\n",
               path, size[0], size[1], board_n_corners(&board), spec);
    cli_tell_output(call->record, to);
    return CLI_DONE;
}

const struct command cli_board = {
    .name = "board",
    .arguments = "FILE.svg|FILE.pdf|FILE.png",
    .examples = "  mesorig board board.pdf --board 8x8,square=9,marker=6.75,thickness=3\n",
    .help = "Draw a calibration board to print.",
    .options = entries,
    .writes = TRUE,
    .min = 1,
    .max = 1,
    .run = run};
