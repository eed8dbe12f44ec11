/*
 * BTFs that were measured from a short distance: with the nominal directions they are clearly
 * wrong; after resampling they must have the values of the formula at the nominal directions.
 */
#include "lib/mdf_file.h"
#include "lib/near_field_fixture.h"
#include "lib/ok.h"
#include "lib/process.h"

#include "btf/btf.h"
#include "btf/near_field.h"
#include "lib/test.h"

/* ‖BTF − formula at its parts' directions‖ / ‖formula‖, of every elevation of twelve() and of all
 * (the last). */
static void wrong_by(const char *session, int n_views, double width, double ret[6]) {
    double error[6] = {0}, norm[6] = {0};
    for (int view = 0; view < n_views; view++) {
        struct exr_file *file = near_field_read_view(session, view);
        for (guint i = 0; i < file->parts->len; i++) {
            const struct exr_part *part = g_ptr_array_index(file->parts, i);
            double angles[4], v[3], l[3];
            exr_get_double(part, "view.theta_deg", &angles[0], NULL);
            exr_get_double(part, "view.phi_deg", &angles[1], NULL);
            exr_get_double(part, "light.theta_deg", &angles[2], NULL);
            exr_get_double(part, "light.phi_deg", &angles[3], NULL);
            near_field_direction(angles[0], angles[1], v);
            near_field_direction(angles[2], angles[3], l);
            for (int k = 0; k < 3 * ALL; k++) {
                const int ring = (int)lround(MAX(angles[0], 15) / 15) - 1;
                const double truth = near_field_formula(v, l, width, 2 - k / ALL);
                const double off = (double)part->planes[k / ALL][k % ALL] - truth;
                error[ring] += off * off;
                norm[ring] += truth * truth;
                error[5] += off * off;
                norm[5] += truth * truth;
            }
        }
        exr_file_free(file);
    }
    for (int k = 0; k < 6; k++)
        ret[k] = sqrt(error[k] / norm[k]);
}

/* Directions of the contract against those worked out here. */
TEST(near_field) {
    struct rings views = {0}, lights = {0};
    const struct wish wish = {0};
    near_field_add_ring(&views, 75, 3, 10);
    near_field_add_ring(&lights, 30, 4, 0);
    g_autofree char *path = near_field_make_session("near", &views, &lights, &wish);
    struct near_field *near = ok(near_field_read(path, ERR));
    for (int i = 0; i < 3 * 4 * ALL; i++) {
        const int view = i / 4 / ALL, light = i / ALL % 4, texel = i % ALL;
        double camera[3], lamp[3], at[3], v[3], l[3];
        near_field_texel_centre(texel, at);
        near_field_camera_at(&views, view, camera);
        near_field_lamp_at(&lights, view, light, lamp);
        near_field_towards(camera, at, v);
        near_field_towards(lamp, at, l);
        const struct vec3 got[] = {near_field_view(near, view, texel),
                                   near_field_light(near, view, light, texel)};
        g_assert_cmpfloat(fabs(got[0].x - v[0]) + fabs(got[0].y - v[1]) + fabs(got[0].z - v[2]), <,
                          1e-9);
        g_assert_cmpfloat(fabs(got[1].x - l[0]) + fabs(got[1].y - l[1]) + fabs(got[1].z - l[2]), <,
                          1e-9);
    }
    near_field_free(near);
}

TEST(own) {
    const struct rings views = near_field_twelve(0), lights = near_field_twelve(15);
    static const double widths[] = {0, 0.5};
    /* Diffuse and silk: what nominal reading is off by at least, resampling at most. */
    static const double nominal[] = {0.014, 0.04}, resampled[] = {0.0015, 0.01};
    for (int k = 0; k < 2; k++) {
        const struct wish wish = {.width = widths[k]};
        g_autofree char *from_name = g_strdup_printf("from%d", k);
        g_autofree char *to_name = g_strdup_printf("to%d", k);
        struct near_field_correction_result result;
        double before[6], after[6];
        g_autofree char *from = near_field_make_session(from_name, &views, &lights, &wish);
        g_autofree char *to = near_field_resample(from, to_name, NULL, &result);
        wrong_by(from, views.n, widths[k], before);
        wrong_by(to, views.n, widths[k], after);
        for (int ring = 0; ring < 6; ring++)
            g_test_message("width %g, %d degrees: %.3f %%, resampled %.3f %%", widths[k],
                           15 * (ring + 1), 100 * before[ring], 100 * after[ring]);
        g_test_message("said: back %.3f %%, nominal %.3f %%, left out %.2f %% and %.2f %%",
                       100 * result.all.back, 100 * result.all.nominal,
                       100 * result.all.left_out_view, 100 * result.all.left_out_light);
        g_assert_cmpfloat(before[5], >, nominal[k]);
        g_assert_cmpfloat(after[5], <, resampled[k]);
        g_assert_cmpfloat(fabs(result.all.nominal - before[5]), <, after[5] + 1e-3);
        g_assert_cmpfloat(result.all.back, >, after[5] / 2);
        g_assert_cmpfloat(result.all.back, <, 3 * after[5]);
        g_assert_true(result.exact);
        g_assert_false(result.mdf);
        near_field_correction_result_clear(&result);
    }
}

/* A level face 2 mm below the reference plane, from views that the BTF has not. */
static void write_mdf(const char *session) {
    struct rings views = {0};
    struct exr_file *file = exr_file_new();
    g_autofree char *path = g_build_filename(session, "products/mdf.exr", NULL);
    near_field_add_ring(&views, 35, 3, 17);
    for (int view = 0; view < views.n; view++) {
        struct exr_part *part = mdf_file_add_view(file, view, SIDE, SIDE, views.theta[view],
                                                  views.phi[view], SIDE_MM / SIDE);
        double camera[3], at[3], v[3];
        near_field_camera_at(&views, view, camera);
        for (int texel = 0; texel < ALL; texel++) {
            near_field_texel_centre(texel, at);
            near_field_towards(camera, at, v);
            part->planes[0][texel] = (float)(2 / v[2]);
        }
        exr_set_v3d(part, "view.centre_mm", camera[0], camera[1], camera[2]);
        exr_set_double(part, "reference_mm", LEVEL_MM);
    }
    ok(exr_write(path, file, EXR_NONE, FALSE, ERR));
    exr_file_free(file);
}

static void check_same_mdf(const char *from, const char *to) {
    g_autofree char *old_path = g_build_filename(from, "products/mdf.exr", NULL);
    g_autofree char *new_path = g_build_filename(to, "products/mdf.exr", NULL);
    g_autofree char *old_bytes = NULL, *new_bytes = NULL;
    gsize n_old = 0, n_new = 0;
    g_assert_true(g_file_get_contents(old_path, &old_bytes, &n_old, NULL));
    g_assert_true(g_file_get_contents(new_path, &new_bytes, &n_new, NULL));
    g_assert_cmpmem(old_bytes, n_old, new_bytes, n_new);
}

/* Not known where anything was, as after an import: the papers' directions from other ones. */
TEST(81) {
    const struct rings views = near_field_twelve(0), lights = near_field_twelve(15);
    const struct wish wish = {.width = 0.5, .nowhere = TRUE};
    struct near_field_correction_result result;
    struct btf_directions *to = btf_directions_81();
    g_autofree char *from = near_field_make_session("elsewhere", &views, &lights, &wish);
    write_mdf(from);
    g_autofree char *made = near_field_resample(from, "the81", to, &result);
    struct near_field *near = ok(near_field_read(made, ERR));
    g_assert_cmpint(near->views.n, ==, 81);
    g_assert_cmpint(near->lights.n, ==, 81);
    g_assert_cmpfloat((double)near->views.theta_deg[80], ==, 75);
    g_assert_cmpfloat(fabs((double)near->lights.phi_deg[80] - 345), <, 1e-4);
    g_assert_cmpfloat(near->grid.reference_mm, ==, LEVEL_MM);
    near_field_free(near);
    double wrong[6];
    wrong_by(made, 81, 0.5, wrong);
    g_test_message("60 x 60 -> 81 x 81: %.2f %%, back %.2f %%", 100 * wrong[5],
                   100 * result.all.back);
    g_assert_cmpfloat(wrong[5], <, 0.045);
    g_assert_cmpfloat(result.all.back, <, 0.03);
    g_assert_cmpfloat(result.all.nominal, <, 0);
    g_assert_false(result.exact);
    g_assert_true(result.mdf);
    check_same_mdf(from, made);
    near_field_correction_result_clear(&result);
    btf_directions_free(to);
}

/* A hole at one texel of a picture, a lower bound at another; the next is not a picture. */
static gboolean spoil_marks(struct exr_part *part, int view, int light) {
    float *mark = exr_part_plane(part, "mark");
    if (view == 14 && light == 20) {
        for (int c = 0; c < 3; c++)
            part->planes[c][5] = 0;
        mark[5] = BTF_FLAG_HOLE;
        mark[10] = BTF_FLAG_BOUND;
        exr_set_int(part, "mesorig.holes", 1);
        exr_set_int(part, "mesorig.bounds", 1);
    }
    for (int i = 0; view == 40 && light == 3 && i < ALL; i++)
        mark[i] = BTF_FLAG_PREDICTED;
    if (view == 40 && light == 3)
        exr_set_int(part, "mesorig.predicted", ALL);
    return TRUE;
}

static int count_marks(const struct exr_part *part, int mark, int *ret_first) {
    const float *plane = exr_part_plane(part, "mark");
    int n = 0;
    for (int i = 0; plane && i < ALL; i++)
        if ((int)plane[i] & mark) {
            n++;
            *ret_first = i;
        }
    return n;
}

TEST(marks) {
    const struct rings views = near_field_twelve(0), lights = near_field_twelve(15);
    const struct wish wish = {.width = 0.5, .spoil = spoil_marks};
    struct near_field_correction_result result;
    int hole = -1, bound = -1, said = 0;
    g_autofree char *from = near_field_make_session("marked", &views, &lights, &wish);
    g_autofree char *made = near_field_resample(from, "marked-to", NULL, &result);
    struct exr_file *file = near_field_read_view(made, 14);
    const struct exr_part *part = exr_file_part(file, "light_0020");
    const char *directions = NULL;
    double back = -1;
    g_assert_cmpint(count_marks(part, BTF_FLAG_HOLE, &hole), ==, 1);
    g_assert_cmpint(hole, ==, 5);
    g_assert_cmpfloat((double)part->planes[0][5], ==, 0);
    g_assert_cmpint(count_marks(part, BTF_FLAG_BOUND, &bound), ==, 1);
    g_assert_cmpint(bound, ==, 10);
    g_assert_true(exr_get_int(part, "mesorig.holes", &said, NULL));
    g_assert_cmpint(said, ==, 1);
    g_assert_true(exr_get_int(part, "mesorig.bounds", &said, NULL));
    g_assert_cmpint(said, ==, 1);
    g_assert_true(exr_get_string(part, "resample.directions", &directions, NULL));
    g_assert_cmpstr(directions, ==, "own");
    g_assert_true(exr_get_double(part, "resample.back", &back, NULL));
    g_assert_cmpfloat(back, ==, result.all.back);
    g_assert_cmpint(result.holes, ==, 1);
    g_assert_cmpint(result.bounds, ==, 1);
    exr_file_free(file);
    file = near_field_read_view(made, 40);
    part = exr_file_part(file, "light_0003");
    g_assert_cmpint(count_marks(part, BTF_FLAG_PREDICTED, &bound), ==, ALL);
    g_assert_true(exr_get_int(part, "mesorig.predicted", &said, NULL));
    g_assert_cmpint(said, ==, ALL);
    g_assert_cmpint(result.predicted, ==, ALL);
    exr_file_free(file);
    near_field_correction_result_clear(&result);
}

static gboolean spoil_place(struct exr_part *part, int view, int light) {
    if (view == 1 && light == 1)
        exr_set_v3d(part, "light.position_mm", NAN, 0, 500);
    return TRUE;
}

static gboolean spoil_below(struct exr_part *part, int view, int light) {
    if (view == 0 && light == 0)
        exr_set_v3d(part, "view.centre_mm", 100, 0, LEVEL_MM);
    return TRUE;
}

static gboolean spoil_angle(struct exr_part *part, int view, int light) {
    if (view == 1 && light == 0)
        exr_set_double(part, "light.phi_deg", 3);
    return TRUE;
}

static void refuse(const char *session, const char *name, const char *what) {
    g_autofree char *path = g_strdup_printf("%s/%s", near_folder, name);
    g_autoptr(GError) error = NULL;
    struct near_field_correction_result result;
    g_assert_false(near_field_correct(session, path, NULL, &quiet, &result, &error));
    g_assert_nonnull(error);
    if (!strstr(error->message, what))
        g_error("“%s” does not say “%s”", error->message, what);
    if (!g_str_equal(name, "there"))
        g_assert_false(g_file_test(path, G_FILE_TEST_EXISTS));
}

TEST(refused) {
    static const struct {
        const char *name;
        gboolean (*spoil)(struct exr_part *part, int view, int light);
        const char *what;
    } cases[] = {{"place", spoil_place, "must be finite and above the reference plane"},
                 {"below", spoil_below, "must be finite and above the reference plane"},
                 {"angle", spoil_angle, "the light of part light_0000 is at"}};
    struct rings few = {0};
    near_field_add_ring(&few, 40, 3, 0);
    for (gsize i = 0; i < G_N_ELEMENTS(cases); i++) {
        const struct wish wish = {.width = 0.5, .spoil = cases[i].spoil};
        g_autofree char *from = near_field_make_session(cases[i].name, &few, &few, &wish);
        refuse(from, "nothing", cases[i].what);
    }
    const struct wish wish = {.width = 0.5};
    g_autofree char *whole = near_field_make_session("whole", &few, &few, &wish);
    g_autofree char *there = g_build_filename(near_folder, "there", NULL);
    g_assert_true(g_file_set_contents(there, "", 0, NULL));
    refuse(whole, "there", "exists already");
    refuse("/nowhere", "nothing", "/nowhere");
    g_autofree char *cut = g_build_filename(whole, "products/btf/view_0001.exr", NULL);
    g_autofree char *bytes = NULL;
    gsize n = 0;
    g_assert_true(g_file_get_contents(cut, &bytes, &n, NULL));
    g_assert_true(g_file_set_contents(cut, bytes, (gssize)(n / 2), NULL));
    refuse(whole, "nothing", "view_0001.exr");
}

static void on_progress(const struct work_progress *progress, gpointer cancellable) {
    if (!g_str_equal(progress->stage, "read"))
        g_cancellable_cancel(cancellable);
}

TEST(cancelled) {
    const struct rings rings = near_field_twelve(0);
    const struct wish wish = {.width = 0.5, .nowhere = TRUE};
    g_autofree char *from = near_field_make_session("long", &rings, &rings, &wish);
    g_autofree char *path = g_build_filename(near_folder, "cancelled", NULL);
    g_autoptr(GCancellable) cancellable = g_cancellable_new();
    g_autoptr(GError) error = NULL;
    const struct work progress = {
        .n_threads = 1, .progress = on_progress, .data = cancellable, .cancellable = cancellable};
    struct near_field_correction_result result;
    g_assert_false(near_field_correct(from, path, NULL, &progress, &result, &error));
    g_assert_error(error, G_IO_ERROR, G_IO_ERROR_CANCELLED);
    g_assert_false(g_file_test(path, G_FILE_TEST_EXISTS));
}

/* Ends so, and says what somewhere. */
static void run_program(const char *const *arguments, int expected, const char *what) {
    g_autofree const char **argv = process_argv(BUILD_DIR "/bin/mesorig", arguments);
    g_autofree char *text = process_text(expected, argv);
    assert_has(text, what);
}

/* The command, and what takes a BTF takes what it makes. */
TEST(command) {
    struct rings rings = {0};
    near_field_add_ring(&rings, 20, 5, 0);
    near_field_add_ring(&rings, 50, 7, 0);
    const struct wish wish = {.width = 0.5};
    g_autofree char *from = near_field_make_session("command", &rings, &rings, &wish);
    g_autofree char *to = g_build_filename(near_folder, "command-to.session", NULL);
    g_autofree char *packed = g_build_filename(near_folder, "command.exr", NULL);
    const char *const none[] = {"resample", from, NULL};
    const char *const wrong[] = {"resample", from, "-o", to, "-d", "/nowhere.csv", NULL};
    const char *const good[] = {"resample", from, "-o", to, "--json", NULL};
    const char *const again[] = {"resample", from, "-o", to, NULL};
    const char *const compress[] = {"compress",     to,  "-o", packed, "-k", "2",
                                    "--components", "2", NULL};
    const char *const distances[] = {"compress", to,     "-m",      "mdf-views",
                                     "-o",       packed, "--force", NULL};
    const char *const check[] = {"check", to, NULL};
    const char *const process[] = {"process", to, NULL};
    const char *const info[] = {"info", to, NULL};
    write_mdf(from);
    run_program(none, 2, "-o DIR");
    run_program(wrong, 1, "/nowhere.csv");
    g_assert_false(g_file_test(to, G_FILE_TEST_EXISTS));
    run_program(good, 0, "\"by_view_made\"");
    run_program(again, 1, "exists already");
    run_program(compress, 0, packed);
    run_program(distances, 0, packed);
    run_program(check, 0, "0.00 % refuted");
    run_program(info, 0, "12 views");
    run_program(info, 0, "resampled to directions");
    run_program(process, 1, "imported");
}

BEFORE_TESTS {
    near_folder = g_dir_make_tmp("btf-resample-XXXXXX", NULL);
}

AFTER_TESTS {
    remove_tree(near_folder);
    g_free(near_folder);
}
