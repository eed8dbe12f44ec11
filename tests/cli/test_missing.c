/* Pictures that the plan left out: they are predicted from those of the lights around them, and
 * flagged. */
#include <glib/gstdio.h>
#include <math.h>
#include <sqlite3.h>

#include "btf/btf_missing.h"
#include "exr/exr.h"
#include "lib/ok.h"
#include "lib/operator.h"
#include "lib/test.h"

#define N_RINGS 5
#define N_PHI   12
#define N       (N_RINGS * N_PHI)
#define TEXELS  4

static double radians(double deg) {
    return deg * (G_PI / 180);
}

/* Lights at 15° to 75°. */
static struct btf_view *new_view(void) {
    struct btf_view *view = g_new0(struct btf_view, 1);
    view->lights = g_array_new(FALSE, FALSE, sizeof(struct btf_light));
    for (int i = 0; i < N; i++) {
        const int ring = i / N_PHI, k = i % N_PHI;
        const struct btf_light light = {
            .index = i, .theta_deg = 15.0 + 15.0 * ring, .phi_deg = 30.0 * k};
        g_array_append_val(view->lights, light);
    }
    return view;
}

/* Reflectance without the cosine: a plane over the unit disc, or a broad lobe around (40°, 20°). */
static double reflectance(const struct btf_light *light, gboolean lobe) {
    const double t = radians(light->theta_deg), p = radians(light->phi_deg);
    const double x = sin(t) * cos(p), y = sin(t) * sin(p);
    const double along = x * sin(radians(40)) * cos(radians(20)) +
                         y * sin(radians(40)) * sin(radians(20)) + cos(t) * cos(radians(40));
    return lobe ? 0.2 + pow(fmax(along, 0), 8) : 0.5 + 0.3 * x - 0.2 * y;
}

static double value(const struct btf_view *view, guint i, gboolean lobe) {
    const struct btf_light *light = &g_array_index(view->lights, struct btf_light, i);
    return cos(radians(light->theta_deg)) * reflectance(light, lobe);
}

static void take(const struct btf_view *view, struct exr_part **parts, guint i, gboolean lobe) {
    static const char *const channels[] = {"B", "G", "R", "mark", NULL};
    parts[i] = exr_part_new("light", TEXELS, 1, channels, EXR_FLOAT);
    for (int c = 0; c < 3; c++)
        for (int k = 0; k < TEXELS; k++)
            parts[i]->planes[c][k] = (float)((1 + c) * value(view, i, lobe));
}

static struct exr_part *predict(const struct btf_view *view, struct exr_part **parts, guint i) {
    static const char *const channels[] = {"B", "G", "R", "mark", NULL};
    guint8 marks[TEXELS];
    g_autofree double *weights = btf_missing_weights(view, parts, i);
    struct exr_part *part = exr_part_new("light", TEXELS, 1, channels, EXR_FLOAT);
    g_assert_nonnull(weights);
    btf_missing_flags(weights, parts, N, TEXELS, marks);
    btf_missing_fill(weights, parts, N, marks, part);
    for (int k = 0; k < TEXELS; k++)
        part->planes[3][k] = marks[k];
    return part;
}

static void free_parts(struct exr_part **parts) {
    for (int i = 0; i < N; i++)
        exr_part_free(parts[i]);
}

/* A plane is predicted exactly except for the effect of the prior, and a lobe better than by the
 * nearest light. */
TEST(between) {
    struct btf_view *view = new_view();
    double planes = 0, lobes = 0, nearest = 0;
    for (guint missing = 0; missing < N; missing++)
        for (int lobe = 0; lobe < 2; lobe++) {
            struct exr_part *parts[N] = {NULL};
            for (guint i = 0; i < N; i++)
                if (i != missing)
                    take(view, parts, i, lobe);
            struct exr_part *part = predict(view, parts, missing);
            const double truth = value(view, missing, lobe);
            const guint beside = missing % N_PHI ? missing - 1 : missing + 1;
            const double error = fabs(part->planes[0][TEXELS - 1] - truth) / truth;
            g_assert_cmpfloat(part->planes[3][0], ==, BTF_FLAG_PREDICTED);
            g_assert_cmpfloat(fabsf(part->planes[2][1] - 3 * part->planes[0][1]), <, 1e-4);
            planes = lobe ? planes : fmax(planes, error);
            lobes += lobe ? error / N : 0;
            nearest += lobe ? fabs(value(view, beside, TRUE) - truth) / truth / N : 0;
            exr_part_free(part);
            free_parts(parts);
        }
    g_test_message("plane: at most %.4f; lobe: %.3f on average, beside it %.3f", planes, lobes,
                   nearest);
    g_assert_cmpfloat(planes, <, 0.01);
    g_assert_cmpfloat(lobes, <, 0.6 * nearest);
    btf_view_free(view);
}

TEST(few) {
    struct btf_view *view = new_view();
    struct exr_part *parts[N] = {NULL};
    g_assert_null(btf_missing_weights(view, parts, 0));
    /* One light only: its reflectance, under the other's cosine. */
    take(view, parts, 2 * N_PHI, FALSE);
    struct exr_part *part = predict(view, parts, 0);
    g_assert_cmpfloat(fabs(part->planes[0][0] -
                           value(view, 2 * N_PHI, FALSE) * cos(radians(15)) / cos(radians(45))),
                      <, 1e-5);
    exr_part_free(part);
    /* Lights in a row, which tilt no plane across. */
    take(view, parts, N_PHI, FALSE);
    part = predict(view, parts, 0);
    g_assert_true(isfinite(part->planes[0][0]) && part->planes[0][0] > 0);
    exr_part_free(part);
    /* A texel that is a hole around is one here. */
    parts[N_PHI]->planes[3][2] = BTF_FLAG_HOLE;
    part = predict(view, parts, 0);
    g_assert_cmpfloat(part->planes[3][2], ==, BTF_FLAG_HOLE);
    g_assert_cmpfloat(part->planes[0][2], ==, 0);
    g_assert_cmpfloat(part->planes[3][1], ==, BTF_FLAG_PREDICTED);
    exr_part_free(part);
    free_parts(parts);
    btf_view_free(view);
}

static struct exr_file *read_view(const struct operation *run) {
    g_autofree char *path = g_build_filename(run->session, "products/btf/view_0000.exr", NULL);
    struct exr_file *file = ok(exr_read(path, ERR));
    return file;
}

/* What else would the plan have said. */
static void leave_out(const struct operation *run, const char *sources) {
    g_autofree char *path = g_build_filename(run->session, "session.db", NULL);
    g_autofree char *statement = g_strdup_printf(
        "DELETE FROM frame WHERE shot IN (SELECT id FROM shot WHERE kind = 'lamp' AND source IN "
        "(%s)); UPDATE shot SET state = 'skipped' WHERE kind = 'lamp' AND source IN (%s)",
        sources, sources);
    sqlite3 *db = NULL;
    g_assert_cmpint(sqlite3_open(path, &db), ==, SQLITE_OK);
    if (sqlite3_exec(db, statement, NULL, NULL, NULL) != SQLITE_OK)
        g_error("%s", sqlite3_errmsg(db));
    sqlite3_close(db);
}

static double difference(const struct exr_part *a, const struct exr_part *b) {
    double sum = 0, all = 0;
    for (int i = 0; i < a->width * a->height; i++) {
        const double x = exr_part_plane(a, "G")[i], y = exr_part_plane(b, "G")[i];
        sum += (x - y) * (x - y);
        all += y * y;
    }
    return sqrt(sum / all);
}

/* Two of 24 lights of a session: their pictures are nearer to what was taken than the next lights'
 * are; with three there is no BTF. */
TEST(session) {
    static const struct change changes[] = {{"[views]", "rings = 30:1"},
                                            {"[lights]", "rings = 30:12; 60:12"},
                                            {"[lights]", "offset_deg = 15"},
                                            {"[lasers]", NULL},
                                            {0}};
    struct operation *run = operator_new(NULL);
    small_rig_write(run->directory, "session.conf", changes);
    operator_captures(run, 0);
    operator_does(run, 0, "process", run->session, NULL);
    g_assert_null(strstr(run->out, "left out"));
    struct exr_file *whole = read_view(run);
    leave_out(run, "3, 17");
    operator_does(run, 0, "process", run->session, NULL);
    assert_has(run->out, "2 of the BTF's 24 pictures were left out by the plan");
    struct exr_file *made = read_view(run);
    g_assert_cmpuint(made->parts->len, ==, 24);
    for (guint i = 0; i < 24; i++) {
        const struct exr_part *part = made->parts->pdata[i], *truth = whole->parts->pdata[i];
        int predicted = -1;
        g_assert_true(exr_get_int(part, "mesorig.predicted", &predicted, NULL));
        g_assert_cmpint(predicted, ==, i == 3 || i == 17 ? part->width * part->height : 0);
        if (predicted == 0)
            continue;
        const double error = difference(part, truth);
        const double beside = difference(whole->parts->pdata[i + 1], truth);
        g_test_message("light %u: %.1f %%, the next one %.1f %%", i, 100 * error, 100 * beside);
        g_assert_cmpfloat(error, <, 0.8 * beside);
    }
    operator_does(run, 0, "check", run->session, NULL);
    assert_has(run->out, "not taken");
    operator_does(run, 0, "info", run->session, NULL);
    assert_has(run->out, "of pictures that were not taken");
    leave_out(run, "9");
    operator_does(run, 1, "process", run->session, NULL);
    assert_has(run->err, "more than 10 % of each view's pictures under the 24 lights");
    exr_file_free(whole);
    exr_file_free(made);
    operator_free(run);
}

TESTS_RUN_BY(operator_tests);
