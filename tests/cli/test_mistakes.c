/* What the operator is told of files that are not what they should be: mistakes in the
 * configuration, another rig's, a database of garbage, damaged frames. Nothing moves, and nothing
 * is lost. */
#include <glib/gstdio.h>
#include <string.h>
#include <unistd.h>

#include "lib/operator.h"
#include "lib/test.h"

struct mistake {
    const char *file;
    const char *head, *line; /* of the change */
    const char *place;       /* what the message has after the file's path */
    const char *says;
    const char *told; /* the file that the message names; NULL: the one that was changed */
};

static const struct mistake mistakes[] = {
    {"rig.conf", "[axis turntable]", "setle_ms = 150", ":10: [axis turntable] setle_ms",
     "settle_ms?"},
    {"rig.conf", "[axis turntable]", "settle_s = 0.15", ":10: [axis turntable] settle_s",
     "write settle_ms"},
    {"rig.conf", "[axis turntable]", "speed_deg_s = -1", ":10: [axis turntable] speed_deg_s",
     "0.001 to 100000 deg/s"},
    {"rig.conf", "[axis turntable]", "speed_deg_s = NaN", ":10: [axis turntable] speed_deg_s",
     "not a number"},
    {"rig.conf", "[camera cam30]", "distance_mm = 650 mm", " [camera cam30] distance_mm",
     "write only the number"},
    {"rig.conf", "[axis turntable]", NULL, ":13: [views]: no camera stands at theta 30",
     "there is no [axis turntable] in the rig file", "session.conf"},
    {"rig.conf", "[lamps bank]", NULL, " [lamp lamp30] bank", "there is no section [lamps"},
    {"rig.conf", "[lamp lamp30]", "bank = benk", " [lamp lamp30] bank", "[lamps benk]"},
    {"rig.conf", "[camera cam30]", "width = 33", " [camera cam30] width", "write width = 32"},
    {"rig.conf", "[interlock door]", "driver = steam", " [interlock door] driver",
     "choose from: sim-interlock"},
    {"rig.conf", "[axis arc]", "world = welt.conf", " [axis arc] world: there is no file ",
     "welt.conf"},
    {"rig.conf", "[axis arc]", "part = leg",
     " [axis arc] part: ", "choose from: turntable, arc, arm, probe, laser30, laser60"},
    {"rig.conf", "[lamps bank]", "fault_dead = lamp61",
     " [lamps bank] fault_dead: ", "has no lamp \"lamp61\""},
    {"session.conf", "[views]", "rings = 30:2; 45:2",
     ":13: [views]: no camera stands at elevation 45°", "there are: 30° (cam30), 60° (cam60)"},
    {"session.conf", "[lights]", "rings = 10:2", " [lights]: no lamp stands at elevation 10°",
     "lamp30"},
    {"session.conf", "[lasers]", "rings = 45:1", " [lasers]: no laser stands at elevation 45°",
     "laser60"},
    {"session.conf", "[views]", NULL, ": there is no section [views]", "[views]"},
    {"session.conf", "[sample]", "texels = 100000", " [sample] texels", "0 to 8192"},
    {"session.conf", "[capture]", "exposures_us = 4000; nan", " [capture] exposures_us",
     "not a number"},
    {"session.conf", "[capture]", "exposures_ms = 4; 16", " [capture] exposures_ms",
     "write exposures_us"},
    {"session.conf", "[capture]", "sweep_steps = 60000", " [capture] sweep_steps", "8 to 32767"},
    {"session.conf", "[capture]", "dark_frames = 2.5", " [capture] dark_frames", "whole number"},
    /* units: radians, seconds, metres */
    {"rig.conf", "[camera cam30]", "theta_deg = 0.5236", ":13: [views]: no camera stands at",
     "there are: 0.5236° (cam30), 60° (cam60)", "session.conf"},
    {"session.conf", "[capture]", "exposures_us = 0.004; 0.016", " [capture] exposures_us",
     "0.004 is out of range"},
    {"rig.conf", "[camera cam30]", "distance_mm = 0.65", " [camera cam30] distance_mm",
     "0.65 is out of range"},
    {"session.conf", "[sample]", "width_mm = 0.05", " [sample] width_mm", "0.05 is out of range"},
    {"world.conf", "[world]", "gather_rays = nan", " [world] gather_rays", "whole number"},
};

/* A mistake in a file is told with its place and what would be right, before anything moves. A
 * capture reads the files as a plan does: that is tried with every third. */
TEST(mistakes) {
    for (gsize i = 0; i < G_N_ELEMENTS(mistakes); i++) {
        const struct mistake *mistake = &mistakes[i];
        struct operation *run = operator_new(NULL);
        g_autofree char *path =
            g_build_filename(run->directory, mistake->told ? mistake->told : mistake->file, NULL);
        small_rig_write(run->directory, mistake->file,
                        (const struct change[]){{mistake->head, mistake->line}, {0}});
        operator_does(run, 1, "plan", run->rig, run->conf, NULL);
        g_autofree char *planned = g_strdup(run->err);
        if (i % 3 == 0)
            operator_captures(run, 1);
        g_assert_cmpstr(run->err, ==, planned);
        assert_has(run->err, path);
        assert_has(run->err, mistake->place);
        assert_has(run->err, mistake->says);
        g_assert_false(g_file_test(run->session, G_FILE_TEST_EXISTS));
        operator_free(run);
    }
}

/* What drivers know of their options is told with all other mistakes, before any device is opened.
 */
TEST(drivers_mistakes) {
    static const struct change wrong[] = {{"[axis turntable]", "speed_deg_s = -1"},
                                          {"[axis arc]", "part = leg"},
                                          {"[lamps bank]", "fault_dead = lamp61"},
                                          {"[camera cam60]", "part = cam61"},
                                          {"[laser laser30]", "world = welt.conf"},
                                          {"[axis sweep60]", "home_deg = 20"},
                                          {0}};
    static const char *const says[] = {
        "6 mistakes:",
        "[axis turntable] speed_deg_s: -1 is out of range",
        "[axis arc] part: ",
        "[lamps bank] fault_dead: ",
        "[camera cam60] part: ",
        "has no camera \"cam61\"; choose from: cam30, cam60",
        "[laser laser30] world: there is no file ",
        "[axis sweep60] home_deg: 20 is outside of min_deg to max_deg, -15 to 15"};
    struct operation *run = operator_new(NULL);
    small_rig_write(run->directory, "rig.conf", wrong);
    operator_does(run, 1, "plan", run->rig, run->conf, NULL);
    g_autofree char *planned = g_strdup(run->err);
    for (gsize i = 0; i < G_N_ELEMENTS(says); i++)
        assert_has(run->err, says[i]);
    operator_does(run, 1, "plan", "--offline", run->rig, run->conf, NULL);
    g_assert_cmpstr(run->err, ==, planned);
    operator_free(run);
}

static const struct change late_death[] = {
    {"[lamps bank]", "fault_dead = lamp60"}, {"[lamps bank]", "fault_dead_after = 2"}, {0}};

/* With the file of another rig a session is not resumed, and stays as it is. */
TEST(other_rig) {
    struct operation *run = operator_new(late_death);
    g_autofree char *other = g_build_filename(run->directory, "other.conf", NULL);
    operator_captures(run, 1);
    g_autofree char *before = operator_frames(run->session);
    small_rig_write(run->directory, "rig.conf",
                    (const struct change[]){{"[rig]", "id = another"}, {0}});
    g_assert_cmpint(g_rename(run->rig, other), ==, 0);
    operator_does(run, 1, "resume", "--rig", other, run->session, NULL);
    assert_has(run->err, "the session was begun on rig small, but this is rig another");
    assert_has(run->err, run->session);
    operator_does(run, 1, "resume", run->session, NULL); /* its own is not there */
    assert_has(run->err, run->rig);
    assert_has(run->err, "--rig");
    g_autofree char *after = operator_frames(run->session);
    g_assert_cmpstr(before, ==, after);
    small_rig_write(run->directory, "rig.conf", NULL);
    operator_does(run, 0, "resume", run->session, NULL);
    operator_check_products(run);
    operator_free(run);
}

/* Arguments in the wrong order are one mistake, and a place where no session can be is told as
 * such.
 */
TEST(wrong_arguments) {
    struct operation *run = operator_new(NULL);
    operator_does(run, 1, "plan", run->conf, run->rig, NULL);
    assert_has(run->err, "session.conf is a session file, and ");
    assert_has(run->err, "rig.conf is a rig file: give RIG before SESSION\n");
    g_assert_true(strchr(run->err, '\n') == run->err + strlen(run->err) - 1);
    operator_does(run, 1, "capture", run->rig, run->rig, "-o", run->session, NULL);
    assert_has(run->err, "rig.conf is a rig file: give RIG before SESSION");
    g_assert_cmpint(g_mkdir(run->session, 0777), ==, 0);
    operator_captures(run, 1);
    assert_has(run->err, "exists already, and is not a session; choose another name");
    operator_does(run, 1, "plan", run->rig, run->conf, "-o", "/proc/weave.session", NULL);
    assert_has(run->err, "it is not on a disk");
    operator_does(run, 1, "info", run->rig, NULL);
    assert_has(run->err, "a text, not an EXR file");
    operator_free(run);
}

TEST(garbage_database) {
    struct operation *run = operator_new(NULL);
    g_autofree char *database = g_build_filename(run->session, "session.db", NULL);
    g_autofree char *garbage = g_malloc(9000);
    for (int i = 0; i < 9000; i++)
        garbage[i] = (char)g_test_rand_int();
    g_assert_cmpint(g_mkdir(run->session, 0777), ==, 0);
    g_assert_true(g_file_set_contents(database, garbage, 9000, NULL));
    static const char *const commands[] = {"resume", "process", "info", "status"};
    for (gsize i = 0; i < G_N_ELEMENTS(commands); i++) {
        operator_does(run, 1, commands[i], run->session, NULL);
        assert_has(run->err, database);
    }
    operator_captures(run, 1);
    assert_has(run->err, "exists already; choose another name, or resume it");
    g_autofree char *after = NULL;
    gsize length = 0;
    g_assert_true(g_file_get_contents(database, &after, &length, NULL));
    g_assert_cmpmem(after, length, garbage, 9000);
    operator_free(run);
}

/* A frame that was cut short or is gone: told by name, and mended by a resume. The views that do
 * not need it are made all the same. */
TEST(damaged_frames) {
    struct operation *run = operator_new(NULL);
    operator_undisturbed();
    operator_captures(run, 0);
    g_autofree char *frame = g_build_filename(run->session, "frames", "000003_cam30.exr", NULL);
    g_assert_cmpint(truncate(frame, 1000), ==, 0);
    operator_does(run, 1, "process", run->session, NULL);
    assert_has(run->err, frame);
    assert_has(run->err, "mesorig resume");
    operator_does(run, 0, "resume", run->session, NULL);
    g_assert_cmpint(g_remove(frame), ==, 0);
    operator_does(run, 1, "process", run->session, NULL);
    assert_has(run->err, frame);
    assert_has(run->err, "mesorig resume");
    operator_does(run, 0, "resume", run->session, NULL);
    operator_check_products(run);
    operator_free(run);
}

TESTS_RUN_BY(operator_tests);
