/* Calibration files, boards, colour charts. */
#include "fuzz.h"

#include "calibration/calibration.h"
#include "cameras/board.h"
#include "targets/chart_session.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    g_autofree char *text = fuzz_text(data, size);
    GError *error = NULL;
    g_autoptr(Calibration) calibration = calibration_from_text(text, "fuzz", &error);
    fuzz_check(calibration != NULL, &error);
    struct board board;
    fuzz_check(board_parse(&board, text, &error), &error);
    g_autoptr(GArray) chart = chart_parse(text, "fuzz", &error);
    fuzz_check(chart != NULL, &error);
    return 0;
}
