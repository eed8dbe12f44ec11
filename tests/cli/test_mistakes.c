/* What the operator is told of files of another rig and of damaged frames. Nothing moves, and
 * nothing is lost. (Mistakes in files: tests/transcripts/mistakes.t.) */
#include <glib/gstdio.h>
#include <string.h>
#include <unistd.h>

#include "lib/operator.h"
#include "lib/test.h"

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

/* A frame that was cut short or removed is named, and resume captures it again. The views that do
 * not need it are made nevertheless. */
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
