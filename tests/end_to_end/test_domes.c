/* Domes with as many lamps and cameras as published ones, through the real programs: plan, capture
 * in simulated time, processing, and what the commands, the viewer, the web server and the Python
 * package tell of the session. The rigs are whole, and the pictures are tiny. The sessions have
 * only some of the lights; MESORIG_DOMES=all in the environment captures all of them. */
#include "lib/dome.h"
#include "lib/ok.h"
#include "lib/operator.h"
#include "lib/process.h"
#include "lib/test.h"
#include "lib/text_file.h"
#include "lib/web_site.h"
#include "session/session.h"

#include <json-glib/json-glib.h>
#include <string.h>

#define SIDE 16 /* pixels */

static gboolean is_long(void) {
    return g_strcmp0(g_getenv("MESORIG_DOMES"), "all") == 0;
}

/* Runs mesorig with --json and returns the object of its last line. */
static JsonParser *json_of(struct operation *run, const char *command, const char *a,
                           const char *b) {
    JsonParser *parser = json_parser_new();
    operator_does(run, 0, command, a, "--json", b, NULL);
    g_auto(GStrv) lines = g_strsplit(g_strchomp(run->out), "\n", -1);
    ok(json_parser_load_from_data(parser, lines[g_strv_length(lines) - 1], -1, ERR));
    return parser;
}

static gint64 number(JsonParser *parser, const char *key) {
    JsonObject *object = json_node_get_object(json_parser_get_root(parser));
    if (!json_object_has_member(object, key))
        g_error("there is no “%s”", key);
    return json_object_get_int_member(object, key);
}

/* The whole session is planned, with all lights at all angles of the turntable. */
static void plan_all(struct operation *run, const struct dome *dome) {
    const int views = dome_n_cameras(dome) * dome->turns, lights = dome_n_lamps(dome);
    dome_write(dome, run->directory, SIDE, 1, dome->turns);
    g_autoptr(JsonParser) plan = json_of(run, "plan", run->rig, run->conf);
    g_assert_cmpint(number(plan, "views"), ==, views);
    g_assert_cmpint(number(plan, "lights"), ==, lights);
    g_assert_cmpint(number(plan, "poses"), ==, dome->turns);
    g_assert_cmpint(number(plan, "shots"), ==, 1 + dome->turns * lights);
    /* Each camera also takes a dark frame of each exposure: that of the lamps, and the lasers'. */
    g_assert_cmpint(number(plan, "frames"), >=, views * lights + dome_n_cameras(dome));
}

/* Every camera has taken every shot, and the shots know it. */
static void check_session(const char *path, const struct dome *dome) {
    const int n = dome_n_cameras(dome);
    g_autoptr(Session) session = ok(session_open(path, SESSION_READ, ERR));
    g_autoptr(GPtrArray) shots = ok(session_shots(session, ERR));
    g_autoptr(GPtrArray) frames = ok(session_frames(session, ERR));
    struct camera_set all = {{0}};
    for (int c = 0; c < n; c++)
        camera_set_add(&all, c);
    g_assert_cmpuint(frames->len, ==, shots->len * (guint)n);
    for (guint i = 0; i < shots->len; i++) {
        const struct session_shot *shot = shots->pdata[i];
        g_assert_true(camera_set_equal(shot->cameras, all));
        g_assert_cmpint(shot->state, ==, SHOT_DONE);
        for (int c = 0; c < n; c++) {
            const struct session_frame *frame = frames->pdata[i * (guint)n + (guint)c];
            g_assert_cmpint(frame->shot, ==, shot->id);
            g_assert_cmpint(frame->camera, ==, c);
        }
    }
}

static void check_commands(struct operation *run, const struct dome *dome, int lights) {
    const int views = dome_n_cameras(dome);
    g_autofree char *page = g_build_filename(run->directory, "page.html", NULL);
    g_autofree char *picture = g_build_filename(run->directory, "picture.png", NULL);
    g_autoptr(JsonParser) info = json_of(run, "info", run->session, NULL);
    g_assert_cmpint(number(info, "views"), ==, views);
    g_assert_cmpint(number(info, "lights"), ==, lights);
    g_assert_cmpint(number(info, "shots_done"), ==, 1 + lights);
    g_assert_cmpint(number(info, "frames"), ==, (1 + lights) * views);
    operator_does(run, 0, "verify", run->session, NULL);
    operator_does(run, 0, "check", run->session, NULL);
    assert_has(run->out, "0 % of the values are holes");
    operator_does(run, 0, "report", run->session, "-o", page, NULL);
    g_autofree char *html = text_file_read(page);
    /* A page has pictures of at most 32 cameras: of 70 every third. */
    assert_has(html, "<figcaption>cam_01, light");
    assert_has(html, views > 32 ? "<figcaption>cam_70, light" : "<figcaption>cam_02, light");
    g_assert_true((strstr(html, "<figcaption>cam_02, light") == NULL) == (views > 32));
    const char *argv[] = {
        BUILD_DIR "/bin/mesorig-view", run->session, "--render", picture, "--size", "32x24", NULL};
    g_free(process_text(0, argv));
    g_assert_true(g_file_test(picture, G_FILE_TEST_IS_REGULAR));
}

/* The Python package reads the same sets of cameras. */
static void check_python(const char *path, const struct dome *dome) {
    const char *argv[] = {"/usr/bin/env",
                          "PYTHONPATH=" SOURCE_DIR "/python",
                          "PYTHONDONTWRITEBYTECODE=1",
                          "/usr/bin/python3",
                          "-c",
                          "import sys, mesorig\n"
                          "session = mesorig.Session(sys.argv[1])\n"
                          "print({shot.cameras for shot in session.shots} "
                          "== {tuple(range(int(sys.argv[2])))}, "
                          "len(session.frames), len(session.calibration.devices('lamp')))",
                          path,
                          NULL,
                          NULL};
    g_autofree char *n = g_strdup_printf("%d", dome_n_cameras(dome));
    argv[7] = n;
    if (process_run((const char *[]){"/usr/bin/python3", "-c", "import numpy, OpenImageIO", NULL},
                    NULL, NULL) != 0) {
        g_test_message("the modules numpy and OpenImageIO are not installed");
        return;
    }
    g_autofree char *told = process_text(0, argv);
    g_autofree char *lamps = g_strdup_printf(" %d\n", dome_n_lamps(dome));
    assert_has(told, "True ");
    assert_has(told, lamps);
}

static void capture(const struct dome *dome, int every) {
    struct operation *run = operator_new(NULL);
    plan_all(run, dome);
    every = is_long() ? 1 : every;
    dome_write(dome, run->directory, SIDE, every, 1);
    /* All lamps are a long capture, before which there are test shots. They warn that the rig is
     * not calibrated. */
    operator_does(run, 0, "capture", "--yes", run->rig, run->conf, "-o", run->session, NULL);
    assert_has(run->out, "no retakes");
    check_session(run->session, dome);
    check_python(run->session, dome);
    operator_does(run, 0, "process", run->session, NULL);
    check_commands(run, dome, (dome_n_lamps(dome) + every - 1) / every);
    operator_free(run);
}

TEST(lamps_346) {
    capture(&dome_of_lamps, 25);
}

TEST(cameras_70) {
    capture(&dome_of_cameras, 25);
}

static guint count(JsonObject *state, const char *list, const char *class_name) {
    JsonArray *array = json_object_get_array_member(state, list);
    guint n = 0;
    for (guint i = 0; i < json_array_get_length(array); i++)
        n += g_str_equal(class_name, json_object_get_string_member(
                                         json_array_get_object_element(array, i), "class"));
    return n;
}

/* The web server lists all cameras and lamps, and has a picture of each camera. */
TEST(web) {
    struct site *site = site_new(0, NULL);
    g_autoptr(JsonParser) parser = json_parser_new();
    g_autofree char *text = NULL;
    dome_write(&dome_of_cameras, site->run->directory, SIDE, 71, 1);
    site_capture(site);
    g_assert_cmpuint(site_ask(site, "GET", "api/v1/state", NULL, &text), ==, 200);
    ok(json_parser_load_from_data(parser, text, -1, ERR));
    JsonObject *state = json_node_get_object(json_parser_get_root(parser));
    g_assert_cmpuint(count(state, "places", "lamp"), ==, 142);
    g_assert_cmpuint(count(state, "places", "camera"), ==, 70);
    g_assert_cmpuint(count(state, "devices", "camera"), ==, 70);
    for (int c = 1; c <= 70; c++) {
        g_autofree char *path = g_strdup_printf("api/v1/cameras/cam_%02d.json", c);
        g_assert_cmpuint(site_ask(site, "GET", path, NULL, NULL), ==, 200);
    }
    site_free(site);
}

/* A rig beyond the limits is refused, and the message says the limit. */
TEST(limits) {
    struct operation *run = operator_new(NULL);
    g_autoptr(GString) rig = g_string_new("[rig]\nid = too-large\nclock = virtual\n");
    for (int c = 1; c <= 257; c++)
        g_string_append_printf(
            rig,
            "[camera c%d]\ndriver = sim-camera\nworld = world.conf\npart = cam30\n"
            "theta_deg = 30\nphi_deg = %d\ndistance_mm = 650\nwidth = 32\n"
            "height = 32\nfocal_px = 300\nresponse = 6000\n",
            c, c);
    for (int bank = 1; bank <= 3; bank++)
        g_string_append_printf(rig,
                               "[lamps b%d]\ndriver = sim-lamps\nworld = world.conf\ncount = 342\n"
                               "distance_mm = 400\nexponent = 2\nintensity = 25\n",
                               bank);
    text_file_write(run->directory, "rig.conf", rig->str);
    operator_does(run, 1, "plan", "--offline", run->rig, run->conf, NULL);
    assert_has(run->err, "[camera c257]");
    assert_has(run->err, "at most 256 are allowed");
    assert_has(run->err, "more than 1024 lamps");
    operator_free(run);
}

TESTS_RUN_BY(operator_tests);
