/*
 * The whole chain on pictures of somebody else's rig, as docs/build-a-rig/your-own-rig.md tells it:
 * boards, balls, plates, a white tile and a colour chart calibrate it, and samples with known
 * relief are measured. Every picture is made by the formulas of lib/foreign_rig.h, which share no
 * code with sim/, calib/ or processing/, and goes in by a table of “mesorig import poses”.
 *
 * The nominal values of the rig (foreign_album.h) are some millimetres off, as a ruler's are, and
 * say nothing of brightness.
 *
 * --print: prints errors and error bars' χ² of each view. FOREIGN_CHAIN=DIR: writes pictures,
 * tables and nominal values there, and does nothing else.
 */
#include "btf/btf.h"
#include "btf/btf_sigma.h"
#include "calibration/calibration.h"

#include "foreign_album.h"
#include "lib/ok.h"
#include "lib/process.h"
#include "lib/session_fixture.h"

#include <stdio.h>

#define TEXELS   20
#define SIDE_MM  32.0
#define TEXEL_MM (SIDE_MM / TEXELS)
#define SPOTS    14   /* of a texel, each way, for its true mean */
#define WHITE    0.96 /* of the tile */

static gboolean printing;
static char *folder; /* of all pictures */

/* Prints. */

static double dark_print(double x_mm, double y_mm, int c) {
    (void)x_mm, (void)y_mm, (void)c;
    return 0.1;
}

static double light_print(double x_mm, double y_mm, int c) {
    (void)x_mm, (void)y_mm, (void)c;
    return 0.8;
}

#define SQUARE_MM 8.0
static double chessboard(double x_mm, double y_mm, int c) {
    const double column = x_mm / SQUARE_MM + 3.5, row = 3 - y_mm / SQUARE_MM;
    (void)c;
    if (column < 0 || column > 7 || row < 0 || row > 6)
        return 0.8;
    return ((int)column + (int)row) % 2 == 0 ? 0.05 : 0.8;
}

static double grey_print(double x_mm, double y_mm, int c) {
    (void)x_mm, (void)y_mm, (void)c;
    return 0.5;
}

static double tile_print(double x_mm, double y_mm, int c) {
    (void)x_mm, (void)y_mm, (void)c;
    return WHITE;
}

/* Squares and a slow change of colour. Edges run along no row of texels, nor of pixels. */
static double check_print(double x_mm, double y_mm, int c) {
    static const double squares[2][3] = {{0.6, 0.25, 0.15}, {0.2, 0.35, 0.5}};
    double at[3] = {x_mm, y_mm, 0};
    analytic_turn(at, 13 * DEGREE, at);
    const int odd = (int)(floor(at[0] / 6) + floor(at[1] / 6)) & 1;
    return squares[odd][c] * (1 + 0.2 * sin(0.3 * x_mm + c) * cos(0.25 * y_mm));
}

static double smooth_print(double x_mm, double y_mm, int c) {
    return 0.4 + 0.2 * sin(0.3 * x_mm + c) * cos(0.25 * y_mm);
}

/* A chart of 6 × 4 patches of 6 mm. Its reflectance for the cameras' R, G, B: any mixture of three
 * inks; X, Y, Z follow by a matrix that the instrument is to find. */
#define PATCHES  24
#define PATCH_MM 6.0
static const double to_xyz[3][3] = {{0.55, 0.3, 0.1}, {0.25, 0.7, 0.05}, {0.02, 0.12, 0.95}};

static double patch_rgb(int patch, int c) {
    static const int steps[3] = {7, 5, 11};
    return 0.05 + 0.8 * ((patch * steps[c] + 3 * c) % PATCHES) / (PATCHES - 1);
}

static double chart_print(double x_mm, double y_mm, int c) {
    const int column = (int)floor(x_mm / PATCH_MM + 3), row = (int)floor(2 - y_mm / PATCH_MM);
    return column < 0 || column > 5 || row < 0 || row > 3 ? 0.3 : patch_rgb(6 * row + column, c);
}

/* Targets. */

/* A board that leans by tilt towards an azimuth; its x is turned by turn. */
static struct foreign_plate board_at(double height_mm, double tilt_deg, double towards_deg,
                                     double turn_deg) {
    struct foreign_plate plate = {{0, 0, height_mm}, {1, 0, 0}, {0, 1, 0}, {30, 26}, chessboard};
    double *const sides[] = {plate.right, plate.up};
    for (int k = 0; k < 2; k++) {
        analytic_turn(sides[k], (turn_deg - towards_deg) * DEGREE, sides[k]);
        const double x = sides[k][0], z = sides[k][2];
        sides[k][0] = cos(tilt_deg * DEGREE) * x + sin(tilt_deg * DEGREE) * z;
        sides[k][2] = cos(tilt_deg * DEGREE) * z - sin(tilt_deg * DEGREE) * x;
        analytic_turn(sides[k], towards_deg * DEGREE, sides[k]);
    }
    return plate;
}

#define BOARD    "7x6,square=8,thickness=3"
#define BOARD_MM 3
static const struct {
    const char *name;
    double height_mm, tilt_deg, towards_deg, turn_deg;
} lays[] = {{"flat", BOARD_MM, 0, 0, 0}, {"leaning", 14, 18, 100, 63}, {"steep", 20, 32, 190, 75}};

static void write_boards(void) {
    const struct look look = {CAMERAS, 1, 1.5, 3, .grey = TRUE};
    for (gsize k = 0; k < G_N_ELEMENTS(lays); k++) {
        const struct foreign_plate board =
            board_at(lays[k].height_mm, lays[k].tilt_deg, lays[k].towards_deg, lays[k].turn_deg);
        const struct foreign_scene scene = {.print = dark_print, .plates = &board, .n_plates = 1};
        struct album album = album_begin(folder, lays[k].name);
        for (int t = 0; t < 6; t++)
            album_lamps(&album, &scene, &look, 60 * t);
        album_end(&album);
    }
}

#define POLES    8
#define PLATE_MM 2.0
/* Where they should stand, and their heights. */
static const double poles_mm[POLES][3] = {{-22, -20, 24}, {20, -24, 12}, {24, 18, 24},
                                          {-18, 24, 12},  {0, 8, 20},    {-6, -14, 5},
                                          {12, 2, 5},     {-16, 4, 5}};

static void write_poles(void) {
    const struct look look = {CAMERAS, LAMPS, 1, 3, .grey = TRUE};
    struct foreign_tube poles[POLES];
    g_autoptr(GString) text = g_string_new(NULL);
    g_autofree char *path = g_build_filename(folder, "poles.conf", NULL);
    g_string_printf(text,
                    "[target]\nkind = poles\nplane_mm = %g\nplate_mm = 140;140\nradius_mm = 1\n"
                    "places_mm = ",
                    PLATE_MM);
    for (int i = 0; i < POLES; i++) {
        const double *p = poles_mm[i], x = p[0] + 0.6, y = p[1] - 0.4;
        poles[i] = (struct foreign_tube){{x, y, PLATE_MM}, {0, 0, 1}, p[2], 1, {0.02, 0.02, 0.02}};
        g_string_append_printf(text, "%s%g;%g;%g", i ? ";" : "", p[0], p[1], p[2]);
    }
    g_string_append(text, "\n");
    g_assert_true(g_file_set_contents(path, text->str, -1, NULL));
    const struct foreign_scene scene = {
        .plane_mm = PLATE_MM, .print = light_print, .tubes = poles, .n_tubes = POLES};
    struct album album = album_begin(folder, "poles");
    for (int t = 0; t < 2; t++)
        album_lamps(&album, &scene, &look, 120 * t);
    album_end(&album);
}

static const double plate_heights_mm[] = {1, 8};

static void write_plates(void) {
    for (gsize k = 0; k < G_N_ELEMENTS(plate_heights_mm); k++) {
        g_autofree char *name = g_strdup_printf("plate%g", plate_heights_mm[k]);
        struct album album = album_begin(folder, name);
        const struct foreign_scene scene = {.plane_mm = plate_heights_mm[k], .print = grey_print};
        album_sweeps(&album, &scene, CAMERAS, 0, 3, 1);
        album_end(&album);
    }
}

#define TILE_MM 60.0
static const double tile_turns_deg[] = {0, 50};

static void write_tile(void) {
    const struct look look = {CAMERAS, LAMPS, 1.2, 1};
    const struct foreign_plate tile = {
        {0, 0, PLATE_MM}, {1, 0, 0}, {0, 1, 0}, {TILE_MM / 2, TILE_MM / 2}, tile_print};
    const struct foreign_scene scene = {.print = dark_print, .plates = &tile, .n_plates = 1};
    struct album album = album_begin(folder, "tile");
    for (gsize t = 0; t < G_N_ELEMENTS(tile_turns_deg); t++)
        album_lamps(&album, &scene, &look, tile_turns_deg[t]);
    album_end(&album);
}

static void write_chart(void) {
    const struct look look = {1, LAMPS, 1.2, 4, 24};
    const struct foreign_scene scene = {.plane_mm = PLATE_MM, .print = chart_print};
    g_autofree char *path = g_build_filename(folder, "chart.csv", NULL);
    g_autoptr(GString) text = g_string_new("# x_mm,y_mm,radius_mm,X,Y,Z\n");
    struct album album = album_begin(folder, "chart");
    album_lamps(&album, &scene, &look, 0);
    album_end(&album);
    for (int i = 0; i < PATCHES; i++) {
        double xyz[3] = {0};
        for (int k = 0; k < 9; k++)
            xyz[k / 3] += to_xyz[k / 3][k % 3] * patch_rgb(i, k % 3);
        g_string_append_printf(text, "%g,%g,2,%.6f,%.6f,%.6f\n", (i % 6 - 2.5) * PATCH_MM,
                               (1.5 - (int)(i / 6)) * PATCH_MM, xyz[0], xyz[1], xyz[2]);
    }
    g_assert_true(g_file_set_contents(path, text->str, -1, NULL));
}

/* Samples. */

static const struct foreign_sphere spheres[] = {
    {{-10, -9, 2}, 3, {0.6, 0.5, 0.3}},  {{1, -11, 2}, 2.5, {0.5, 0.5, 0.5}},
    {{11, -8, 2}, 3, {0.3, 0.4, 0.6}},   {{-11, 2, 2}, 2.5, {0.4, 0.6, 0.4}},
    {{0, 1, 2}, 3, {0.6, 0.6, 0.5}},     {{9, 3, 2}, 2, {0.6, 0.3, 0.3}},
    {{-6, 11, 2}, 2.5, {0.3, 0.5, 0.5}}, {{5, 11, 2}, 3, {0.5, 0.4, 0.6}},
};
/* Threads that lie askew, half in the ground, and a flat piece. */
#define ASKEW 0.96, 0.28, 0 /* 16° */
static const struct foreign_tube tubes[] = {
    {{-40, -19, 2.5}, {ASKEW}, 82, 2, {0.6, 0.5, 0.4}},
    {{-40, -11, 2.5}, {ASKEW}, 82, 2, {0.4, 0.5, 0.6}},
    {{-40, -3, 2.5}, {ASKEW}, 82, 2, {0.6, 0.4, 0.4}},
    {{-40, 5, 2.5}, {ASKEW}, 82, 2, {0.4, 0.6, 0.4}},
};
static const struct foreign_plate flat_piece = {
    {7, -11.5, 3.4}, {1, 0, 0}, {0, 1, 0}, {6, 3}, smooth_print};

static const struct sample {
    const char *name;
    struct foreign_scene scene;
    double reference_mm, depth_mm;
    gboolean swept;
} samples[] = {
    {"print", {.plane_mm = 4, .print = check_print}, 4, 0, FALSE},
    {"spheres",
     {2, smooth_print, .spheres = spheres, .n_spheres = G_N_ELEMENTS(spheres)},
     5,
     3,
     TRUE},
    {"tubes",
     {2, smooth_print, .tubes = tubes, .n_tubes = G_N_ELEMENTS(tubes), .plates = &flat_piece,
      .n_plates = 1},
     4.6,
     2.6,
     TRUE},
};
#define TURNS 2
static const double turns_deg[TURNS] = {0, 90};

static void write_samples(void) {
    const struct look look = {CAMERAS, LAMPS, 1.2, 4, 26};
    for (gsize s = 0; s < G_N_ELEMENTS(samples); s++) {
        struct album album = album_begin(folder, samples[s].name);
        for (int t = 0; t < TURNS; t++) {
            album_lamps(&album, &samples[s].scene, &look, turns_deg[t]);
            if (samples[s].swept)
                album_sweeps(&album, &samples[s].scene, CAMERAS, turns_deg[t], 2.4, 26);
        }
        album_end(&album);
    }
}

/* Nominal values, as a ruler gives them. */

static void fill(GString *text, const char *section, const char *key, const char *format, ...)
    G_GNUC_PRINTF(4, 5);
static void fill(GString *text, const char *section, const char *key, const char *format, ...) {
    g_autofree char *head = g_strdup_printf("[%s]\n", section);
    g_autofree char *given = g_strdup_printf("\n%s = ", key);
    g_autofree char *open = g_strdup_printf("\n# %s =", key);
    const char *from = strstr(text->str, head);
    g_assert_nonnull(from);
    const char *line = strstr(from, given), *other = strstr(from, open);
    const char *next = strstr(from, "\n["), *at = line && (!next || line < next) ? line : other;
    va_list arguments;
    g_assert_true(at && (!next || at < next));
    const gssize begin = at + 1 - text->str;
    g_string_erase(text, begin, strchr(at + 1, '\n') - (at + 1));
    va_start(arguments, format);
    g_autofree char *value = g_strdup_vprintf(format, arguments);
    va_end(arguments);
    g_autofree char *full = g_strdup_printf("%s = %s", key, value);
    g_string_insert(text, begin, full);
}

static void place(GString *text, const char *kind, int i, const char *key, double theta,
                  double azimuth, double distance_mm) {
    static const double off_mm[][3] = {{2, -3, 3}, {-3, 1, -2}, {1, 3, 2}, {-2, -2, 3}};
    double at[3] = {distance_mm * sin(theta), 0, distance_mm * cos(theta)};
    g_autofree char *section = g_strdup_printf("%s %s%d", kind, *kind == 'c' ? "cam" : kind, i);
    analytic_turn(at, azimuth, at);
    fill(text, section, key, "%.0f; %.0f; %.0f", at[0] + off_mm[i][0], at[1] + off_mm[i][1],
         at[2] + off_mm[i][2]);
}

static char *path_in(const char *name) {
    return g_build_filename(session_fixture_folder, name, NULL);
}

static char *nominal, *calibration;

static void write_nominal(void) {
    g_autofree char *text = NULL;
    g_free(
        process_mesorig(0, "import poses %s/spheres/poses.csv --template -o %s", folder, nominal));
    g_assert_true(g_file_get_contents(nominal, &text, NULL, NULL));
    g_autoptr(GString) filled = g_string_new(text);
    for (int i = 0; i < CAMERAS; i++) {
        g_autofree char *section = g_strdup_printf("camera cam%d", i);
        fill(filled, section, "focal_px", "1620");
        fill(filled, section, "full_well_e", "%d", FULL_WELL);
        fill(filled, section, "read_noise_e", "%d", READ_NOISE);
        place(filled, "camera", i, "eye_mm", cameras[i].theta, cameras[i].azimuth,
              cameras[i].distance_mm);
    }
    for (int i = 0; i < LAMPS; i++)
        place(filled, "lamp", i, "position_mm", lamp.theta, lamp_azimuths_deg[i] * DEGREE,
              lamp.distance_mm);
    for (int i = 0; i < LASERS; i++) {
        const double a = laser_azimuths_deg[i] * DEGREE;
        g_autofree char *section = g_strdup_printf("laser laser%d", i);
        place(filled, "laser", i, "position_mm", laser.theta, a, laser.distance_mm);
        fill(filled, section, "axis", "%.3f; %.3f; 0", -sin(a), cos(a));
    }
    g_assert_null(strchr(strstr(filled->str, "[rig]"), '?'));
    g_assert_true(g_file_set_contents(nominal, filled->str, -1, NULL));
}

/* Imports a folder's table into NAME.session. */
static char *import(const char *name, const char *known, const char *options) {
    g_autofree char *file = g_strdup_printf("%s.session", name);
    char *path = path_in(file);
    g_autofree char *said = process_mesorig(0, "import poses %s/%s/poses.csv -c %s %s -o %s",
                                            folder, name, known, options, path);
    g_test_message("%s", said);
    return path;
}

static void calibrate(const char *format, ...) G_GNUC_PRINTF(1, 2);
static void calibrate(const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    g_autofree char *rest = g_strdup_vprintf(format, arguments);
    va_end(arguments);
    g_autofree char *said = process_mesorig(0, "calibrate %s", rest);
    g_test_message("%s", said);
}

static Calibration *calibrated(void) {
    Calibration *found = ok(calibration_read(calibration, ERR));
    return found;
}

#define PRINT(...)                                                                                 \
    G_STMT_START {                                                                                 \
        if (printing)                                                                              \
            printf(__VA_ARGS__);                                                                   \
    }                                                                                              \
    G_STMT_END

static double distance_mm(struct vec3 found, const double *truth) {
    return vec3_length(vec3_sub(found, vec3(truth[0], truth[1], truth[2])));
}

static void test_cameras(void) {
    g_autofree char *flat = import(lays[0].name, nominal, "-s 60x60 --reference 3 --target");
    g_autofree char *leaning = import(lays[1].name, nominal, "-s 60x60 --reference 3 --target");
    g_autofree char *steep = import(lays[2].name, nominal, "-s 60x60 --reference 3 --target");
    g_autofree char *upside_down =
        process_mesorig(1, "calibrate cameras %s %s --board %s,first=white --board-azimuth -o %s",
                        flat, leaning, BOARD, calibration);
    g_test_message("%s", upside_down);
    assert_has(upside_down, "take first=white out of --board");
    g_assert_false(g_file_test(calibration, G_FILE_TEST_EXISTS));
    calibrate("cameras %s %s %s --board %s --board-azimuth -o %s", flat, leaning, steep, BOARD,
              calibration);
    g_autoptr(Calibration) found = calibrated();
    for (int i = 0; i < CAMERAS; i++) {
        double eye[3], worst_px = 0;
        pinhole_eye(&cameras[i], eye);
        for (int k = 0; k < 9 * 9 * 2; k++) { /* points about the sample */
            const double p[3] = {4.0 * (k % 9 - 4), 4.0 * (k / 9 % 9 - 4), 5.0 * (k / 81)};
            double x, y, at_x, at_y;
            pinhole_project(&cameras[i], p, &x, &y);
            g_assert_true(
                rig_project(&found->rig.cameras[i], vec3(p[0], p[1], p[2]), &at_x, &at_y));
            worst_px = MAX(worst_px, hypot(at_x - x, at_y - y));
        }
        const double off_mm = distance_mm(rig_camera_centre_mm(&found->rig.cameras[i]), eye);
        PRINT("cam%d: %.2f mm off at %.0f mm, focal length %+.3f %%, points about the sample at "
              "most %.3f px off, residual %.3f px\n",
              i, off_mm, cameras[i].distance_mm,
              100 * (found->rig.cameras[i].fx_px / cameras[i].focal_px - 1), worst_px,
              found->cameras[i].residual_rms_px);
        g_assert_cmpfloat(worst_px, <, 0.02);
    }
}

static void test_lights(void) {
    g_autofree char *poles = import("poles", calibration, "-s 60x60 --reference 2 --target");
    calibrate("lights %s --target %s/poles.conf -c %s -o %s", poles, folder, calibration,
              calibration);
    g_autoptr(Calibration) found = calibrated();
    for (int i = 0; i < LAMPS; i++) {
        double at[3] = {lamp.distance_mm * sin(lamp.theta), 0, lamp.distance_mm * cos(lamp.theta)};
        analytic_turn(at, lamp_azimuths_deg[i] * DEGREE, at);
        const struct vec3 is = found->rig.lamps[i].position_mm;
        const double cosine =
            vec3_dot(is, vec3(at[0], at[1], at[2])) / vec3_length(is) / lamp.distance_mm;
        const double off_deg = acos(MIN(cosine, 1)) / DEGREE;
        PRINT("lamp%d: %.2f mm off at %.0f mm, %.3f°, distance %+.2f mm\n", i, distance_mm(is, at),
              lamp.distance_mm, off_deg, vec3_length(is) - lamp.distance_mm);
        g_assert_cmpfloat(off_deg, <, 0.1);
    }
}

static void test_laser(void) {
    g_autofree char *low = import("plate1", calibration, "-s 32x32 --reference 1");
    g_autofree char *high = import("plate8", calibration, "-s 32x32 --reference 8");
    calibrate("laser %s %s -c %s -o %s", low, high, calibration, calibration);
    g_autoptr(Calibration) found = calibrated();
    for (int i = 0; i < LASERS; i++) {
        const double arc = laser_azimuths_deg[i] * DEGREE;
        double worst_mm = 0;
        /* Where the found sheets are at points of the true ones. */
        for (int k = 0; k < 9 * 9 * 2; k++) {
            const double p[3] = {4.0 * (k % 9 - 4), 4.0 * (k / 9 % 9 - 4), 5.0 * (k / 81)};
            const double truly = line_laser_sweep(&laser, arc, p);
            const double said = (truly - zero_deg[i] * DEGREE) / (1 + stretch[i]);
            const struct rig_plane sheet =
                rig_laser_sheet(&found->rig.arc, &found->rig.lasers[i], 0, said);
            worst_mm = MAX(worst_mm,
                           fabs(vec3_dot(sheet.normal, vec3(p[0], p[1], p[2])) - sheet.offset_mm));
        }
        PRINT("laser%d: sheets at most %.4f mm off about the sample\n", i, worst_mm);
        g_assert_cmpfloat(worst_mm, <, 0.01);
    }
}

static void test_radiometry(void) {
    g_autofree char *options =
        g_strdup_printf("-s %gx%g --reference %g --target", TILE_MM, TILE_MM, PLATE_MM);
    g_autofree char *tile = import("tile", calibration, options);
    calibrate("radiometry %s --reflectance %g -c %s -o %s", tile, WHITE, calibration, calibration);
    g_autoptr(Calibration) found = calibrated();
    /* What a camera shows of a lamp on the tile: only the product is determined. */
    for (int i = 0; i < CAMERAS * LAMPS; i++) {
        const int c = i / LAMPS, l = i % LAMPS;
        const double product = found->rig.cameras[c].response * found->rig.lamps[l].intensity;
        PRINT("cam%d under lamp%d: %+.3f %%, exponent %.2f\n", c, l,
              100 * (product / (6000 * lamp.intensity) - 1), found->rig.lamps[l].exponent);
        g_assert_cmpfloat(fabs(product / (6000 * lamp.intensity) - 1), <, 0.02);
    }
}

static void test_colour(void) {
    g_autofree char *options = g_strdup_printf("-s 36x24 --texels 36 --reference %g", PLATE_MM);
    g_autofree char *chart = import("chart", calibration, options);
    g_free(process_mesorig(0, "process %s", chart));
    calibrate("colour %s --chart %s/chart.csv -c %s -o %s", chart, folder, calibration,
              calibration);
    g_autoptr(Calibration) found = calibrated();
    double worst = 0;
    for (int i = 0; i < PATCHES; i++)
        for (int k = 0; k < 3; k++) {
            double xyz = 0, wanted = 0;
            for (int c = 0; c < 3; c++) {
                xyz += found->colour.matrix[3 * k + c] * patch_rgb(i, c);
                wanted += to_xyz[k][c] * patch_rgb(i, c);
            }
            worst = MAX(worst, fabs(xyz - wanted));
        }
    PRINT("colours: X, Y, Z of the chart's patches at most %.4f off\n", worst);
    g_assert_cmpfloat(worst, <, 0.005);
}

/* Sums over the values of one view. */
struct sums {
    double squares, chi2, wanted2, offs;
    int n, all;
};

/* The texel's middle, or spot i of SPOTS × SPOTS in it. */
static void point_of(int texel, double across, double down, double reference_mm, double *ret) {
    ret[0] = (texel % TEXELS + across) * TEXEL_MM - SIDE_MM / 2;
    ret[1] = SIDE_MM / 2 - ((int)(texel / TEXELS) + down) * TEXEL_MM;
    ret[2] = reference_mm;
}

/* π L over the irradiance of a surface that faces the lamp, the mean of L over the texel. */
static void true_btf(const struct sample *sample, const struct foreign_shot *shot, int texel,
                     double ret[3]) {
    double middle[3],
        at[3] = {lamp.distance_mm * sin(lamp.theta), 0, lamp.distance_mm * cos(lamp.theta)};
    analytic_turn(at, shot->arc - shot->turntable, at);
    point_of(texel, 0.5, 0.5, sample->reference_mm, middle);
    const double l[3] = {at[0] - middle[0], at[1] - middle[1], at[2] - middle[2]};
    const double r = sqrt(analytic_dot(l, l)), cosine = analytic_dot(l, at) / r / lamp.distance_mm;
    const double e = lamp.intensity * pow(cosine, lamp.exponent) / (r * r * 1e-6);
    ret[0] = ret[1] = ret[2] = 0;
    for (int i = 0; i < SPOTS * SPOTS; i++) {
        double p[3], radiance[3];
        point_of(texel, (i % SPOTS + 0.5) / SPOTS, ((int)(i / SPOTS) + 0.5) / SPOTS,
                 sample->reference_mm, p);
        foreign_seen(&sample->scene, shot, p, radiance);
        for (int c = 0; c < 3; c++)
            ret[c] += G_PI * radiance[c] / e / (SPOTS * SPOTS);
    }
}

/* The lamp whose place a light is in a view. */
static int lamp_of(const struct exr_part *part, double turntable_deg) {
    double phi_deg, least = 360;
    int found = 0;
    g_assert_true(exr_get_double(part, "light.phi_deg", &phi_deg, NULL));
    for (int k = 0; k < LAMPS; k++) {
        const double off = fabs(remainder(lamp_azimuths_deg[k] - turntable_deg - phi_deg, 360));
        found = off < least ? k : found;
        least = MIN(least, off);
    }
    g_assert_cmpfloat(least, <, 1.5);
    return found;
}

/* The camera and angle of the turntable of a view, from its direction in the file. */
static void view_of(const struct exr_part *part, int *ret_camera, double *ret_turntable_deg) {
    double theta_deg, phi_deg, least = 360;
    g_assert_true(exr_get_double(part, "view.theta_deg", &theta_deg, NULL));
    g_assert_true(exr_get_double(part, "view.phi_deg", &phi_deg, NULL));
    for (int i = 0; i < CAMERAS * TURNS; i++) {
        const struct pinhole *camera = &cameras[i / TURNS];
        const double turned_deg = camera->azimuth / DEGREE - turns_deg[i % TURNS];
        const double off =
            fabs(camera->theta / DEGREE - theta_deg) + fabs(remainder(turned_deg - phi_deg, 360));
        if (off >= least)
            continue;
        least = off;
        *ret_camera = i / TURNS;
        *ret_turntable_deg = turns_deg[i % TURNS];
    }
    g_assert_cmpfloat(least, <, 2);
}

static void add_btf(const struct sample *sample, const struct exr_part *part, struct sums *sums) {
    static const char *const names[] = {"R", "G", "B"};
    const float *sigma = exr_part_plane(part, "sigma"), *mark = exr_part_plane(part, "mark");
    struct btf_sigma bars;
    int camera;
    double turntable_deg;
    view_of(part, &camera, &turntable_deg);
    const gboolean known = sigma && btf_sigma_read(part, &bars);
    const struct foreign_shot shot = {&cameras[camera], &lamp,
                                      lamp_azimuths_deg[lamp_of(part, turntable_deg)] * DEGREE,
                                      turntable_deg * DEGREE};
    g_assert_true(known);
    for (int texel = 0; texel < TEXELS * TEXELS; texel++) {
        double wanted[3];
        sums[camera].all += 3;
        if (mark && mark[texel] != 0)
            continue;
        true_btf(sample, &shot, texel, wanted);
        for (int c = 0; c < 3; c++) {
            const double value = (double)exr_part_plane(part, names[c])[texel];
            const double s = (double)sigma[texel] * bars.colour[c], off = value - wanted[c];
            sums[camera].squares += off * off;
            sums[camera].wanted2 += wanted[c] * wanted[c];
            sums[camera].chi2 += off * off / (s * s + pow(bars.scale[c] * value, 2));
            sums[camera].n++;
        }
    }
}

static void add_mdf(const struct sample *sample, const struct exr_part *part, struct sums *sums,
                    struct sums *edges) {
    const float *distance = exr_part_plane(part, "D"), *error = exr_part_plane(part, "S");
    const float *from = exr_part_plane(part, "P");
    int camera;
    double turntable_deg;
    g_assert_true(distance && error && from);
    view_of(part, &camera, &turntable_deg);
    for (int texel = 0; texel < TEXELS * TEXELS; texel++) {
        double p[3], wanted, least = HUGE_VAL, most = -HUGE_VAL;
        gboolean inside = TRUE;
        for (int i = 0; i < 25; i++) {
            double at;
            point_of(texel, (i % 5) / 4.0, ((int)(i / 5)) / 4.0, sample->reference_mm, p);
            inside = inside && foreign_distance_mm(&sample->scene, &cameras[camera],
                                                   turntable_deg * DEGREE, p, &at);
            least = MIN(least, at);
            most = MAX(most, at);
        }
        point_of(texel, 0.5, 0.5, sample->reference_mm, p);
        if (!inside || !foreign_distance_mm(&sample->scene, &cameras[camera],
                                            turntable_deg * DEGREE, p, &wanted))
            continue;
        struct sums *to = &(most - least > TEXEL_MM / 2 ? edges : sums)[camera];
        to->all++;
        if ((int)from[texel] != 1)
            continue;
        const double off = (double)distance[texel] - wanted;
        to->squares += off * off;
        to->offs += off;
        to->n++;
        g_assert_cmpfloat((double)error[texel], >, 0);
        to->chi2 += pow(off / (double)error[texel], 2);
    }
}

static double rms(double squares, int n) {
    return sqrt(squares / n);
}

static void test_sample(gconstpointer data) {
    const struct sample *sample = data;
    struct sums btf[CAMERAS] = {0}, mdf[CAMERAS] = {0}, edges[CAMERAS] = {0};
    g_autofree char *options =
        g_strdup_printf("-s %gx%g --texels %d --reference %g --depth %g --same-light 1", SIDE_MM,
                        SIDE_MM, TEXELS, sample->reference_mm, sample->depth_mm);
    g_autofree char *path = import(sample->name, calibration, options);
    g_free(process_mesorig(0, "process %s", path));
    g_autofree char *said = process_mesorig(0, "check %s", path);
    PRINT("%s\n%s", sample->name, said);
    for (int view = 0; view < CAMERAS * TURNS; view++) {
        g_autofree char *name = g_strdup_printf("%s/products/btf/view_%04d.exr", path, view);
        g_autoptr(ExrFile) file = exr_read(name, NULL);
        g_assert_true(file && file->parts->len == LAMPS);
        for (guint k = 0; k < file->parts->len; k++)
            add_btf(sample, file->parts->pdata[k], btf);
    }
    if (sample->swept) {
        g_autofree char *name = g_build_filename(path, "products/mdf.exr", NULL);
        g_autoptr(ExrFile) file = exr_read(name, NULL);
        g_assert_nonnull(file);
        for (guint k = 0; k < file->parts->len; k++)
            add_mdf(sample, file->parts->pdata[k], mdf, edges);
    }
    for (int c = 0; c < CAMERAS; c++) {
        const double off = sqrt(btf[c].squares / btf[c].n), bars = btf[c].chi2 / btf[c].n;
        PRINT("%s from %.0f°: BTF RMS %.4f, %.1f %% of its RMS, χ² %.2f over %d of %d values\n",
              sample->name, cameras[c].theta / DEGREE, off,
              100 * off / rms(btf[c].wanted2, btf[c].n), bars, btf[c].n, btf[c].all);
        g_assert_cmpfloat(off, <, 0.006);
        g_assert_cmpfloat(bars, >, 0.7);
        g_assert_cmpfloat(bars, <, 1.4);
        g_assert_cmpint(btf[c].n, ==, btf[c].all);
        if (!sample->swept)
            continue;
        PRINT("    MDF RMS %.4f mm, mean %+.4f mm, χ² %.2f over %d of %d texels; at edges RMS "
              "%.3f mm, χ² %.2f over %d of %d\n",
              rms(mdf[c].squares, mdf[c].n), mdf[c].offs / mdf[c].n, mdf[c].chi2 / mdf[c].n,
              mdf[c].n, mdf[c].all, rms(edges[c].squares, edges[c].n), edges[c].chi2 / edges[c].n,
              edges[c].n, edges[c].all);
        g_assert_cmpfloat(rms(mdf[c].squares, mdf[c].n), <, 0.08);
        /* The bars add errors of sheets and cameras as if they were independent, which they are
         * not: the same cameras have calibrated the sheets. */
        g_assert_cmpfloat(mdf[c].chi2 / mdf[c].n, >, 0.6);
        g_assert_cmpfloat(mdf[c].chi2 / mdf[c].n, <, 1.4);
        g_assert_cmpfloat(mdf[c].n + edges[c].n, >, 0.98 * (mdf[c].all + edges[c].all));
    }
}

/* Sweeps alone make a session with an MDF and no BTF, which “check” can judge. */
static void test_sweeps_alone(void) {
    g_autofree char *from = g_build_filename(folder, "spheres", "poses.csv", NULL);
    g_autofree char *to = g_build_filename(folder, "spheres", "sweeps.csv", NULL);
    g_autofree char *path = path_in("sweeps.session"), *text = NULL;
    g_assert_true(g_file_get_contents(from, &text, NULL, NULL));
    g_auto(GStrv) lines = g_strsplit(text, "\n", -1);
    g_autoptr(GString) rows = g_string_new(NULL);
    for (int i = 0; lines[i]; i++)
        if (i == 0 || g_str_has_prefix(lines[i], "t000_cam0_laser"))
            g_string_append_printf(rows, "%s\n", lines[i]);
    g_assert_true(g_file_set_contents(to, rows->str, -1, NULL));
    g_free(process_mesorig(
        0, "import poses %s -c %s -s %gx%g --texels %d --reference 5 --depth 3 -o %s", to,
        calibration, SIDE_MM, SIDE_MM, TEXELS, path));
    g_free(process_mesorig(0, "process %s", path));
    g_autofree char *said = process_mesorig(0, "check %s", path);
    assert_has(said, "surface ");
    g_assert_null(strstr(said, "energy "));
    g_assert_null(strstr(said, "suspect "));
}

static void write_all(void) {
    write_boards();
    write_poles();
    write_plates();
    write_tile();
    write_chart();
    write_samples();
}

int main(int argc, char **argv) {
    const char *kept = g_getenv("FOREIGN_CHAIN");
    g_test_init(&argc, &argv, NULL);
    printing = argc > 1 && strcmp(argv[1], "--print") == 0;
    session_fixture_folder = g_dir_make_tmp("mesorig-foreign-XXXXXX", NULL);
    folder = kept ? g_strdup(kept) : path_in("pictures");
    nominal = g_build_filename(kept ? folder : session_fixture_folder, "nominal.conf", NULL);
    calibration = path_in("calibration.conf");
    g_test_add_func("/foreign_chain/pictures", write_all);
    g_test_add_func("/foreign_chain/nominal", write_nominal);
    if (!kept) {
        g_test_add_func("/foreign_chain/cameras", test_cameras);
        g_test_add_func("/foreign_chain/lights", test_lights);
        g_test_add_func("/foreign_chain/laser", test_laser);
        g_test_add_func("/foreign_chain/radiometry", test_radiometry);
        g_test_add_func("/foreign_chain/colour", test_colour);
        for (gsize s = 0; s < G_N_ELEMENTS(samples); s++) {
            g_autofree char *name = g_strdup_printf("/foreign_chain/%s", samples[s].name);
            g_test_add_data_func(name, &samples[s], test_sample);
        }
    }
    if (!kept)
        g_test_add_func("/foreign_chain/sweeps_alone", test_sweeps_alone);
    const int status = g_test_run();
    remove_tree(session_fixture_folder);
    g_free(session_fixture_folder);
    g_free(folder);
    g_free(nominal);
    g_free(calibration);
    return status;
}
