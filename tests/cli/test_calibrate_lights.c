/* mesorig calibrate lights and laser as a shell sees them, from captures of a simulated rig to a
 * calibration file; and light directions in photographs. */
#include "calibration/calibration.h"
#include "lamps/ball_light.h"
#include "lib/process.h"
#include "lib/remove_tree.h"
#include "lib/test.h"
#include "lib/told_pictures.h"
#include "lib/world_fixture.h"
#include "world/truth.h"

#include <png.h>
#include <sqlite3.h>
#include <string.h>

#define MESORIG  BUILD_DIR "/bin/mesorig"
#define RAD(deg) ((deg) * (G_PI / 180))
#define PLACES   "-20;-18;24;18;-20;12;20;16;24;-16;20;12;0;6;20;-6;-12;6;10;2;6"

#define BALLS "-20;-17;8;18;-20;8;20;17;8;-17;20;8;0;0;8"

static const int camera_deg[] = {20, 55}, lamp_deg[] = {20, 40, 65};

/* Runs mesorig in the folder of the worlds; what it has told, which has these words (if not NULL).
 */
static char *run(int code, const char *words, const char *const *argv) {
    g_autofree char *errors = NULL, *out = NULL;
    const int is = process_run_in(world_fixture_folder(), argv, &out, &errors);
    char *told = g_strconcat(out, is ? errors : NULL, NULL);
    g_test_message("%s", told);
    g_assert_cmpint(is, ==, code);
    if (words)
        assert_has(told, words);
    return told;
}

#define RUN(code, words, ...) run(code, words, (const char *const[]){MESORIG, __VA_ARGS__, NULL})

static void write_text(const char *name, const char *format, ...) G_GNUC_PRINTF(2, 3);
static void write_text(const char *name, const char *format, ...) {
    va_list list;
    va_start(list, format);
    g_autofree char *text = g_strdup_vprintf(format, list);
    va_end(list);
    g_autofree char *path = world_fixture_write(name, text);
}

/* The same true world with another sample. */
static void write_world(const char *name, const char *sample) {
    g_autoptr(GString) text = g_string_new(
        "[world]\nseed=3\ngather_rays=0\nwarm_up_s=0.1\narc_zero_error_deg=0.4\n"
        "arc_tilt_error_deg=0.1\narc_error_mm=0.3\nlamp_error_mm=2\nlaser_error_mm=0.5\n"
        "laser_error_deg=0.1\n");
    for (gsize i = 0; i < G_N_ELEMENTS(camera_deg); i++)
        g_string_append_printf(
            text, "[camera c%d]\ntheta_deg=%d\nwidth=176\nheight=176\nfocal_px=1525\nbits=12\n",
            camera_deg[i], camera_deg[i]);
    for (gsize i = 0; i < G_N_ELEMENTS(lamp_deg); i++)
        g_string_append_printf(text, "[lamp l%d]\ntheta_deg=%d\n", lamp_deg[i], lamp_deg[i]);
    g_string_append_printf(text, "[laser s40]\ntheta_deg=40\n%s", sample);
    write_text(name, "%s", text->str);
}

static void write_rig(const char *name, const char *world) {
    g_autoptr(GString) text = g_string_new("[rig]\nid=test\nclock=virtual\narc_radius_mm=500\n"
                                           "arc_width_mm=30\n");
    static const char *const axes[] = {"turntable", "arc", "s40"};
    for (gsize i = 0; i < G_N_ELEMENTS(axes); i++)
        g_string_append_printf(text,
                               "[axis %s]\ndriver=sim-axis\nworld=%s\nwraps=%s\nmin_deg=-15\n"
                               "max_deg=15\n",
                               axes[i], world, i < 2 ? "yes" : "no");
    g_string_append_printf(text, "[lamps bank]\ndriver=sim-lamps\nworld=%s\n", world);
    for (gsize i = 0; i < G_N_ELEMENTS(lamp_deg); i++)
        g_string_append_printf(text,
                               "[lamp l%d]\nbank=bank\nindex=%d\ntheta_deg=%d\ndistance_mm=500\n",
                               lamp_deg[i], (int)i, lamp_deg[i]);
    for (gsize i = 0; i < G_N_ELEMENTS(camera_deg); i++)
        g_string_append_printf(
            text,
            "[camera c%d]\ndriver=sim-camera\nworld=%s\ntheta_deg=%d\n"
            "phi_deg=0\ndistance_mm=650\nwidth=176\nheight=176\nfocal_px=1525\nresponse=6000\n",
            camera_deg[i], world, camera_deg[i]);
    g_string_append_printf(text,
                           "[laser s40]\ndriver=sim-laser\nworld=%s\nsweep=s40\ntheta_deg=40\n"
                           "distance_mm=480\n[interlock door]\ndriver=sim-interlock\n",
                           world);
    write_text(name, "%s", text->str);
}

static void write_session(const char *name, double reference_mm, const char *lights,
                          const char *lasers) {
    const gboolean balls = g_str_has_prefix(name, "balls"); /* the lamps' images are bright */
    write_text(name,
               "[session]\nname=test\n[sample]\nwidth_mm=50\nheight_mm=50\ntexels=8\n"
               "reference_mm=%g\ndepth_mm=1\n[views]\nrings=%s\n[lights]\nrings=%s\n"
               "offset_deg=25\n%s[capture]\nexposures_us=%s\nlaser_exposure_us=4000\n"
               "sweep_steps=72\nsweep_margin_mm=2\ndark_frames=1\nretries=1\n"
               "laser_threshold_dn=40\non_blocked=skip\n",
               reference_mm, balls ? "20:6;55:6" : "20:3;55:3", lights, lasers,
               balls ? "150;1200" : "8000");
}

static void capture(const char *what, const char *sample, double reference_mm, const char *lights,
                    const char *lasers) {
    g_autofree char *world = g_strconcat(what, "_world.conf", NULL);
    g_autofree char *rig = g_strconcat(what, "_rig.conf", NULL);
    g_autofree char *conf = g_strconcat(what, ".conf", NULL);
    g_autofree char *session = g_strconcat(what, ".session", NULL);
    write_world(world, sample);
    write_rig(rig, world);
    write_session(conf, reference_mm, lights, lasers);
    g_free(RUN(0, NULL, "capture", rig, conf, "-o", session));
}

static char *in_folder(const char *name) {
    return g_build_filename(world_fixture_folder(), name, NULL);
}

static void compare_lamps(const struct rig *rig, World *world) {
    for (int i = 0; i < rig->n_lamps; i++)
        for (int deg = 0; deg < 360; deg += 45) {
            double p[3];
            truth_lamp(world, i, deg, p, NULL);
            struct vec3 truth = vec3(p[0], p[1], p[2]);
            struct vec3 at = rig_lamp_position_mm(&rig->arc, &rig->lamps[i], RAD(deg));
            double sine = vec3_length(vec3_cross(vec3_unit(at), vec3_unit(truth)));
            g_assert_cmpfloat(asin(sine) * 180 / G_PI, <, 0.1);
            g_assert_cmpfloat(fabs(vec3_length(at) / vec3_length(truth) - 1), <, 0.01);
        }
}

static void compare_lasers(const struct rig *rig, World *world) {
    for (int deg = 0; deg < 360; deg += 30)
        for (double s = -3; s <= 3; s += 0.5) {
            struct truth_sheet truth;
            truth_laser_sheet(world, 0, deg, s, &truth);
            struct rig_plane sheet = rig_laser_sheet(&rig->arc, &rig->lasers[0], RAD(deg), RAD(s));
            struct vec3 n = vec3(truth.normal[0], truth.normal[1], truth.normal[2]);
            double sine = vec3_length(vec3_cross(sheet.normal, n));
            g_assert_cmpfloat(asin(sine) * 180 / G_PI, <, 0.03);
        }
}

TEST(lamps_then_laser) {
    g_autofree char *world_path = in_folder("poles_world.conf");
    g_autofree char *path = in_folder("two.conf");
    g_autoptr(GError) error = NULL;
    capture("poles",
            "[sample]\nkind=poles\nwidth_mm=80\nheight_mm=80\nbase_mm=2\ntop_mm=40\nradius_mm=1\n"
            "places_mm=" PLACES "\n",
            2, "20:2;40:2;65:2", "");
    capture("low", "[sample]\nkind=flat\ngrid=2\nwidth_mm=80\nheight_mm=80\nbase_mm=1\n", 1, "20:1",
            "[lasers]\nrings=40:2\noffset_deg=25\n");
    capture("high",
            "[sample]\nkind=flat\ngrid=2\nwidth_mm=80\nheight_mm=80\nbase_mm=16\ntop_mm=20\n", 16,
            "20:1", "[lasers]\nrings=40:2\noffset_deg=25\n");
    write_text("target.conf", "[target]\nkind=poles\nplane_mm=2\nplate_mm=80;80\nradius_mm=1\n"
                              "places_mm=" PLACES "\n");
    g_autofree char *lamps = RUN(0, "arc: zero ", "calibrate", "lights", "poles.session",
                                 "--target", "target.conf", "-o", "one.conf");
    assert_has(lamps, "the cameras are nominal");
    assert_has(lamps, " sights left out, which is usual: up to a half; mesorig calibrate show");
    g_autofree char *laser = RUN(0, "\"worst_step_mm\"", "calibrate", "laser", "low.session",
                                 "high.session", "-c", "one.conf", "-o", "two.conf", "--json");
    assert_has(laser, "\"warnings\": [");
    g_autoptr(Calibration) calibration = calibration_read(path, &error);
    g_assert_no_error(error);
    g_assert_true(calibration->parts[CALIBRATION_LIGHTS].done);
    g_assert_true(calibration->parts[CALIBRATION_LASER].done);
    g_assert_true(calibration->arc.known && calibration->lamps[1].known);
    g_autoptr(World) world = world_get(world_path, &error);
    g_assert_no_error(error);
    compare_lamps(&calibration->rig, world);
    compare_lasers(&calibration->rig, world);
    g_autofree char *shown = RUN(0, "l40: ", "calibrate", "show", "two.conf");
    assert_has(shown, "s40: ");
}

/* After test_lamps_then_laser(), whose sessions it uses. */
TEST(refused) {
    g_autofree char *here = in_folder("no.conf");
    g_autofree char *one = RUN(1, "have heights from 1.000 to 1.000 mm", "calibrate", "laser",
                               "low.session", "-o", "no.conf");
    assert_has(one, "low.session/laser/");
    g_free(RUN(1, "of its description fits the shadows", "calibrate", "lights", "low.session", "-t",
               "target.conf", "-o", "no.conf"));
    g_free(RUN(1, "poles.session, poles.session: no laser sweeps were captured", "calibrate",
               "laser", "poles.session", "poles.session", "-o", "no.conf"));
    g_free(RUN(1, "give one height of at least 0 and less than 1000 mm for each session (2)",
               "calibrate", "laser", "low.session", "high.session", "--planes", "1;x", "-o",
               "no.conf"));
    g_free(RUN(1, "two.calibration", "calibrate", "laser", "low.session", "high.session", "-c",
               "two.calibration", "-o", "no.conf")); /* is not there */
    g_free(RUN(1, "heights are in millimetres", "calibrate", "laser", "low.session", "high.session",
               "--planes", "0.001;0.016", "-o", "no.conf"));
    write_text("metres.conf", "[target]\nkind=balls\nplane_mm=2\nplaces_mm=-0.02;-0.018;0.024\n");
    g_free(RUN(1, "radius of post or ball 1 is 0.024 mm, and must be above 0.1; give millimetres",
               "calibrate", "lights", "poles.session", "-t", "metres.conf", "-o", "no.conf"));
    write_text("metres.conf", "[target]\nkind=balls\nplane_mm=0.002\nplaces_mm=1;2;8\n");
    g_free(RUN(1, "metres.conf:3: [target] plane_mm: 0.002 mm is too small for the height",
               "calibrate", "lights", "poles.session", "-t", "metres.conf", "-o", "no.conf"));
    g_free(RUN(2, "--target", "calibrate", "lights", "poles.session", "-o", "no.conf"));
    g_free(RUN(2, "-o", "calibrate", "laser", "low.session", "high.session"));
    g_free(RUN(2, "--ball", "calibrate", "lights", "-i", ".", "--ball", "1,2", "-o", "no.lp"));
    g_assert_false(g_file_test(here, G_FILE_TEST_EXISTS));
}

/* Changes what a session says of its shots. */
static void note(const char *session, const char *sql) {
    g_autofree char *folder = in_folder(session), *path = NULL;
    sqlite3 *db = NULL;
    path = g_build_filename(folder, "session.db", NULL);
    g_assert_cmpint(sqlite3_open(path, &db), ==, SQLITE_OK);
    g_assert_cmpint(sqlite3_exec(db, sql, NULL, NULL, NULL), ==, SQLITE_OK);
    sqlite3_close(db);
}

#define TURN_BACK     "UPDATE shot SET turntable_deg = -turntable_deg"
#define ARC_BACK      "UPDATE shot SET arc_deg = -arc_deg"
#define RADIANS(what) "UPDATE shot SET " what " = " what " * 0.017453292519943295"
#define DEGREES(what) "UPDATE shot SET " what " = " what " / 0.017453292519943295"
#define LAMPS(a, b)                                                                                \
    "UPDATE shot SET device = CASE device WHEN " #a " THEN " #b " WHEN " #b " THEN " #a            \
    " ELSE device END WHERE kind = 'lamp'"

/* After test_lamps_then_laser(), whose sessions it uses: a session that was paused before its last
 * shot is used only if it is asked for, and then the calibration says so. */
TEST(incomplete) {
    g_autofree char *here = in_folder("part.conf"), *page = NULL;
    g_autofree char *html = in_folder("part.html");
    note("low.session",
         "UPDATE shot SET state = 'planned' WHERE id = (SELECT min(id) FROM shot WHERE "
         "kind = 'lamp')");
    note("low.session", "UPDATE value SET value = 'paused' WHERE key = 'state'");
    g_autofree char *refused =
        RUN(1, "low.session is paused, with ", "calibrate", "laser", "low.session", "high.session",
            "-c", "one.conf", "-o", "part.conf");
    assert_has(refused, "mesorig resume ");
    assert_has(refused, "--incomplete");
    g_assert_false(g_file_test(here, G_FILE_TEST_EXISTS));
    g_free(RUN(0, "low.session is paused, with ", "calibrate", "laser", "low.session",
               "high.session", "-c", "one.conf", "-o", "part.conf", "--incomplete"));
    g_free(RUN(0, "low.session is paused, with ", "calibrate", "show", "part.conf"));
    g_free(RUN(0, NULL, "calibrate", "report", "part.conf", "-o", "part.html"));
    g_assert_true(g_file_get_contents(html, &page, NULL, NULL));
    assert_has(page, "<li>laser: calibrated from a session that lacks shots: ");
    note("low.session", "UPDATE shot SET state = 'done'");
    note("low.session", "UPDATE value SET value = 'done' WHERE key = 'state'");
    g_free(RUN(0, NULL, "calibrate", "laser", "low.session", "high.session", "-c", "part.conf",
               "-o", "part.conf"));
    g_autofree char *whole = RUN(0, NULL, "calibrate", "show", "part.conf");
    g_assert_null(strstr(whole, "lacks shots"));
    g_assert_null(strstr(whole, "is paused"));
}

/* After test_lamps_then_laser(), whose sessions it uses: what is noted of the posts is wrong, and
 * right again after the same change. */
TEST(mistakes_of_posts) {
    static const char *const wrong[][2] = {
        {TURN_BACK, "the turntable turns the wrong way"},
        {ARC_BACK, "correct the sign of steps_per_deg of [axis arc] in the rig file"},
        {LAMPS(0, 1), "lamps l20 and l40 are exchanged"},
    };
    for (gsize i = 0; i < G_N_ELEMENTS(wrong); i++) {
        note("poles.session", wrong[i][0]);
        g_free(RUN(1, wrong[i][1], "calibrate", "lights", "poles.session", "-t", "target.conf",
                   "-o", "no.conf"));
        note("poles.session", wrong[i][0]);
    }
    g_free(RUN(0, NULL, "calibrate", "lights", "poles.session", "-t", "target.conf", "-o",
               "again.conf"));
    note("poles.session", RADIANS("turntable_deg"));
    g_free(RUN(1, "the turntable has its angles in radians", "calibrate", "lights", "poles.session",
               "-t", "target.conf", "-o", "no.conf"));
    note("poles.session", DEGREES("turntable_deg"));
    note("poles.session", RADIANS("arc_deg"));
    g_free(RUN(1, "the arc has its angles in radians", "calibrate", "lights", "poles.session", "-t",
               "target.conf", "-o", "no.conf"));
}

TEST(mistakes_of_balls) {
    write_text("balls.target", "[target]\nkind=balls\nplane_mm=2\nplaces_mm=" BALLS "\n");
    capture("balls",
            "[sample]\nkind=balls\nwidth_mm=80\nheight_mm=80\nbase_mm=2\ntop_mm=40\n"
            "places_mm=" BALLS "\n",
            2, "20:3;40:3;65:3", "");
    g_autofree char *right = RUN(0, "\"name\": \"l65\"", "calibrate", "lights", "balls.session",
                                 "-t", "balls.target", "-o", "balls.calibration", "--json");
    assert_has(right, "\"warnings\": [");
    note("balls.session", TURN_BACK);
    g_free(RUN(1, "the turntable turns the wrong way, clockwise seen from above", "calibrate",
               "lights", "balls.session", "-t", "balls.target", "-o", "no.conf"));
    note("balls.session", TURN_BACK);
    note("balls.session", ARC_BACK);
    g_free(RUN(1, "the sign of steps_per_deg of [axis arc]", "calibrate", "lights", "balls.session",
               "-t", "balls.target", "-o", "no.conf"));
    note("balls.session", ARC_BACK);
    note("balls.session", LAMPS(0, 1));
    g_autofree char *told = RUN(1, "of lamp l40: the two lamps are exchanged", "calibrate",
                                "lights", "balls.session", "-t", "balls.target", "-o", "no.conf");
    assert_has(told, "exchange the indexes of [lamp l20] and [lamp l40] in the rig file");
}

/* After test_lamps_then_laser(). */
TEST(mistakes_of_sweeps) {
    static const char *const sessions[] = {"low.session", "high.session"};
    g_autofree char *here = in_folder("no.conf");
    g_autofree char *planes =
        RUN(1, "planes, 16 and 1 mm, are exchanged", "calibrate", "laser", "low.session",
            "high.session", "--planes", "16;1", "-c", "one.conf", "-o", "no.conf");
    assert_has(planes, "exchange the heights in --planes");
    g_free(RUN(1, "given as 15.5 mm, but the lines show ", "calibrate", "laser", "low.session",
               "high.session", "--planes", "1;15.5", "-c", "one.conf", "-o", "no.conf"));
    for (int i = 0; i < 2; i++)
        note(sessions[i], ARC_BACK);
    g_free(RUN(1, "the arc turns the wrong way", "calibrate", "laser", "low.session",
               "high.session", "-c", "one.conf", "-o", "no.conf"));
    for (int i = 0; i < 2; i++)
        note(sessions[i], "UPDATE shot SET arc_deg = -arc_deg * 0.017453292519943295");
    g_free(RUN(1, "the angles of the arc are in radians", "calibrate", "laser", "low.session",
               "high.session", "-c", "one.conf", "-o", "no.conf"));
    g_assert_false(g_file_test(here, G_FILE_TEST_EXISTS));
}

/* A ball as a camera far away sees it, lit from a direction or a place: a mirror image of the lamp
 * somewhat blurred. Written as sRGB, as cameras do. */
static void paint(guint8 *pixels, int size, const struct ball_outline *ball, struct vec3 lamp,
                  gboolean near, double gain) {
    for (int y = 0; y < size; y++)
        for (int x = 0; x < size; x++) {
            double u = (x - ball->x_px) / ball->radius_px, v = (ball->y_px - y) / ball->radius_px;
            if (u * u + v * v >= 1)
                continue;
            struct vec3 n = vec3(u, v, sqrt(1 - u * u - v * v)), d = lamp;
            if (near)
                d = vec3_unit(vec3_sub(lamp, vec3_add(vec3(ball->x_px, -ball->y_px, 0),
                                                      vec3_scale(n, ball->radius_px))));
            struct vec3 mirror = vec3_sub(vec3_scale(n, 2 * n.z), vec3(0, 0, 1));
            double light = 0.02 + gain * exp((vec3_dot(mirror, d) - 1) / 0.004);
            double code = light <= 0.0031308 ? 12.92 * light : 1.055 * pow(light, 1 / 2.4) - 0.055;
            pixels[y * size + x] = (guint8)lround(255 * MIN(code, 1));
        }
}

static void save(const char *name, guint8 *pixels, int size) {
    g_autofree char *path = in_folder(name);
    png_image image = {.version = PNG_IMAGE_VERSION,
                       .width = (png_uint_32)size,
                       .height = (png_uint_32)size,
                       .format = PNG_FORMAT_GRAY};
    g_assert_true(png_image_write_to_file(&image, path, 0, pixels, 0, NULL));
}

static struct vec3 light_in(const char *lp, const char *name) {
    g_autofree char *path = in_folder(lp), *text = NULL;
    g_assert_true(g_file_get_contents(path, &text, NULL, NULL));
    const char *at = strstr(text, name);
    struct vec3 d;
    g_assert_nonnull(at);
    g_assert_cmpint(sscanf(at + strlen(name), "%lf %lf %lf", &d.x, &d.y, &d.z), ==, 3);
    return d;
}

TEST(photographs) {
    static const struct ball_outline balls[] = {{150, 160, 60}, {450, 180, 60}, {300, 430, 60}};
    const int size = 600;
    g_autofree guint8 *pixels = g_new0(guint8, size * size);
    g_autofree char *folder = in_folder("photos"), *b = in_folder("photos/b.png");
    struct vec3 d = rig_direction(RAD(35), RAD(110));
    g_mkdir(folder, 0700);
    paint(pixels, size, &balls[0], d, FALSE, 0.8);
    save("photos/a.png", pixels, size);
    memset(pixels, 0, (gsize)size * (gsize)size);
    paint(pixels, size, &balls[0], d, FALSE, 40);
    save("photos/b.png", pixels, size);
    g_free(RUN(0, "2 of 2 photographs", "calibrate", "lights", "--images", "photos", "--ball",
               "150,160,60", "-o", "lights.lp"));
    struct vec3 found = light_in("lights.lp", "a.png");
    g_assert_cmpfloat(vec3_length(vec3_cross(found, d)), <, RAD(0.3));
    found = light_in("lights.lp", "b.png"); /* saturated */
    g_assert_cmpfloat(vec3_length(vec3_cross(found, d)), <, RAD(0.3));
    g_unlink(b);
    /* A lamp 1.5 m away from balls of 30 mm radius, 60 px: near. */
    struct vec3 lamp = vec3(900 + 150, 700 - 160, 2750);
    memset(pixels, 0, (gsize)size * (gsize)size);
    for (int i = 0; i < 3; i++)
        paint(pixels, size, &balls[i], lamp, TRUE, 0.8);
    save("photos/a.png", pixels, size);
    g_autofree char *out =
        RUN(0, "   at ", "calibrate", "lights", "-i", "photos", "--ball", "150,160,60", "--ball",
            "450,180,60", "--ball", "300,430,60", "--radius", "30", "-o", "lights.lp", "--force");
    double x, y, z;
    g_assert_cmpint(sscanf(strstr(out, "   at "), "   at %lf %lf %lf mm", &x, &y, &z), ==, 3);
    double distance = sqrt(x * x + y * y + z * z);
    struct vec3 way = vec3_unit(vec3_sub(lamp, vec3(150, -160, 0)));
    g_assert_cmpfloat(vec3_length(vec3_cross(vec3_scale(vec3(x, y, z), 1 / distance), way)), <,
                      RAD(1));
    g_assert_cmpfloat_with_epsilon(distance, vec3_length(vec3_sub(lamp, vec3(150, -160, 0))) / 2,
                                   75);
}

/* Photographs of 600 pixels, made smaller from 1200: 36 mm · 500 / 10 mm · 1/2 = 900 pixels. */
TEST(photographs_focal) {
    static const struct told told = {
        .focal = {36, 1}, .plane = {500, 1}, .plane_unit = 3, .full_px = 1200};
    static const struct ball_outline ball = {150, 160, 60};
    const int size = 600;
    g_autofree guint8 *pixels = g_new0(guint8, size * size);
    g_autofree guint16 *values = g_new0(guint16, size * size);
    g_autofree char *folder = in_folder("exif"), *path = in_folder("exif/a.png");
    g_mkdir(folder, 0700);
    paint(pixels, size, &ball, rig_direction(RAD(35), RAD(110)), FALSE, 0.8);
    for (int i = 0; i < size * size; i++)
        values[i] = pixels[i];
    told_png(path, size, size, 1, 8, values, &told);
    g_free(RUN(0, "focal length 900 px (EXIF: 36 mm, 25 pixels per mm)", "calibrate", "lights",
               "--images", "exif", "--ball", "150,160,60", "-o", "exif.lp"));
    g_autofree char *given = RUN(0, NULL, "calibrate", "lights", "--images", "exif", "--ball",
                                 "150,160,60", "--focal=900", "-o", "given.lp");
    g_assert_null(strstr(given, "EXIF"));
    told_png(path, size, size, 1, 8, values, NULL);
    g_autofree char *without = RUN(0, NULL, "calibrate", "lights", "--images", "exif", "--ball",
                                   "150,160,60", "-o", "far.lp");
    g_assert_null(strstr(without, "EXIF"));
    const struct vec3 found = light_in("exif.lp", "a.png"), near = light_in("given.lp", "a.png"),
                      far = light_in("far.lp", "a.png");
    g_assert_cmpfloat(vec3_length(vec3_sub(found, near)), <, 1e-5);
    /* The ball is seen about 11° away from the axis. */
    g_assert_cmpfloat(vec3_length(vec3_sub(found, far)), >, RAD(5));
}

AFTER_TESTS {
    remove_tree(world_fixture_folder());
}
