/*
 * Pictures with a table of poses. Where truth is a whole session, one is captured by simulated
 * devices, its frames are written as pictures, and what is processed from these has to be what was
 * processed from those.
 */
#include "base/text_table.h"
#include "codecs/lpca/lpca.h"
#include "formats/import_poses.h"
#include "lib/ok.h"
#include "lib/test.h"
#include "pipeline/catalogue.h"
#include "rig/devices.h"

#include "lib/process.h"
#include "lib/session_fixture.h"

#define RIG     SOURCE_DIR "/tests/small/rig.conf"
#define SESSION SOURCE_DIR "/tests/small/session.conf"
#define SIDE    32 /* pixels of the small rig's cameras */
#define PIXELS  (SIDE * SIDE)
#define WHITE   4095

static const struct work quietly = {0};
static const struct session_grid grid = {8, 8, 50, 50, 5, 5};
static char *calibration;

/* planes: Y, or R, G, B */
static void write_picture(const char *path, const float *const *planes, int n, int width) {
    static const char *const grey[] = {"Y", NULL}, *const rgb[] = {"B", "G", "R", NULL};
    g_autoptr(ExrFile) file = exr_file_new();
    struct exr_part *part = exr_part_new("picture", width, SIDE, n == 1 ? grey : rgb, EXR_FLOAT);
    for (int i = 0; i < n; i++)
        memcpy(part->planes[n - 1 - i], planes[i], sizeof(float) * (gsize)(width * SIDE));
    exr_file_add(file, part);
    g_assert_true(exr_write(path, file, EXR_NONE, FALSE, NULL));
}

static void write_grey(const char *dir, const char *name, const float *values) {
    g_autofree char *path = g_build_filename(dir, name, NULL);
    write_picture(path, &values, 1, SIDE);
}

static char *captured(void) {
    g_autofree char *text = NULL,
                    *conf = g_build_filename(session_fixture_folder, "session.conf", NULL);
    char *path = g_build_filename(session_fixture_folder, "captured.session", NULL);
    g_assert_true(g_file_get_contents(SESSION, &text, NULL, NULL));
    g_autofree char *with = g_strconcat(text, "\nkeep_laser_frames = yes\n", NULL);
    g_assert_true(g_file_set_contents(conf, with, -1, NULL));
    g_free(process_mesorig(0, "capture %s %s -o %s --process --yes --json", RIG, conf, path));
    return path;
}

/* One frame of a session as a picture, or a sweep as several; and their rows. */
static void add_frame(Session *session, const struct rig *rig, const struct session_shot *shot,
                      const struct session_frame *frame, const char *dir, GString *table) {
    const char *camera = rig->cameras[frame->camera].name;
    const int steps = shot->kind == SHOT_SWEEP ? shot->sweep_steps : 1;
    for (int k = 0; k < steps; k++) {
        g_autofree char *name = g_strdup_printf("p%d_%s_%d.exr", (int)shot->id, camera, k);
        g_autofree char *whole = session_file(session, frame->path);
        g_autofree char *stem = g_strndup(whole, strlen(whole) - 4);
        g_autofree char *raw = g_strdup_printf("%s/%04d.exr", stem, k);
        g_autoptr(ExrFile) file = exr_read(shot->kind == SHOT_SWEEP ? raw : whole, NULL);
        g_assert_nonnull(file);
        float *plane = exr_part_plane(file->parts->pdata[0], "Y");
        for (int i = 0; i < PIXELS; i++)
            plane[i] *= 1.0f / WHITE;
        write_grey(dir, name, plane);
        g_string_append_printf(table, "%s,%s,%s,%s,%.17g,%.17g", name, camera,
                               shot->kind == SHOT_LAMP ? rig->lamps[shot->device].name : "",
                               shot->kind == SHOT_LAMP ? "" : rig->lasers[shot->device].name,
                               shot->turntable_deg, shot->arc_deg);
        g_string_append_printf(table, ",%.17g\n",
                               shot->sweep_from_deg + (shot->sweep_to_deg - shot->sweep_from_deg) *
                                                          k / MAX(steps - 1, 1));
    }
}

static char *as_pictures(const char *path, const char *dir) {
    g_autoptr(Session) session = session_open(path, SESSION_READ, NULL);
    g_autoptr(GPtrArray) frames = session_frames(session, NULL);
    g_autoptr(GPtrArray) shots = session_shots(session, NULL);
    g_autoptr(GString) table =
        g_string_new("file,camera,lamp,laser,turntable_deg,arc_deg,sweep_deg\n# rows\n");
    struct rig *rig = g_new0(struct rig, 1);
    g_assert_true(devices_read_geometry(RIG, rig, NULL));
    for (guint i = 0; i < frames->len; i++) {
        const struct session_frame *frame = frames->pdata[i];
        const struct session_shot *shot = shots->pdata[frame->shot - 1];
        if (shot->kind != SHOT_DARK)
            add_frame(session, rig, shot, frame, dir, table);
    }
    g_free(rig);
    char *file = g_build_filename(dir, "poses.csv", NULL);
    g_assert_true(g_file_set_contents(file, table->str, -1, NULL));
    return file;
}

/* The same parts, found by what their attribute says. */
static void compare_files(const char *a_path, const char *b_path, const char *channel,
                          double tolerance) {
    g_autoptr(ExrFile) a = exr_read(a_path, NULL), b = exr_read(b_path, NULL);
    g_assert_true(a && b);
    g_assert_cmpuint(a->parts->len, ==, b->parts->len);
    for (guint i = 0; i < a->parts->len; i++) {
        const struct exr_part *x = a->parts->pdata[i], *y = NULL;
        double theta, phi, other_theta, other_phi;
        g_assert_true(exr_get_double(x, "light.theta_deg", &theta, NULL) &&
                      exr_get_double(x, "light.phi_deg", &phi, NULL));
        for (guint k = 0; k < b->parts->len && !y; k++)
            if (exr_get_double(b->parts->pdata[k], "light.theta_deg", &other_theta, NULL) &&
                exr_get_double(b->parts->pdata[k], "light.phi_deg", &other_phi, NULL) &&
                fabs(theta - other_theta) < 1.5 && fabs(remainder(phi - other_phi, 360)) < 1.5)
                y = b->parts->pdata[k];
        g_assert_nonnull(y);
        const float *p = exr_part_plane(x, channel), *q = exr_part_plane(y, channel);
        for (int t = 0; t < x->width * x->height; t++)
            g_assert_cmpfloat_with_epsilon((double)p[t], (double)q[t],
                                           tolerance * (1 + fabs((double)p[t])));
    }
}

static void compare_mdf(const char *a_path, const char *b_path, const int *other, guint n) {
    g_autoptr(ExrFile) a = exr_read(a_path, NULL), b = exr_read(b_path, NULL);
    g_assert_true(a && b);
    int seen = 0;
    for (guint v = 0; v < n; v++) {
        g_autofree char *x = g_strdup_printf("view_%04d", (int)v);
        g_autofree char *y = g_strdup_printf("view_%04d", other[v]);
        const float *p = exr_part_plane(exr_file_part(a, x), "D");
        const float *q = exr_part_plane(exr_file_part(b, y), "D");
        for (int t = 0; t < 64; t++) {
            g_assert_cmpfloat_with_epsilon((double)p[t], (double)q[t], 1e-4);
            seen += p[t] >= 0;
        }
    }
    g_assert_cmpint(seen, >, 20);
}

TEST(session) {
    g_autofree char *path = captured(), *dir = session_fixture_new_folder(),
                    *again = session_fixture_path("again");
    g_autofree char *table = as_pictures(path, dir);
    const struct import_poses poses = {.table = table,
                                       .calibration = calibration,
                                       .cfa = "rggb",
                                       .grid = grid,
                                       .threshold_dn = 40};
    struct import_poses_result result;
    g_assert_true(ok(import_poses(again, &poses, &quietly, &result, ERR)));
    g_assert_cmpint(result.n_views, ==, 4);
    g_assert_cmpint(result.n_lights, ==, 4);
    g_assert_cmpint(result.n_lasers, ==, 2);
    g_free(process_mesorig(0, "process %s --json", again));
    g_autoptr(Session) session = session_open(path, SESSION_READ, NULL);
    g_autoptr(Session) imported = session_open(again, SESSION_READ, NULL);
    g_autoptr(GPtrArray) views = session_views(session, NULL);
    g_autoptr(GPtrArray) others = session_views(imported, NULL);
    g_assert_true(views && others);
    int other[4] = {-1, -1, -1, -1};
    for (guint v = 0; v < 4; v++)
        for (guint k = 0; k < 4; k++) {
            const struct session_direction *a = views->pdata[v], *b = others->pdata[k];
            if (a->device != b->device ||
                fabs(remainder(a->turntable_deg - b->turntable_deg, 360)) > 1e-6)
                continue;
            other[v] = (int)k;
            g_assert_cmpfloat_with_epsilon(a->theta_deg, b->theta_deg, 1.5);
            g_autofree char *x = g_strdup_printf("%s/products/btf/view_%04d.exr", path, (int)v);
            g_autofree char *y = g_strdup_printf("%s/products/btf/view_%04d.exr", again, (int)k);
            compare_files(x, y, "R", 2e-3);
            compare_files(x, y, "B", 2e-3);
        }
    g_autofree char *a = g_build_filename(path, "products/mdf.exr", NULL);
    g_autofree char *b = g_build_filename(again, "products/mdf.exr", NULL);
    compare_mdf(a, b, other, 4);
}

/* A table of rows, and what import says of it. */
static gboolean import_rows(const char *dir, const char *path, const char *rows,
                            enum import_edge edge, struct import_poses_result *ret,
                            GError **error) {
    g_autofree char *table = g_build_filename(dir, "poses.csv", NULL);
    const struct import_poses poses = {.table = table,
                                       .calibration = calibration,
                                       .cfa = "mono",
                                       .grid = grid,
                                       .edge = edge,
                                       .threshold_dn = 40};
    g_assert_true(g_file_set_contents(table, rows, -1, NULL));
    return import_poses(path, &poses, &quietly, ret, error);
}

static void assert_refused(const char *dir, const char *rows, const char *what) {
    g_autoptr(GError) error = NULL;
    g_autofree char *path = session_fixture_path("refused");
    struct import_poses_result result;
    g_assert_false(import_rows(dir, path, rows, IMPORT_LINE, &result, &error));
    g_assert_nonnull(error);
    assert_has(error->message, what);
    g_assert_false(g_file_test(path, G_FILE_TEST_EXISTS));
}

TEST(bad) {
    g_autofree char *dir = session_fixture_new_folder(),
                    *wide = g_build_filename(dir, "wide.exr", NULL);
    float values[(SIDE + 1) * SIDE] = {0};
    const float *plane = values;
    write_grey(dir, "a.exr", values);
    write_grey(dir, "b.exr", values);
    write_picture(wide, &plane, 1, SIDE + 1);
    for (int i = 0; i < PIXELS / 2 + 1; i++)
        values[i] = NAN;
    write_grey(dir, "nan.exr", values);
#define HEAD "file,camera,lamp,laser,turntable_deg,arc_deg,sweep_deg\n"
    assert_refused(dir, "", "the table is empty; its first line must name the columns");
    assert_refused(dir, "file,camera\na.exr,cam30\n",
                   "the header line lacks the column lamp or laser");
    assert_refused(dir, "file,file\n", "poses.csv:1: there are two columns “file”");
    assert_refused(dir, "file,camera,lamp,exposure\na.exr,cam30,lamp30,2\n",
                   "poses.csv:1: the column “exposure” is not known; did you mean “exposure_ms”?");
    assert_refused(dir, HEAD "a.exr,cam30\n",
                   "poses.csv:2: this line has 2 fields, but the header line has 7");
    assert_refused(dir, HEAD "\"a.exr,cam30\n", "poses.csv:2: a field begins with a double quote");
    assert_refused(dir, HEAD "\n#\na.exr,cam31,lamp30,,0,0,\n",
                   "poses.csv:4: camera “cam31” is not in");
    assert_refused(dir, HEAD "a.exr,cam30,lamp31,,0,0,\n", "poses.csv:2: lamp “lamp31” is not in");
    assert_refused(dir, HEAD "a.exr,cam30,,lamp30,0,0,1\n",
                   "poses.csv:2: laser “lamp30” is not in");
    assert_refused(dir, HEAD "a.exr,cam30,,,0,0,1\n", "lamp and laser are both empty");
    assert_refused(dir, HEAD "a.exr,cam30,lamp30,laser30,0,0,1\n", "there are a lamp and a laser");
    assert_refused(dir, HEAD "c.exr,cam30,lamp30,,0,0,\n", "poses.csv:2: there is no picture /");
    assert_refused(dir, HEAD "a.exr,cam30,lamp30,,0°,0,\n",
                   "poses.csv:2: “0°” in column turntable_deg is not a number");
    assert_refused(dir, HEAD "a.exr,cam30,lamp30,,inf,0,\n", "“inf” in column turntable_deg");
    assert_refused(dir, HEAD "wide.exr,cam30,lamp30,,0,0,\n",
                   "poses.csv:2: wide.exr has 33 × 32 pixels, but camera cam30 has 32 × 32");
    assert_refused(dir, HEAD "nan.exr,cam30,lamp30,,0,0,\n",
                   "poses.csv:2: 513 of the 1024 pixels of nan.exr are not numbers");
    assert_refused(dir, HEAD "a.exr,cam30,lamp30,,0,0,\nb.exr,cam30,lamp30,,360,-360,\n",
                   "b.exr has the same camera, angles and light as the picture of line 2, a.exr");
    assert_refused(
        dir, HEAD "a.exr,cam30,lamp30,,0,0,\nb.exr,cam60,lamp30,,0,0,\nb.exr,cam30,lamp60,,0,90,\n",
        "there is no picture of camera cam60 at turntable_deg 0 under lamp lamp60 at arc_deg 90");
    assert_refused(dir, HEAD "a.exr,cam30,,laser30,0,0,\n", "poses.csv:2: sweep_deg is empty");
    assert_refused(dir, HEAD "a.exr,cam30,,laser30,0,0,1\n",
                   "the sweep that begins here has 1 pictures, but needs at least 4");
    assert_refused(dir,
                   HEAD "a.exr,cam30,,laser30,0,0,1\na.exr,cam30,,laser30,0,0,2\n"
                        "a.exr,cam30,,laser30,0,0,3\na.exr,cam30,,laser30,0,0,4.4\n"
                        "a.exr,cam30,,laser30,0,0,5\n",
                   "has steps of 1°, but a.exr is at 4.4°");
    assert_refused(
        dir,
        HEAD "a.exr,cam30,,laser30,0,0,1\na.exr,cam30,,laser30,0,0,2\n"
             "a.exr,cam30,,laser30,0,0,3\na.exr,cam30,,laser30,0,0,6\n",
        "the sweep that begins here lacks 2 of its 6 pictures, for instance the one at 4°");
}

/* A view may lack one light in ten: here camera cam30 lacks one of twelve, and cam60, which shows
 * that light, has all. What is missing is predicted. */
TEST(missing) {
    g_autoptr(GError) error = NULL;
    g_autofree char *dir = session_fixture_new_folder(), *path = session_fixture_path("missing");
    g_autofree char *less = session_fixture_path("less");
    g_autoptr(GString) table = g_string_new(HEAD);
    g_autoptr(GPtrArray) notes = g_ptr_array_new_with_free_func(g_free);
    float values[PIXELS];
    struct import_poses_result result;
    for (int i = 0; i < PIXELS; i++)
        values[i] = 0.5f;
    write_grey(dir, "a.exr", values);
    for (int k = 0; k < 12; k++)
        for (int c = 30; c <= 60; c += 30)
            if (k != 3 || c == 60)
                g_string_append_printf(table, "a.exr,cam%d,lamp30,,0,%d,\n", c, 30 * k);
    g_autofree char *file = g_build_filename(dir, "poses.csv", NULL);
    g_assert_true(g_file_set_contents(file, table->str, -1, NULL));
    const struct import_poses poses = {.table = file,
                                       .calibration = calibration,
                                       .cfa = "mono",
                                       .grid = grid,
                                       .threshold_dn = 40,
                                       .notes = notes};
    g_assert_true(ok(import_poses(path, &poses, &quietly, &result, ERR)));
    g_assert_cmpint(result.n_missing, ==, 1);
    gboolean told = FALSE;
    for (guint i = 0; i < notes->len; i++)
        told |= strstr(notes->pdata[i], "camera cam30 at turntable_deg 0 lacks 1 of its 12 "
                                        "pictures under lamps, for instance the one under "
                                        "lamp30 at arc_deg 90") != NULL;
    g_assert_true(told);
    g_autofree char *made = process_mesorig(0, "process %s", path);
    assert_has(made, "BTF of 2 views × 12 lights");
    assert_has(made, "1 of the BTF's 24 pictures");
    /* One more, which is too many: the second light that cam30 lacks is one that no other shows. */
    g_autofree char *row = g_strdup("a.exr,cam30,lamp30,,0,120,\n");
    char *at = strstr(table->str, row);
    g_assert_nonnull(at);
    g_string_erase(table, at - table->str, (gssize)strlen(row));
    g_assert_false(import_rows(dir, less, table->str, IMPORT_LINE, &result, &error));
    assert_has(error->message, "this one lacks 2 of 12");
}

/* Light of a matt surface whose normals differ from pixel to pixel. */
static void shade(float *values, double theta_rad, double phi_rad) {
    for (int i = 0; i < PIXELS; i++) {
        const double x = 0.6 * (2.0 * (i % SIDE) / (SIDE - 1) - 1);
        const double y = 0.6 * (1 - 2.0 * (i / SIDE) / (SIDE - 1)), z = sqrt(1 - x * x - y * y);
        const double cosine =
            sin(theta_rad) * (x * cos(phi_rad) + y * sin(phi_rad)) + z * cos(theta_rad);
        values[i] = (float)(0.9 * MAX(cosine, 0));
    }
}

/* What import says of the pictures themselves, of twelve under one lamp. */
static const struct noticed {
    const char *path, *says; /* NULL: no warning */
    gboolean dark, decoded;
} noticings[] = {
    {"/poses/noticed/nothing", NULL, FALSE, FALSE},
    {"/poses/noticed/dead lamp", "warning: 1 of 12 lights are dark", TRUE, FALSE},
    {"/poses/noticed/tones", "warning: read as linear, the pictures differ from a matt surface",
     FALSE, TRUE},
};

static void test_noticed(gconstpointer data) {
    const struct noticed *noticed = data;
    g_autoptr(GError) error = NULL;
    g_autofree char *dir = session_fixture_new_folder();
    g_autofree char *path = session_fixture_path(strrchr(noticed->path, '/') + 1);
    g_autoptr(GString) table = g_string_new(HEAD);
    g_autoptr(GPtrArray) notes = g_ptr_array_new_with_free_func(g_free);
    float values[PIXELS];
    struct import_poses_result result;
    for (int k = 0; k < 12; k++) {
        g_autofree char *name = g_strdup_printf("p%d.exr", k);
        shade(values, (k % 2 ? 60 : 30) * G_PI / 180, k * G_PI / 6);
        for (int i = 0; i < PIXELS; i++)
            values[i] = noticed->dark && k == 5 ? 0.001f
                        : noticed->decoded      ? powf((values[i] + 0.055f) / 1.055f, 2.4f)
                                                : values[i];
        write_grey(dir, name, values);
        g_string_append_printf(table, "%s,cam30,lamp%d,,0,%d,\n", name, k % 2 ? 60 : 30, 30 * k);
    }
    g_autofree char *file = g_build_filename(dir, "poses.csv", NULL);
    g_assert_true(g_file_set_contents(file, table->str, -1, NULL));
    const struct import_poses poses = {.table = file,
                                       .calibration = calibration,
                                       .cfa = "mono",
                                       .grid = grid,
                                       .threshold_dn = 40,
                                       .notes = notes};
    g_assert_true(ok(import_poses(path, &poses, &quietly, &result, ERR)));
    int warnings = 0, told = 0;
    for (guint i = 0; i < notes->len; i++) {
        g_test_message("%s", (char *)notes->pdata[i]);
        warnings += g_str_has_prefix(notes->pdata[i], "warning: ");
        told += noticed->says && g_str_has_prefix(notes->pdata[i], noticed->says);
    }
    g_assert_cmpint(warnings, ==, noticed->says ? 1 : 0);
    g_assert_cmpint(told, ==, noticed->says ? 1 : 0);
    /* check finds it in the session again. */
    g_autoptr(Session) session = session_open(path, SESSION_READ, &error);
    g_assert_no_error(error);
    g_autoptr(GPtrArray) suspects = g_ptr_array_new_with_free_func(g_free);
    session_suspicions(session, suspects);
    g_assert_cmpuint(suspects->len, ==, noticed->says ? 1 : 0);
}

/* Imports pictures that are evenly grey, as a table of poses has them, with this calibration.
 * Returns the calibration's file. */
static char *import_grey(const char *path, const struct calibration *known, const char *table) {
    g_autofree char *dir = session_fixture_new_folder(),
                    *poses_csv = g_build_filename(dir, "poses.csv", NULL);
    char *file = g_build_filename(dir, "known.calibration", NULL);
    struct import_poses_result result;
    float values[PIXELS];
    for (int i = 0; i < PIXELS; i++)
        values[i] = 0.5f;
    g_assert_true(ok(calibration_write(known, file, ERR)));
    write_grey(dir, "a.exr", values);
    g_assert_true(g_file_set_contents(poses_csv, table, -1, NULL));
    const struct import_poses poses = {
        .table = poses_csv, .calibration = file, .cfa = "mono", .grid = grid, .threshold_dn = 40};
    g_assert_true(ok(import_poses(path, &poses, &quietly, &result, ERR)));
    return file;
}

/* Products of an imported session are said to be of the calibration that the import was given. */
TEST(calibrated) {
    g_autofree char *path = session_fixture_path("calibrated");
    g_autoptr(Calibration) known = ok(calibration_read(calibration, ERR));
    for (int i = 0; i < CALIBRATION_PARTS; i++)
        calibration_set_part(known, (enum calibration_kind)i, "by hand", 1, "-", NULL);
    g_autofree char *file = import_grey(path, known, "file,camera,lamp\na.exr,cam30,lamp30\n");
    g_autofree char *made = process_mesorig(0, "process %s", path);
    g_autofree char *said =
        g_strdup_printf("calibration: %s (cameras, lights, laser, radiometry)", file);
    assert_has(made, said);
}

/* Views of a turntable that wobbles are processed with cameras, lamps and arc where the sample sees
 * them at their angle. */
TEST(wobbling) {
    g_autofree char *path = session_fixture_path("wobbling");
    g_autoptr(Calibration) known = ok(calibration_read(calibration, ERR));
    known->rig.wobble.rad[1][0] = known->rig.wobble.rad[1][3] = 0.002;
    g_free(import_grey(path, known,
                       "file,camera,lamp,turntable_deg,arc_deg\na.exr,cam30,lamp30,0,0\na.exr,"
                       "cam30,lamp30,40,40\n"));
    g_autoptr(Session) session = ok(session_open(path, SESSION_READ, ERR));
    struct catalogue *catalogue = ok(catalogue_load(session, NULL, ERR));
    g_autofree struct rig *at = g_new(struct rig, 1);
    for (int view = 0; view < 2; view++) {
        struct btf_view *btf = NULL;
        g_assert_cmpint(catalogue_btf(catalogue, view, &btf), ==, CATALOGUE_READY);
        const struct btf_light *light = &g_array_index(btf->lights, struct btf_light, 0);
        rig_at(&known->rig, btf->turntable_rad, at);
        const struct rig_camera *camera = &at->cameras[0];
        g_assert_cmpstr(btf->camera->name, ==, camera->name);
        for (int i = 0; i < 9; i++)
            g_assert_cmpfloat_with_epsilon(btf->camera->rotation.m[i / 3][i % 3],
                                           camera->rotation.m[i / 3][i % 3], 1e-12);
        g_assert_cmpfloat_with_epsilon(light->arc->tilt_rad[0], at->arc.tilt_rad[0], 1e-12);
        g_assert_cmpfloat_with_epsilon(light->arc->tilt_rad[1], at->arc.tilt_rad[1], 1e-12);
        btf_view_free(btf);
    }
    catalogue_free(catalogue);
}

/* When a pixel is lit, or no longer lit, in steps. */
static double arrival(int pixel) {
    return 4 + 15.0 * pixel / PIXELS;
}

/* Every other pixel sees a line a second time, fainter. */
static double second_arrival(int pixel) {
    const double first = arrival(pixel);
    return pixel % 2 ? first + (first < 11.5 ? 9 : -9) : -1;
}

#define STEPS 24

static void write_sweep(const char *dir, enum import_edge edge, GString *table, int without) {
    float values[PIXELS];
    g_string_append(table, HEAD);
    for (int k = 0; k < STEPS; k++) {
        g_autofree char *name = g_strdup_printf("s%02d.exr", k);
        for (int i = 0; i < PIXELS; i++) {
            const double at = k - arrival(i), part = 0.5 * erfc(at / G_SQRT2);
            const double again = i % 2 ? k - second_arrival(i) : INFINITY;
            const double pulses = 0.5 * exp(-at * at / 2) + 0.2 * exp(-again * again / 2);
            values[i] = (float)(edge == IMPORT_LINE      ? pulses + 0.02
                                : edge == IMPORT_DARKENS ? 0.02 + 0.5 * part
                                                         : 0.52 - 0.5 * part);
        }
        write_grey(dir, name, values);
        if (k != without)
            g_string_append_printf(table, "%s,cam30,,laser30,0,0,%.17g\n", name, -3 + 0.25 * k);
    }
}

static struct exr_part *sweep_file(const char *path) {
    g_autofree char *laser = g_build_filename(path, "laser", NULL), *file = NULL;
    g_autoptr(GDir) dir = g_dir_open(laser, 0, NULL);
    const char *name = g_dir_read_name(dir);
    g_assert_nonnull(name);
    file = g_build_filename(laser, name, NULL);
    struct exr_part *part = exr_read_part(file, "sweep", NULL);
    g_assert_nonnull(part);
    return part;
}

/* Whether a time is what was made, or forgotten next to a picture that is missing; −1: none was. */
static void check_second(const struct exr_part *part, enum import_edge edge, int without) {
    const float *peak = exr_part_plane(part, "second_peak");
    const float *intensity = exr_part_plane(part, "second_intensity");
    for (int i = 0; edge == IMPORT_LINE && i < PIXELS; i++) {
        const double wanted = second_arrival(i);
        if (wanted < 0 || (without >= 0 && fabs(wanted - without) < 1.8))
            g_assert_cmpfloat((double)peak[i], ==, -1);
        else if (without < 0 || (fabs(wanted - without) > 6 && fabs(arrival(i) - without) > 6)) {
            g_assert_cmpfloat_with_epsilon((double)peak[i], wanted, 0.08);
            g_assert_cmpfloat_with_epsilon((double)intensity[i], 0.2 * WHITE, 0.03 * WHITE);
        }
    }
}

/* Of each pixel the sheet's angle is what the pulse, or the edge, was made of. */
static void test_sweep(gconstpointer data) {
    const enum import_edge edge = (enum import_edge)GPOINTER_TO_INT(data);
    for (int without = -1; without < 12; without += 12) {
        g_autoptr(GString) table = g_string_new(NULL);
        g_autofree char *dir = session_fixture_new_folder(), *path = session_fixture_path("sweep");
        struct import_poses_result result;
        write_sweep(dir, edge, table, without);
        g_assert_true(ok(import_rows(dir, path, table->str, edge, &result, ERR)));
        g_assert_cmpint(result.n_missing, ==, without >= 0);
        g_autoptr(ExrPart) part = sweep_file(path);
        double from, to;
        int steps, seen = 0;
        g_assert_true(exr_get_double(part, "sweep.from_deg", &from, NULL) &&
                      exr_get_double(part, "sweep.to_deg", &to, NULL) &&
                      exr_get_int(part, "sweep.steps", &steps, NULL));
        const float *peak = exr_part_plane(part, "peak");
        for (int i = 0; i < PIXELS; i++) {
            const double wanted = -3 + 0.25 * arrival(i);
            const double got = from + (to - from) * (double)peak[i] / (steps - 1);
            if (without >= 0 && fabs(arrival(i) - without) < 1.8)
                g_assert_cmpfloat((double)peak[i], ==, -1);
            if (peak[i] < 0)
                continue;
            g_assert_cmpfloat_with_epsilon(got, wanted, 0.25 * 0.08);
            seen++;
        }
        g_assert_cmpint(seen, >, without >= 0 ? PIXELS * 2 / 5 : PIXELS * 95 / 100);
        check_second(part, edge, without);
    }
}

static double mean_of(const char *path, const char *channel) {
    g_autofree char *file = g_build_filename(path, "products/btf/view_0000.exr", NULL);
    g_autoptr(ExrFile) exr = exr_read(file, NULL);
    g_assert_nonnull(exr);
    const float *plane = exr_part_plane(exr->parts->pdata[0], channel);
    double sum = 0;
    for (int i = 0; i < 64; i++)
        sum += (double)plane[i] * (1 + i % 8) / 64; /* not even: a shift would show */
    return sum;
}

/* A colour picture against the grey ones of its channels. */
TEST(colour) {
    g_autoptr(GError) error = NULL;
    g_autofree char *dir = session_fixture_new_folder(),
                    *colour = g_build_filename(dir, "rgb.exr", NULL);
    g_autofree char *path = session_fixture_path("colour");
    struct import_poses_result result;
    float planes[3][PIXELS];
    const float *all[3] = {planes[0], planes[1], planes[2]};
    static const char *const channels[] = {"R", "G", "B"};
    for (int i = 0; i < PIXELS; i++)
        for (int c = 0; c < 3; c++)
            planes[c][i] = (float)((0.2 + 0.02 * (i % SIDE)) * (1 - 0.3 * c));
    write_picture(colour, all, 3, SIDE);
    g_assert_true(
        import_rows(dir, path, HEAD "rgb.exr,cam30,lamp30,,0,45,\n", IMPORT_LINE, &result, &error));
    g_assert_no_error(error);
    g_free(process_mesorig(0, "process %s --json", path));
    for (int c = 0; c < 3; c++) {
        g_autofree char *grey = session_fixture_path("grey");
        write_grey(dir, "grey.exr", planes[c]);
        g_assert_true(import_rows(dir, grey, HEAD "grey.exr,cam30,lamp30,,0,45,\n", IMPORT_LINE,
                                  &result, &error));
        g_free(process_mesorig(0, "process %s --json", grey));
        const double wanted = mean_of(grey, "G");
        g_assert_cmpfloat(wanted, >, 0.001);
        g_assert_cmpfloat_with_epsilon(mean_of(path, channels[c]) / wanted, 1, 0.01);
    }
    write_grey(dir, "grey.exr", planes[0]);
    assert_refused(dir, HEAD "rgb.exr,cam30,lamp30,,0,45,\ngrey.exr,cam30,lamp30,,0,90,\n",
                   "poses.csv:3: grey.exr is grey, but rgb.exr (line 2) of the same view is not");
}

/* Grey pictures of a sweep next to pictures in colour for the BTF, by one camera: the sweep is what
 * it is alone, and the grey rig's calibration serves for both. */
TEST(colour_beside_grey) {
    g_autoptr(GError) error = NULL;
    g_autoptr(GString) table = g_string_new(NULL);
    g_autofree char *dir = session_fixture_new_folder(),
                    *colour = g_build_filename(dir, "rgb.exr", NULL);
    g_autofree char *alone = session_fixture_path("alone"), *both = session_fixture_path("both");
    struct import_poses_result result;
    float planes[3][PIXELS];
    const float *all[3] = {planes[0], planes[1], planes[2]};
    for (int i = 0; i < PIXELS; i++)
        for (int c = 0; c < 3; c++)
            planes[c][i] = (float)(0.2 + 0.1 * c);
    write_picture(colour, all, 3, SIDE);
    write_sweep(dir, IMPORT_LINE, table, -1);
    g_assert_true(import_rows(dir, alone, table->str, IMPORT_LINE, &result, &error));
    g_string_append(table, "rgb.exr,cam30,lamp30,,0,45,\n");
    g_assert_true(ok(import_rows(dir, both, table->str, IMPORT_LINE, &result, ERR)));
    g_assert_cmpint(result.n_views, ==, 1);
    g_autoptr(ExrPart) a = sweep_file(alone), b = sweep_file(both);
    g_assert_cmpmem(exr_part_plane(a, "peak"), sizeof(float) * PIXELS, exr_part_plane(b, "peak"),
                    sizeof(float) * PIXELS);
    g_free(process_mesorig(0, "process %s -c %s --json", both, calibration));
    g_autofree char *mdf = g_build_filename(both, "products/mdf.exr", NULL);
    g_assert_true(g_file_test(mdf, G_FILE_TEST_EXISTS));
    const double wanted = mean_of(both, "G") / 0.3; /* n·l is the same for all three */
    g_assert_cmpfloat(wanted, >, 0);
    g_assert_cmpfloat_with_epsilon(mean_of(both, "R"), 0.2 * wanted, 0.002 * wanted);
    g_assert_cmpfloat_with_epsilon(mean_of(both, "B"), 0.4 * wanted, 0.002 * wanted);
}

TEST(mutated) {
    static const char *const good =
        HEAD "a.exr,cam30,lamp30,,0,45,\n\"a.exr\";cam30;lamp60;;0;-45.5;\n";
    g_autofree char *dir = session_fixture_new_folder();
    GRand *rand = g_rand_new_with_seed(9);
    float values[PIXELS] = {0};
    write_grey(dir, "a.exr", values);
    for (int i = 0; i < 300; i++) {
        g_autoptr(GError) error = NULL;
        g_autofree char *text = g_strdup(good), *path = session_fixture_path("mutated");
        struct import_poses_result result;
        for (int k = g_rand_int_range(rand, 1, 5); k > 0; k--)
            text[g_rand_int_range(rand, 0, (int)strlen(good))] =
                (char)g_rand_int_range(rand, i % 2, 256);
        const gboolean ok = import_rows(dir, path, text, IMPORT_LINE, &result, &error);
        g_assert_true(ok == (error == NULL));
    }
    g_rand_free(rand);
}

static void write_calibration(void) {
    struct rig *rig = g_new0(struct rig, 1);
    g_assert_true(devices_read_geometry(RIG, rig, NULL));
    g_autofree char *text = rig_to_text(rig);
    calibration = g_build_filename(session_fixture_folder, "calibration.conf", NULL);
    g_assert_true(g_file_set_contents(calibration, text, -1, NULL));
    g_free(rig);
}

/* data: the table's path is given relative to the working directory. */
static void test_command(gconstpointer data) {
    const gboolean relative = data != NULL;
    g_autofree char *dir = session_fixture_new_folder();
    g_autofree char *path = session_fixture_path(relative ? "relative" : "command");
    g_autofree char *before = g_get_current_dir();
    g_autofree char *table = g_build_filename(dir, "poses.csv", NULL);
    float values[PIXELS] = {0};
    write_grey(dir, "a.exr", values);
    g_assert_true(g_file_set_contents(table, "file,camera,lamp\na.exr,cam30,lamp30\n", -1, NULL));
    g_assert_cmpint(g_chdir(dir), ==, 0);
    g_free(process_mesorig(
        0, "import poses %s -c %s --sample 50x40 --texels 10 --reference 5 --depth 5 -o %s --json",
        relative ? "poses.csv" : table, calibration, path));
    g_assert_cmpint(g_chdir(before), ==, 0);
    g_autoptr(Session) session = session_open(path, SESSION_READ, NULL);
    struct session_grid got;
    g_assert_true(session_grid(session, &got, NULL));
    g_assert_cmpint(got.height, ==, 8);
    g_assert_cmpfloat(got.height_mm, ==, 40);
    g_autofree char *usage = process_mesorig(
        2, "import poses %s -c %s --sample 50x40 --same-light 46 -o %s", table, calibration, path);
    assert_has(usage, "--same-light=46 is out of range: 0 to 45 degrees");
}

/* The folder is made here, since the calibration lies in it for all tests. */
BEFORE_TESTS {
    session_fixture_folder = g_dir_make_tmp("mesorig-poses-XXXXXX", NULL);
    write_calibration();
    for (gsize i = 0; i < G_N_ELEMENTS(noticings); i++)
        g_test_add_data_func(noticings[i].path, &noticings[i], test_noticed);
    g_test_add_data_func("/poses/sweep/line", GINT_TO_POINTER(IMPORT_LINE), test_sweep);
    g_test_add_data_func("/poses/sweep/darkens", GINT_TO_POINTER(IMPORT_DARKENS), test_sweep);
    g_test_add_data_func("/poses/sweep/lightens", GINT_TO_POINTER(IMPORT_LIGHTENS), test_sweep);
    g_test_add_data_func("/poses/command", NULL, test_command);
    g_test_add_data_func("/poses/command/relative", GINT_TO_POINTER(TRUE), test_command);
}

AFTER_TESTS {
    remove_tree(session_fixture_folder);
    g_free(calibration);
    g_free(session_fixture_folder);
}
