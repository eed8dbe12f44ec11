/* Exposures that are "auto" in a session file: they are chosen from test shots, stored and
 * reported, and a resumed session keeps them. If no exposure is suitable, there is an error that
 * names the key. */
#include <glib/gstdio.h>
#include <math.h>
#include <string.h>

#include "lib/ok.h"
#include "lib/operator.h"
#include "lib/remove_tree.h"
#include "lib/test.h"
#include "plan/plan.h"
#include "session/session.h"

#define MAX_CHANGES 6

static const struct change automatic[] = {{"[capture]", "exposures_us = auto"},
                                          {"[capture]", "laser_exposure_us = auto"},
                                          {"[capture]", "laser_short_us = auto"},
                                          {0}};

/* An operation with some changes of the session, and some of rig and world. */
static struct operation *new_auto(const struct change *further, const struct change *rig) {
    struct change changes[2 * MAX_CHANGES] = {0};
    int n = 0;
    for (; automatic[n].head; n++)
        changes[n] = automatic[n];
    for (; further && further->head; further++)
        changes[n++] = *further;
    struct operation *run = operator_new(rig);
    small_rig_write(run->directory, "world.conf", rig);
    small_rig_write(run->directory, "session.conf", changes);
    return run;
}

/* The session file as the session has it. */
static struct session_conf stored(const struct operation *run) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Session) session = session_open(run->session, SESSION_READ, &error);
    g_assert_no_error(error);
    g_autofree char *text = session_text(session, "session.conf", &error);
    struct session_conf conf = {0};
    g_assert_true(ok(session_conf_parse(&conf, text, run->session, ERR)));
    return conf;
}

TEST(chosen) {
    struct operation *run = new_auto(NULL, NULL), *again = new_auto(NULL, NULL);
    operator_captures(run, 0);
    assert_has(run->out, "exposures: chosen from test shots: exposures_us = ");
    g_auto(SessionConf) conf = stored(run);
    g_test_message("%g; %g µs, lasers %g and %g µs", conf.exposures_us[0], conf.exposures_us[1],
                   conf.laser_exposure_us, conf.laser_short_us);
    g_assert_cmpint(conf.n_exposures, >=, 2);
    for (int key = 0; key < AUTO_KEYS; key++)
        g_assert_false(conf.is_auto[key]);
    g_assert_cmpfloat(conf.exposures_us[conf.n_exposures - 1], <=, 100000);
    operator_does(run, 0, "info", run->session, NULL);
    assert_has(run->out, "chosen     exposures_us = ");
    g_autofree char *page = g_build_filename(run->directory, "page.html", NULL), *html = NULL;
    operator_does(run, 0, "report", run->session, "-o", page, NULL);
    g_assert_true(g_file_get_contents(page, &html, NULL, NULL));
    assert_has(html, "<th>Exposures chosen</th><td>exposures_us = ");
    /* The same rig and sample give the same. */
    operator_captures(again, 0);
    g_auto(SessionConf) twin = stored(again);
    g_assert_cmpstr(conf.text, ==, twin.text);
    operator_free(run);
    operator_free(again);
}

/* Cameras and lasers' lines twice as bright need half the exposure, to the two digits that are
 * given. */
TEST(proportion) {
    static const struct change bright[] = {
        {"[camera cam30]", "response = 12000"}, {"[camera cam60]", "response = 12000"}, {0}};
    struct operation *run = new_auto(NULL, NULL), *twice = new_auto(NULL, bright);
    operator_captures(run, 0);
    operator_captures(twice, 0);
    g_auto(SessionConf) a = stored(run);
    g_auto(SessionConf) b = stored(twice);
    g_assert_cmpint(a.n_exposures, ==, b.n_exposures);
    for (int i = 0; i < a.n_exposures; i++)
        g_assert_cmpfloat(fabs(a.exposures_us[i] / b.exposures_us[i] - 2), <, 0.2);
    g_assert_cmpfloat(fabs(a.laser_exposure_us / b.laser_exposure_us - 2), <, 0.2);
    operator_free(run);
    operator_free(twice);
}

/* A plan states the upper bounds that it assumes, and the capture takes no longer. */
TEST(plan) {
    struct operation *run = new_auto(NULL, NULL);
    operator_does(run, 0, "plan", run->rig, run->conf, NULL);
    assert_has(run->out, "upper bounds");
    assert_has(run->out, "exposures_us 6250; 25000; 100000");
    assert_has(run->out, "auto_longest_us, 100000,");
    operator_does(run, 0, "plan", run->rig, run->conf, "--json", NULL);
    const char *at = strstr(run->out, "\"predicted_s\": ");
    const double bound_s = g_ascii_strtod(at + strlen("\"predicted_s\": "), NULL);
    operator_captures(run, 0);
    g_autoptr(Session) session = session_open(run->session, SESSION_READ, NULL);
    g_autofree char *clock = session_value(session, "clock_s");
    g_autofree char *predicted = session_value(session, "predicted_s");
    g_assert_cmpfloat(g_ascii_strtod(clock, NULL), <, bound_s);
    g_assert_cmpfloat(g_ascii_strtod(predicted, NULL), <, bound_s);
    operator_free(run);
}

/* A dead lamp pauses the session. It continues with the chosen exposures, even if the file was
 * changed meanwhile. */
TEST(resume) {
    static const struct change dead[] = {{"[lamps bank]", "fault_dead = lamp60"}, {0}};
    struct operation *run = new_auto(NULL, dead);
    operator_captures(run, 1);
    assert_has(run->err, "lamp lamp60 gives no light");
    g_auto(SessionConf) before = stored(run);
    small_rig_write(run->directory, "rig.conf", NULL);
    g_unlink(run->conf);
    operator_does(run, 0, "resume", run->session, NULL);
    g_auto(SessionConf) after = stored(run);
    g_assert_cmpstr(before.text, ==, after.text);
    assert_has(run->out, "done: 13 of 13 shots, ");
    assert_has(run->out, " camera frames in this run, ");
    g_assert_null(strstr(run->out, "chosen from"));
    operator_free(run);
}

struct hopeless {
    struct change session, rig; /* rig: of rig and world */
    const char *told[2];
};

/* One key only; a short exposure where the long one saturates. */
TEST(single) {
    static const struct change fixed[] = {{"[capture]", "exposures_us = 4000; 16000"},
                                          {"[capture]", "laser_exposure_us = 1000000"},
                                          {0}};
    struct operation *run = new_auto(fixed, NULL);
    operator_captures(run, 0);
    g_auto(SessionConf) conf = stored(run);
    g_assert_cmpfloat(conf.exposures_us[0], ==, 4000);
    g_assert_cmpfloat(conf.laser_exposure_us, ==, 1e6);
    g_assert_cmpfloat(conf.laser_short_us, >, 10000);
    g_assert_cmpfloat(conf.laser_short_us, <, 500000);
    operator_free(run);
}

TEST(hopeless) {
    static const struct hopeless all[] = {
        {.session = {"[capture]", "auto_longest_us = 400"},
         .told = {"[capture] auto_longest_us: camera",
                  "under lamp60, but “exposures_us = auto” may choose 400 µs at most"}},
        {.session = {"[capture]", "auto_longest_us = 10000000"},
         .rig = {"[camera cam60]", "response = 6"},
         .told = {"exposures_us: camera cam30 may expose for", "Bring their apertures together"}},
        {.rig = {"[camera cam30]", "min_exposure_us = 60000"},
         .told = {"saturates under lamp30 even at 60000 µs", "lower [capture] gain_db"}},
        {.rig = {"[camera cam30]", "max_exposure_us = 50000"},
         .told = {"session.conf",
                  "[capture] auto_longest_us: 100000 µs is outside the range of camera"}},
        {.rig = {"[lamps bank]", "fault_dead = lamp30; lamp60"},
         .told = {"[capture] exposures_us: cannot be chosen: no camera sees a lamp at 100000 µs"}},
    };
    for (gsize i = 0; i < G_N_ELEMENTS(all); i++) {
        const struct change session[] = {all[i].session, {0}}, rig[] = {all[i].rig, {0}};
        struct operation *run = new_auto(session, NULL);
        small_rig_write(run->directory, "rig.conf", rig);
        if (all[i].rig.line && g_str_has_prefix(all[i].rig.line, "response"))
            small_rig_write(run->directory, "world.conf", rig);
        operator_captures(run, 1);
        g_test_message("%s", run->err);
        for (gsize k = 0; k < G_N_ELEMENTS(all[i].told) && all[i].told[k]; k++)
            assert_has(run->err, all[i].told[k]);
        g_assert_false(g_file_test(run->session, G_FILE_TEST_EXISTS));
        operator_free(run);
    }
}

/* A program that begins such a session must say what it has chosen. */
TEST(not_chosen) {
    struct operation *run = new_auto(NULL, NULL);
    g_auto(SessionConf) conf = {0};
    g_autoptr(GError) error = NULL;
    g_assert_true(session_conf_load(&conf, run->conf, &error));
    g_assert_false(session_conf_check_chosen(&conf, &error));
    assert_has(error->message, "[capture] exposures_us is auto");
    g_clear_error(&error);
    g_assert_false(session_conf_choose(&conf, "exposures_us = 5; 3\n", &error));
    assert_has(error->message, "list the shortest exposure first");
    g_clear_error(&error);
    g_assert_true(ok(session_conf_choose(
        &conf, "exposures_us = 3; 5\nlaser_exposure_us = 7\nlaser_short_us = 0\ngain_db = 9\n",
        ERR)));
    g_assert_cmpfloat(conf.gain_db, ==, 0);
    g_assert_cmpfloat(conf.exposures_us[1], ==, 5);
    operator_free(run);
}

TESTS_RUN_BY(operator_tests);
