/* Test shots before a long capture: each thing that would spoil it is told, with its number and
 * what to change, before anything is captured. A rig without faults goes through. */
#include <glib/gstdio.h>
#include <string.h>

#include "lib/operator.h"
#include "lib/remove_tree.h"

/* 24 views under 24 lights. */
static const struct change many[] = {
    {"[views]", "rings = 30:12; 60:12"}, {"[lights]", "rings = 30:12; 60:12"}, {0}};

struct spoilt {
    struct change rig, world, session; /* head NULL: as it is */
    const char *told[3];
};

static struct operation *new_run(const struct spoilt *spoilt) {
    const struct change rig[] = {spoilt->rig, {0}}, world[] = {spoilt->world, {0}};
    const struct change session[] = {many[0], many[1], spoilt->session, {0}};
    struct operation *run = operator_new(rig);
    small_rig_write(run->directory, "world.conf", world);
    small_rig_write(run->directory, "session.conf", session);
    return run;
}

static void test_spoilt(void) {
    static const struct spoilt all[] = {
        /* 20 times too long, and too short. */
        {.session = {"[capture]", "exposures_us = 80000; 320000"},
         .told = {"camera cam30's pixels are saturated at 80000 µs under lamp lamp30",
                  "camera cam60's pixels are saturated", "exposures_us, to about"}},
        {.session = {"[capture]", "exposures_us = 200; 800"},
         .told = {"camera cam30 reaches only", "at 800 µs", "exposures_us, to about"}},
        {.rig = {"[lamps bank]", "fault_dead = lamp60"},
         .told = {"lamp lamp60 changes no camera's picture"}},
        {.world = {"[camera cam60]", "response = 0.01"},
         .told = {"camera cam60 sees none of the 2 lamps, at 16000 µs"}},
    };
    for (gsize i = 0; i < G_N_ELEMENTS(all); i++) {
        struct operation *run = new_run(&all[i]);
        operator_captures(run, 1);
        g_test_message("%s", run->err);
        for (gsize k = 0; k < G_N_ELEMENTS(all[i].told) && all[i].told[k]; k++)
            assert_has(run->err, all[i].told[k]);
        assert_has(run->err, "--yes goes on all the same");
        assert_has(run->err, "is not calibrated");
        g_assert_false(g_file_test(run->session, G_FILE_TEST_EXISTS));
        operator_free(run);
    }
}

/* What is suggested is good: neither too long nor too short. */
static void test_suggestion(void) {
    static const char *const wrong[] = {"exposures_us = 80000", "exposures_us = 400"};
    for (gsize i = 0; i < G_N_ELEMENTS(wrong); i++) {
        struct spoilt spoilt = {.session = {"[capture]", wrong[i]}};
        struct operation *run = new_run(&spoilt);
        operator_captures(run, 1);
        const double us = g_ascii_strtod(strstr(run->err, "to about ") + strlen("to about "), NULL);
        operator_free(run);
        g_autofree char *line = g_strdup_printf("exposures_us = %.0f", us);
        spoilt.session.line = line;
        run = new_run(&spoilt);
        operator_captures(run, 0);
        g_assert_null(strstr(run->err, "warning: camera"));
        operator_free(run);
    }
}

/* --yes warns, and goes on. A short session is not held up. */
static void test_yes(void) {
    const struct spoilt dead = {.world = {"[camera cam60]", "response = 0.01"}};
    struct operation *run = new_run(&dead);
    operator_does(run, 0, "capture", run->rig, run->conf, "-o", run->session, "--yes", NULL);
    assert_has(run->err, "mesorig: warning: camera cam60 sees none");
    operator_free(run);
    run = new_run(&dead);
    small_rig_write(run->directory, "session.conf", NULL);
    operator_captures(run, 0);
    g_assert_null(strstr(run->err, "warning: camera"));
    operator_free(run);
}

int main(int argc, char **argv) {
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/guard/spoilt", test_spoilt);
    g_test_add_func("/guard/suggestion", test_suggestion);
    g_test_add_func("/guard/yes", test_yes);
    return operator_tests();
}
