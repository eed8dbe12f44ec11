/* What the window shows of a session before processing has written a view: eigen-maps of measured
 * and predicted pictures, against those of the BTF that processing makes later, and the line. */
#include "lib/capture_run.h"
#include "lib/ok.h"
#include "lib/test.h"
#include "pipeline/pipeline.h"
#include "window/live.h"
#include "window/live_pictures.h"
#include "window/series.h"

#include <gio/gio.h>
#include <math.h>

enum { VIEWS = 16, LIGHTS = 16, TEXELS = 8, COLUMN = LIGHTS * TEXELS * TEXELS * 3 };

static const struct change changes[] = {
    {"[sample]", "width_mm = 30"}, /* which all cameras see at all angles */
    {"[sample]", "height_mm = 30"},
    {"[views]", "rings = 30:8; 60:8"},
    {"[lights]", "rings = 30:8; 60:8"},
    {"[lasers]", NULL},
    {NULL, NULL},
};

static double value(const struct eigenmaps *maps, int view, int i) {
    double sum = 0;
    for (int k = 0; k < maps->n_terms; k++)
        sum += (double)(maps->weights[k * VIEWS + view] * maps->maps[k * COLUMN + i]);
    return sum;
}

/* Returns ‖a − b‖ / ‖b‖ over all views. */
static double compare(const struct eigenmaps *a, const struct eigenmaps *b) {
    double squares = 0, energy = 0;
    g_assert_cmpint((int)a->layout.views.n, ==, VIEWS);
    g_assert_cmpint((int)a->layout.lights.n, ==, LIGHTS);
    g_assert_cmpint(a->layout.width, ==, TEXELS);
    for (int v = 0; v < VIEWS; v++)
        for (int i = 0; i < COLUMN; i++) {
            squares += pow(value(a, v, i) - value(b, v, i), 2);
            energy += pow(value(b, v, i), 2);
        }
    return sqrt(squares / energy);
}

/* Returns the number of pictures under lamps that the session has. */
static int count_pictures(const char *path) {
    g_autoptr(GPtrArray) frames = run_frames(path), shots = run_shots(path);
    int n = 0;
    for (guint i = 0; i < frames->len; i++) {
        const struct session_frame *frame = frames->pdata[i];
        n += ((const struct session_shot *)shots->pdata[frame->shot - 1])->kind == SHOT_LAMP;
    }
    return n;
}

TEST(pictures) {
    struct run *run = run_begin(changes);
    g_autoptr(GCancellable) stop = g_cancellable_new();
    g_autoptr(LivePictures) pictures = live_pictures_new(run->session);
    while (count_pictures(run->session) < 100) /* frames wait for the intake */
        g_main_context_iteration(NULL, TRUE);
    ok(live_pictures_read(pictures, stop, ERR));
    struct eigenmaps *half = ok(live_pictures_eigenmaps(pictures, stop, ERR));
    g_autofree char *early = live_pictures_text(pictures);
    g_test_message("%s", early);
    g_assert_true(g_regex_match_simple("^[0-9]+ of 256 pictures are measured\\. Expected error "
                                       "[0-9.]+ % \\([0-9.]+ to [0-9.]+ %\\)",
                                       early, 0, 0));
    run_to_end(run);
    ok(live_pictures_read(pictures, stop, ERR));
    struct eigenmaps *whole = ok(live_pictures_eigenmaps(pictures, stop, ERR));
    g_autofree char *late = live_pictures_text(pictures);
    g_assert_cmpstr(late, ==, "256 of 256 pictures are measured.");
    for (int view = 0; view < VIEWS; view++)
        g_assert_true(live_pictures_has_view(pictures, view));
    struct pipeline_options options = {.n_eigenmaps = 1};
    struct pipeline_result result;
    ok(pipeline_run(run->session, &options, &result, ERR));
    int n_views;
    struct eigenmaps *truth = ok(live_eigenmaps(run->session, &n_views, ERR));
    const double early_error = compare(half, truth), late_error = compare(whole, truth);
    g_test_message("RMS difference from the BTF: %.4f, of all pictures %.4f", early_error,
                   late_error);
    g_assert_cmpfloat(late_error, <, 0.02);
    g_assert_cmpfloat(early_error, <, 0.2); /* without prediction it would be about 0.6 */
    g_cancellable_cancel(stop);
    g_autoptr(GError) error = NULL;
    g_assert_null(live_pictures_eigenmaps(pictures, stop, &error));
    g_assert_error(error, G_IO_ERROR, G_IO_ERROR_CANCELLED);
    eigenmaps_free(half);
    eigenmaps_free(whole);
    eigenmaps_free(truth);
    run_free(run);
}

/* The window's poll gives eigen-maps without a processed view. */
TEST(polls) {
    struct run *run = run_begin(changes);
    run_to_end(run);
    g_autoptr(Live) live = live_new(run->session);
    struct eigenmaps *maps = NULL;
    int n = -1;
    for (int i = 0; maps == NULL && i < 600; i++) {
        maps = live_poll(live, &n, NULL);
        g_usleep(G_USEC_PER_SEC / 20);
    }
    g_assert_nonnull(maps);
    g_assert_cmpint(n, ==, 0);
    g_assert_cmpstr(live_text(live), ==, "256 of 256 pictures are measured.");
    g_autoptr(GArray) views = ok(live_views(run->session, ERR));
    g_assert_cmpint(series_count(views), ==, 0);
    live_mark_pictures(live, views);
    g_assert_cmpint(series_count(views), ==, VIEWS);
    eigenmaps_free(maps);
    run_free(run);
}

TESTS_RUN_BY(run_tests);
