/* From a white tile to reflectances of a grey scale, through sessions; and what marks notice. */
#include "processing/btf.h"
#include "processing/pipeline.h"
#include "processing/tile_session.h"
#include "radiometry_rig.h"

static const struct tile_options white = {.reflectance = {0.96, 0.96, 0.96}};

static char *new_folder(void) {
    char *folder = g_dir_make_tmp("mesorig-tile-XXXXXX", NULL);
    g_autofree char *rig = rig_text("");
    rig_write(folder, "rig.conf", rig);
    return folder;
}

/* Captures the tile and writes calibration.conf. */
static void calibrate(const char *folder, int seed, struct tile_result *ret) {
    g_autoptr(GError) error = NULL;
    rig_write_tile(folder, seed);
    enum capture_state state = rig_capture(folder, TILE_CONF, "tile", NULL, NULL, &error);
    g_assert_no_error(error);
    g_assert_cmpint(state, ==, CAPTURE_DONE);
    g_autofree char *path = g_build_filename(folder, "tile.session", NULL);
    g_autoptr(Session) session = session_open(path, SESSION_READ, &error);
    g_assert_no_error(error);
    g_autofree char *text = session_text(session, "calibration.conf", &error);
    g_autoptr(Calibration) calibration = calibration_from_text(text, path, &error);
    g_assert_no_error(error);
    /* Geometry is right as it is said in the rig file. */
    calibration_set_part(calibration, CALIBRATION_CAMERAS, "nominal", 0, "-", NULL);
    gboolean ok = tile_session(session, calibration, &white, ret, &error);
    g_assert_no_error(error);
    g_assert_true(ok);
    g_autofree char *to = g_build_filename(folder, "calibration.conf", NULL);
    g_assert_true(calibration_write(calibration, to, &error));
}

static void tile(void) {
    g_autofree char *folder = new_folder();
    struct tile_result result;
    calibrate(folder, 1, &result);
    g_test_message("%d pictures, %d cells, residual %.4f, quality %.3f, drift %.4f, %d marks, %d "
                   "cameras' noise",
                   result.pictures, result.cells, result.residual, result.quality, result.drift,
                   result.marks, result.transfers);
    rig_remove(folder);
}

int main(int argc, char **argv) {
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/tile/tile", tile);
    int status = g_test_run();
    fixture_clean();
    return status;
}
