/* Pictures of a session while its views are being captured. They show where a view is missing. */
#include "lib/capturing_fixture.h"
#include "lib/ok.h"
#include "lib/remove_tree.h"
#include "lib/test.h"
#include "lib/view_picture.h"
#include "window/live.h"
#include "window/series.h"

#include <gio/gio.h>

TEST(parse) {
    int percent[SERIES_MAX];
    g_assert_cmpint(series_parse("20,40,100", percent), ==, 3);
    g_assert_cmpint(percent[0], ==, 20);
    g_assert_cmpint(percent[2], ==, 100);
    const char *const bad[] = {"", "0", "20,", "20,20", "40,20", "101", "-1", "a", "20;40", "1.5"};
    for (gsize k = 0; k < G_N_ELEMENTS(bad); k++)
        g_assert_cmpint(series_parse(bad[k], percent), ==, 0);
    g_autoptr(GString) many = g_string_new("1");
    for (int k = 2; k <= 101; k++)
        g_string_append_printf(many, ",%d", k);
    g_assert_cmpint(series_parse(many->str, percent), ==, 0);
}

static int pixels_that_differ(Viewer *view, const struct viewer_settings *s, const guint8 *plain) {
    g_autoptr(GError) error = NULL;
    g_autofree guint8 *rgb = view_picture(view, s, 64, 64, &error);
    int n = 0;
    g_assert_no_error(error);
    for (int k = 0; k < 64 * 64; k++)
        n += memcmp(rgb + (gsize)3 * k, plain + (gsize)3 * k, 3) != 0;
    return n;
}

/* A plane seen from far away is seen from one direction: all of it is striped, or nothing. */
GPU_TEST(stripes) {
    g_autoptr(Viewer) view = view_fixture_plane(GREY, N_RINGS, N_PHI);
    struct planned_view views[N];
    for (int k = 0; k < N; k++)
        views[k] = (struct planned_view){capturing_theta_deg(k), capturing_phi_deg(k), k % 3 != 0};
    struct viewer_settings s = view_fixture_settings();
    s.camera_fov_deg = 1.0;
    s.camera_distance = 0.0;
    for (int k = 0; k < N_PHI; k++) { /* of the upper ring */
        g_autoptr(GError) error = NULL;
        s.camera_azimuth_deg = views[k].phi_deg + 20.0;
        s.camera_elevation_deg = 90.0 - views[k].theta_deg + 5.0;
        viewer_set_planned(view, NULL, 0);
        g_autofree guint8 *plain = ok(view_picture(view, &s, 64, 64, ERR));
        viewer_set_planned(view, views, N);
        const int n = pixels_that_differ(view, &s, plain);
        g_test_message("view %d: %d pixels striped", k, n);
        if (views[k].measured)
            g_assert_cmpint(n, ==, 0);
        else
            g_assert_cmpint(n, >, 300);
    }
    g_autoptr(GError) error = NULL;
    viewer_set_planned(view, NULL, 0);
    g_autofree guint8 *plain = view_picture(view, &s, 64, 64, &error);
    for (int k = 0; k < N; k++)
        views[k].measured = TRUE;
    viewer_set_planned(view, views, N);
    g_assert_cmpint(pixels_that_differ(view, &s, plain), ==, 0);
}

/* The program runs while views come, and each of its pictures has more of them. */
GPU_TEST(series) {
    if (!view_fixture_have_program())
        return;
    static const char *const names[] = {"p_025.png", "p_060.png", "p_100.png"};
    static const int there[] = {2, 5, 8};
    g_autoptr(GError) error = NULL;
    TEMPORARY_FOLDER(folder);
    g_autofree char *session = g_build_filename(folder, "a.session", NULL);
    g_autofree char *made = view_fixture_write_btf(GREY, N_RINGS, N_PHI), *out = NULL;
    g_autofree char *render = g_build_filename(folder, "p.png", NULL);
    /* Before there is a session. */
    g_autoptr(GSubprocess) program = g_subprocess_new(
        G_SUBPROCESS_FLAGS_STDOUT_PIPE, &error, VIEWER, session, "--live", "--series", "25,60,100",
        "--render", render, "--size", "96x72", "--json", "--wait-s", "60", NULL);
    g_assert_no_error(error);
    g_free(capturing_session_new(folder));
    int before = G_MAXINT;
    for (int k = 0, view = 0; k < 3; k++) {
        g_autofree char *path = g_build_filename(folder, names[k], NULL);
        g_assert_false(g_file_test(path, G_FILE_TEST_EXISTS));
        for (; view < there[k]; view++)
            capturing_move_view(made, session, view);
        for (int n = 0; n < 3000 && !g_file_test(path, G_FILE_TEST_EXISTS); n++)
            g_usleep(10000);
        g_assert_true(g_file_test(path, G_FILE_TEST_EXISTS));
    }
    ok(g_subprocess_communicate_utf8(program, NULL, NULL, &out, NULL, ERR));
    g_assert_cmpint(g_subprocess_get_exit_status(program), ==, 0);
    g_assert_nonnull(strstr(out, "\"frames\": 3"));
    g_assert_nonnull(strstr(out, "\"views\": 8"));
    for (int k = 0; k < 3; k++) {
        g_autofree char *path = g_build_filename(folder, names[k], NULL);
        int n = 0, width, height;
        g_autofree guint8 *rgb = view_fixture_read_png(path, &width, &height);
        for (int i = 0; i < width * height; i++)
            n += rgb[3 * i] > rgb[3 * i + 2] + 40; /* nothing else is orange */
        g_test_message("%s: %d pixels striped", names[k], n);
        g_assert_cmpint(n, <, before);
        before = n;
    }
    g_assert_cmpint(before, ==, 0);
    remove_tree(made);
}

static void refuse_to(const char *picture, const char *session, int code, const char *said,
                      const char *series) {
    g_autoptr(GError) error = NULL;
    g_autofree char *err = NULL;
    g_autoptr(GSubprocess) program = g_subprocess_new(
        G_SUBPROCESS_FLAGS_STDERR_PIPE, &error, VIEWER, session, "--live", "--series", series,
        "--render", picture, "--size", "32x24", "--wait-s", "0.5", NULL);
    g_assert_no_error(error);
    ok(g_subprocess_communicate_utf8(program, NULL, NULL, NULL, &err, ERR));
    g_test_message("%s", err);
    g_assert_cmpint(g_subprocess_get_exit_status(program), ==, code);
    g_assert_nonnull(strstr(err, said));
}

static void refuse(const char *session, int code, const char *said, const char *series) {
    g_autofree char *picture = g_build_filename(g_get_tmp_dir(), "mesorig-no-series.png", NULL);
    refuse_to(picture, session, code, said, series);
}

/* Nothing comes, nothing will come, or nobody captures here. */
GPU_TEST(refused) {
    if (!view_fixture_have_program())
        return;
    g_autoptr(GError) error = NULL;
    TEMPORARY_FOLDER(folder);
    g_autofree char *made = view_fixture_write_btf(GREY, N_RINGS, N_PHI);
    g_autofree char *session = capturing_session_new(folder);
    refuse("/nowhere.session", 1, "/nowhere.session", "50");
    refuse(session, 2, "--series", "50,20");
    refuse(session, 1, "no new view has come for 0.5 s, and 0 of 8", "50");
    capturing_move_view(made, session, 0);
    refuse(session, 1, "no new view has come for 0.5 s, and 1 of 8", "50");
    refuse_to("/nowhere/p.png", session, 1, "/nowhere/p", "10");
    g_autofree char *last = g_build_filename(session, "products", "eigenmaps.exr", NULL);
    g_assert_true(g_file_set_contents(last, "", 0, &error));
    g_autoptr(Session) opened = session_open(session, SESSION_PRODUCTS, &error);
    g_assert_no_error(error);
    ok(session_set_value(opened, "state", "aborted", ERR));
    refuse(session, 1, "its capture has ended with 1 of 8", "50");
    remove_tree(made);
}
