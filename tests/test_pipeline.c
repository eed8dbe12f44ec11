/*
 * A small session whose frames are made by formulas: a white-ish diffuser in the reference plane
 * for the lamps, a plane below it for the lasers.
 */
#include "processing/pipeline.h"

#include "analytic.h"
#include "calib/calibration.h"
#include "processing/btf.h"
#include "processing/btf_matrix.h"
#include "processing/eigenmaps.h"
#include "processing/exr.h"
#include "processing/laser_lines.h"

#include <glib/gstdio.h>
#include <math.h>
#include <string.h>

#define DEGREE (G_PI / 180)

enum { N_CAMERAS = 2, N_TURNS = 2, N_LIGHTS = 3, N_LASERS = 5, N_VIEWS = N_CAMERAS * N_TURNS };
enum { SIDE = 96, TEXELS = 16, N_STEPS = 80 };

static const struct session_grid grid = {TEXELS, TEXELS, 24, 24, 5, 5};
static const struct pinhole pinholes[N_CAMERAS] = {{SIDE, SIDE, 20 * DEGREE, 650, 1400},
                                                   {SIDE, SIDE, 50 * DEGREE, 650, 1400}};
static const struct line_laser laser = {45 * DEGREE, 480};
static const struct arc_lamp lamp = {35 * DEGREE, 500, 40};
static const double albedo[3] = {0.7, 0.5, 0.2};
static const double from_deg = -4, to_deg = 4, level_mm = 2.2;

struct fixture {
    char *folder, *path;
    struct session_shot shots[N_TURNS * (N_LIGHTS + N_LASERS)];
    int n_shots;
};

static struct rig make_rig(void) {
    struct rig rig = {.id = "test", .arc_radius_mm = 500, .arc_width_mm = 30};
    for (int i = 0; i < N_CAMERAS; i++)
        rig.cameras[rig.n_cameras++] = pinhole_to_rig(&pinholes[i], i ? "cam50" : "cam20");
    rig.lamps[rig.n_lamps++] = lamp_to_rig(&lamp, "lamp35");
    rig.lasers[rig.n_lasers++] = laser_to_rig(&laser, "laser45");
    return rig;
}

static double turn_deg(int turn) {
    return 50.0 * turn;
}

static void plan_shots(struct fixture *fixture) {
    for (int turn = 0; turn < N_TURNS; turn++)
        for (int i = 0; i < N_LIGHTS + N_LASERS; i++) {
            gboolean sweep = i >= N_LIGHTS;
            int source = sweep ? i - N_LIGHTS : i;
            fixture->shots[fixture->n_shots] =
                (struct session_shot){.id = fixture->n_shots + 1,
                                      .kind = sweep ? SHOT_SWEEP : SHOT_LAMP,
                                      .pose = turn,
                                      .turntable_deg = turn_deg(turn),
                                      .arc_deg = turn_deg(turn) + 40 + 70 * source,
                                      .source = source,
                                      .device = 0,
                                      .cameras = (1 << N_CAMERAS) - 1,
                                      .sweep_from_deg = sweep ? from_deg : 0,
                                      .sweep_to_deg = sweep ? to_deg : 0,
                                      .sweep_steps = sweep ? N_STEPS : 0};
            fixture->n_shots++;
        }
}

static void create_session(struct fixture *fixture) {
    struct session_direction views[N_VIEWS], lights[N_LIGHTS], lasers[N_LASERS];
    for (int i = 0; i < N_VIEWS; i++)
        views[i] = (struct session_direction){.index = i,
                                              .device = i % N_CAMERAS,
                                              .theta_deg = i % N_CAMERAS ? 50 : 20,
                                              .phi_deg = 360 - turn_deg(i / N_CAMERAS),
                                              .turntable_deg = turn_deg(i / N_CAMERAS)};
    for (int i = 0; i < N_LIGHTS; i++)
        lights[i] = (struct session_direction){.index = i, .theta_deg = 35, .phi_deg = 40 + 70 * i};
    for (int i = 0; i < N_LASERS; i++)
        lasers[i] = (struct session_direction){.index = i, .theta_deg = 45, .phi_deg = 40 + 70 * i};
    struct rig rig = make_rig();
    g_autofree char *calibration = rig_to_text(&rig);
    struct session_texts texts = {
        .rig_conf = "[rig]\n", .session_conf = "[session]\n", .calibration = calibration};
    struct session_plan plan = {grid,     views,    lights,         lasers,          N_VIEWS,
                                N_LIGHTS, N_LASERS, fixture->shots, fixture->n_shots};
    g_autoptr(GError) error = NULL;
    g_autoptr(Session) session = session_create(fixture->path, "small", &texts, &plan, &error);
    g_assert_no_error(error);
}

static void set_up(struct fixture *fixture, gconstpointer unused) {
    fixture->folder = g_dir_make_tmp("pipeline-XXXXXX", NULL);
    fixture->path = g_build_filename(fixture->folder, "small.session", NULL);
    plan_shots(fixture);
    create_session(fixture);
}

static void remove_all(const char *path) {
    GDir *folder = g_dir_open(path, 0, NULL);
    for (const char *name; folder && (name = g_dir_read_name(folder));) {
        g_autofree char *child = g_build_filename(path, name, NULL);
        if (g_file_test(child, G_FILE_TEST_IS_DIR))
            remove_all(child);
        else
            g_unlink(child);
    }
    g_clear_pointer(&folder, g_dir_close);
    g_rmdir(path);
}

static void tear_down(struct fixture *fixture, gconstpointer unused) {
    remove_all(fixture->folder);
    g_free(fixture->folder);
    g_free(fixture->path);
}

/* Where a pixel's ray meets a level, in the rig frame. */
static void hit(const struct pinhole *pinhole, int pixel, double height, double *ret) {
    double eye[3], ray[3];
    pinhole_eye(pinhole, eye);
    pinhole_ray(pinhole, pixel % SIDE, (double)(pixel / SIDE), ray);
    double t = (height - eye[2]) / ray[2];
    for (int i = 0; i < 3; i++)
        ret[i] = eye[i] + t * ray[i];
}

static struct exr_part *lamp_frame(const struct session_shot *shot, int camera) {
    static const char *const channels[] = {"Y", NULL};
    struct exr_part *part = exr_part_new("radiance", SIDE, SIDE, channels, EXR_HALF);
    exr_set_string(part, "mesorig.cfa", "grbg");
    exr_set_int(part, "mesorig.shot", (int)shot->id);
    for (int i = 0; i < SIDE * SIDE; i++) {
        double p[3], at[3], start[3] = {500 * sin(lamp.theta), 0, 500 * cos(lamp.theta)};
        int even_y = (i / SIDE) % 2 == 0, even_x = i % SIDE % 2 == 0;
        int colour = even_y ? (even_x ? 1 : 0) : (even_x ? 2 : 1);
        hit(&pinholes[camera], i, 5, p);
        turn3(start, shot->arc_deg * DEGREE, at);
        double way[3] = {at[0] - p[0], at[1] - p[1], at[2] - p[2]}, r2 = dot3(way, way);
        double irradiance = lamp.intensity / (r2 * 1e-6) * way[2] / sqrt(r2);
        part->planes[0][i] = (float)(irradiance * albedo[colour] / G_PI * 6);
    }
    return part;
}

static struct exr_part *sweep_frame(const struct session_shot *shot, int camera) {
    static const char *const channels[] = {"intensity", "peak", "width", NULL};
    struct exr_part *part = exr_part_new("sweep", SIDE, SIDE, channels, EXR_FLOAT);
    exr_set_double(part, "sweep.from_deg", from_deg);
    exr_set_double(part, "sweep.to_deg", to_deg);
    exr_set_int(part, "sweep.steps", N_STEPS);
    for (int i = 0; i < SIDE * SIDE; i++) {
        double p[3];
        hit(&pinholes[camera], i, level_mm, p);
        double sweep_deg = laser_sweep(&laser, shot->arc_deg * DEGREE, p) / DEGREE;
        part->planes[0][i] = 1000;
        part->planes[1][i] = (float)((sweep_deg - from_deg) / (to_deg - from_deg) * (N_STEPS - 1));
        part->planes[2][i] = 1.5f;
    }
    return part;
}

static struct session_frame write_frame(const struct fixture *fixture, struct exr_part *part,
                                        const struct session_shot *shot, int camera) {
    g_autoptr(GError) error = NULL;
    struct session_frame frame = {.shot = shot->id, .camera = camera};
    frame.path = session_frame_path(shot, camera ? "cam50" : "cam20");
    g_autofree char *path = g_build_filename(fixture->path, frame.path, NULL), *bytes = NULL;
    g_autofree char *folder = g_path_get_dirname(path);
    g_mkdir_with_parents(folder, 0777);
    struct exr_file *file = exr_file_new();
    exr_file_add(file, part);
    g_assert_true(exr_write(path, file, EXR_PIZ, FALSE, &error));
    exr_file_free(file);
    gsize length;
    g_assert_true(g_file_get_contents(path, &bytes, &length, NULL));
    frame.sha256 = g_compute_checksum_for_data(G_CHECKSUM_SHA256, (guchar *)bytes, length);
    frame.bytes = (gint64)length;
    return frame;
}

typedef void (*Spoil)(struct exr_part *part, const struct session_shot *shot);

static void capture_shot(struct fixture *fixture, Session *session, struct session_shot *shot,
                         Spoil spoil) {
    g_autoptr(GError) error = NULL;
    struct session_frame frames[N_CAMERAS];
    for (int camera = 0; camera < N_CAMERAS; camera++) {
        struct exr_part *part =
            shot->kind == SHOT_LAMP ? lamp_frame(shot, camera) : sweep_frame(shot, camera);
        if (spoil)
            spoil(part, shot);
        frames[camera] = write_frame(fixture, part, shot, camera);
    }
    session_commit_shot(session, shot->id, SHOT_DONE, frames, N_CAMERAS, NULL, &error);
    g_assert_no_error(error);
    for (int camera = 0; camera < N_CAMERAS; camera++) {
        g_free(frames[camera].path);
        g_free(frames[camera].sha256);
    }
}

/* Shots first … last − 1 in planned order. */
static void capture(struct fixture *fixture, int first, int last, Spoil spoil) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Session) session = session_open(fixture->path, SESSION_CAPTURE, &error);
    g_assert_no_error(error);
    for (int i = first; i < last; i++)
        capture_shot(fixture, session, &fixture->shots[i], spoil);
}

/* The first laser position's sheet was 0.2° further on than it was told. */
static void slip(struct exr_part *part, const struct session_shot *shot) {
    if (shot->kind != SHOT_SWEEP || shot->source != 0)
        return;
    for (int i = 0; i < SIDE * SIDE; i++)
        part->planes[1][i] -= (float)(0.2 / (to_deg - from_deg) * (N_STEPS - 1));
}

static void set_value(const struct fixture *fixture, const char *key, const char *value) {
    g_autoptr(Session) session = session_open(fixture->path, SESSION_CAPTURE, NULL);
    g_assert_true(session_set_value(session, key, value, NULL));
}

static void set_state(const struct fixture *fixture, const char *state) {
    set_value(fixture, "state", state);
}

static struct pipeline_result process(const struct fixture *fixture, int n_threads,
                                      gboolean follow) {
    g_autoptr(GError) error = NULL;
    struct pipeline_options options = {.n_eigenmaps = 2, .n_threads = n_threads, .follow = follow};
    struct pipeline_result result;
    pipeline_run(fixture->path, &options, &result, &error);
    g_assert_no_error(error);
    return result;
}

static void process_fails(const struct fixture *fixture, int code, const char *says) {
    g_autoptr(GError) error = NULL;
    struct pipeline_options options = {.n_eigenmaps = 2};
    struct pipeline_result result;
    g_assert_false(pipeline_run(fixture->path, &options, &result, &error));
    g_assert_error(error, PIPELINE_ERROR, code);
    if (!strstr(error->message, says))
        g_error("\"%s\" does not say %s", error->message, says);
}

static char *product(const struct fixture *fixture, const char *name) {
    return g_build_filename(fixture->path, "products", name, NULL);
}

/* The cosine at which the lamp stands over a texel: near-field, so not everywhere that of 35°. */
static double lamp_cosine(const struct session_shot *shot, int turn, int texel) {
    double side = 24.0 / TEXELS, at[3],
           start[3] = {500 * sin(lamp.theta), 0, 500 * cos(lamp.theta)};
    double p[3] = {-12 + (texel % TEXELS + 0.5) * side,
                   12 - ((double)(texel / TEXELS) + 0.5) * side, 5};
    turn3(p, turn_deg(turn) * DEGREE, p);
    turn3(start, shot->arc_deg * DEGREE, at);
    double way[3] = {at[0] - p[0], at[1] - p[1], at[2] - p[2]};
    return way[2] / sqrt(dot3(way, way));
}

static void check_place(const struct exr_part *part, const char *name, double mm, double theta_deg,
                        double phi_deg) {
    double p[3], theta = theta_deg * DEGREE, phi = phi_deg * DEGREE;
    g_assert_true(exr_get_v3d(part, name, p, NULL));
    g_assert_cmpfloat_with_epsilon(p[0], mm * sin(theta) * cos(phi), 1e-6);
    g_assert_cmpfloat_with_epsilon(p[1], mm * sin(theta) * sin(phi), 1e-6);
    g_assert_cmpfloat_with_epsilon(p[2], mm * cos(theta), 1e-6);
}

static void check_btf(const struct fixture *fixture) {
    static const char *const channels[] = {"R", "G", "B"};
    for (int view = 0; view < N_VIEWS; view++)
        for (int light = 0; light < N_LIGHTS; light++) {
            g_autoptr(GError) error = NULL;
            g_autofree char *file = g_strdup_printf("btf/view_%04d.exr", view);
            g_autofree char *path = product(fixture, file);
            g_autofree char *name = g_strdup_printf("light_%04d", light);
            struct exr_part *part = exr_read_part(path, name, &error);
            g_assert_no_error(error);
            int turn = view / N_CAMERAS;
            const struct session_shot *shot = &fixture->shots[turn * (N_LIGHTS + N_LASERS) + light];
            for (int i = 0; i < TEXELS * TEXELS * 3; i++) {
                double cosine = lamp_cosine(shot, turn, i / 3);
                g_assert_cmpfloat_with_epsilon(exr_part_plane(part, channels[i % 3])[i / 3],
                                               albedo[i % 3] * cosine, 2e-3 * albedo[i % 3]);
            }
            double theta_deg, phi_deg;
            int holes;
            g_assert_true(exr_get_double(part, "view.theta_deg", &theta_deg, NULL));
            g_assert_true(exr_get_double(part, "light.phi_deg", &phi_deg, NULL));
            g_assert_true(exr_get_int(part, "mesorig.holes", &holes, NULL));
            g_assert_cmpfloat(theta_deg, ==, view % N_CAMERAS ? 50 : 20);
            g_assert_cmpfloat(phi_deg, ==, 40 + 70 * light);
            g_assert_cmpint(holes, ==, 0);
            check_place(part, "view.centre_mm", 650, theta_deg, -turn_deg(turn));
            check_place(part, "light.position_mm", lamp.distance_mm, 35, phi_deg);
            exr_part_free(part);
        }
}

static void check_mdf_where_known(const struct fixture *fixture, gboolean everywhere) {
    g_autofree char *path = product(fixture, "mdf.exr");
    struct exr_file *file = exr_read(path, NULL);
    g_assert_cmpuint(file->parts->len, ==, N_VIEWS);
    for (int view = 0; view < N_VIEWS; view++) {
        g_autofree char *name = g_strdup_printf("view_%04d", view);
        const struct exr_part *part = exr_file_part(file, name);
        for (int i = 0; i < TEXELS * TEXELS; i++) {
            double side = 24.0 / TEXELS, eye[3];
            double p[3] = {-12 + (i % TEXELS + 0.5) * side,
                           12 - ((double)(i / TEXELS) + 0.5) * side, 5};
            turn3(p, turn_deg(view / N_CAMERAS) * DEGREE, p);
            pinhole_eye(&pinholes[view % N_CAMERAS], eye);
            double way[3] = {p[0] - eye[0], p[1] - eye[1], p[2] - eye[2]};
            double expected = (5 - level_mm) * sqrt(dot3(way, way)) / -way[2];
            if (!everywhere && exr_part_plane(part, "P")[i] == 0)
                continue;
            g_assert_cmpfloat_with_epsilon(exr_part_plane(part, "D")[i], expected, 0.01);
            if (!everywhere)
                continue;
            g_assert_cmpfloat(exr_part_plane(part, "N")[i], >=, 2);
            g_assert_cmpfloat(exr_part_plane(part, "S")[i], <, 0.01);
        }
    }
    exr_file_free(file);
}

static void check_mdf(const struct fixture *fixture) {
    check_mdf_where_known(fixture, TRUE);
}

static void check_eigenmaps(const struct fixture *fixture, double error_said) {
    g_autoptr(GError) error = NULL;
    g_autofree char *path = product(fixture, "eigenmaps.exr");
    struct eigenmaps *maps = eigenmaps_read(path, &error);
    g_assert_no_error(error);
    g_assert_cmpint(maps->n_views, ==, N_VIEWS);
    g_assert_cmpint(maps->n_lights, ==, N_LIGHTS);
    g_assert_cmpint(maps->n_terms, ==, 2);
    g_assert_cmpstr(maps->name, ==, "small");
    /* Lamps turn with the sample here, and the diffuser looks alike from everywhere. */
    g_assert_cmpfloat(error_said, <, 0.01);
    for (int light = 0; light < N_LIGHTS; light++) {
        double sum = 0;
        int texel = TEXELS * TEXELS / 2 + TEXELS / 2;
        for (int term = 0; term < 2; term++)
            sum += maps->weights[term * N_VIEWS + 1] *
                   maps->maps[((term * N_LIGHTS + light) * TEXELS * TEXELS + texel) * 3];
        g_assert_cmpfloat_with_epsilon(
            sum, albedo[0] * lamp_cosine(&fixture->shots[light], 0, texel), 0.01);
    }
    eigenmaps_free(maps);
}

static char *hash_products(const struct fixture *fixture) {
    static const char *const names[] = {"btf/view_0000.exr", "btf/view_0003.exr", "mdf.exr",
                                        "eigenmaps.exr"};
    g_autoptr(GChecksum) sum = g_checksum_new(G_CHECKSUM_SHA256);
    for (guint i = 0; i < G_N_ELEMENTS(names); i++) {
        g_autofree char *path = product(fixture, names[i]), *bytes = NULL;
        gsize length;
        g_assert_true(g_file_get_contents(path, &bytes, &length, NULL));
        g_checksum_update(sum, (guchar *)bytes, (gssize)length);
    }
    return g_strdup(g_checksum_get_string(sum));
}

static void test_whole(struct fixture *fixture, gconstpointer unused) {
    capture(fixture, 0, fixture->n_shots, NULL);
    set_state(fixture, "done");
    struct pipeline_result result = process(fixture, 1, FALSE);
    g_assert_cmpint(result.n_views, ==, N_VIEWS);
    g_assert_cmpint(result.n_lights, ==, N_LIGHTS);
    g_assert_cmpint(result.n_mdf_views, ==, N_VIEWS);
    g_assert_cmpfloat(result.mdf_coverage, ==, 1);
    check_btf(fixture);
    check_mdf(fixture);
    check_eigenmaps(fixture, result.eigenmaps_error);
    g_autoptr(Session) session = session_open(fixture->path, SESSION_READ, NULL);
    g_autofree char *said = session_value(session, "eigenmaps_error");
    g_assert_cmpfloat(g_ascii_strtod(said, NULL), ==, result.eigenmaps_error);
    g_autofree char *coverage = session_value(session, "mdf_coverage");
    g_assert_cmpfloat(g_ascii_strtod(coverage, NULL), ==, 1);
}

/* It is told where a laser is said to be known. */
static void check_against_calibration(const struct fixture *fixture) {
    g_autoptr(GError) error = NULL;
    const struct rig rig = make_rig();
    g_autoptr(Calibration) calibration = calibration_new(&rig);
    calibration->lasers[0].known = TRUE;
    calibration->lasers[0].normal_rad = calibration->lasers[0].axis_rad = 1e-4;
    g_autofree char *text = calibration_to_text(calibration);
    const struct pipeline_options options = {.n_eigenmaps = 2, .calibration = text};
    struct pipeline_result result;
    pipeline_run(fixture->path, &options, &result, &error);
    g_assert_no_error(error);
    g_assert_cmpint(result.lines_disagree, ==, N_VIEWS);
    g_assert_cmpint(result.line_worst_position, ==, 0);
    check_mdf(fixture);
}

/* What lies around the sample is as high as its surface: the lines there tell of the slip, again
 * when nothing is made again, and the surface is where it is. Without it nobody can tell. */
static void test_slipped(struct fixture *fixture, gconstpointer unused) {
    capture(fixture, 0, fixture->n_shots, slip);
    struct pipeline_result result = process(fixture, 1, FALSE);
    g_assert_cmpint(result.line_sweeps, ==, N_VIEWS * N_LASERS);
    g_assert_cmpint(result.lines_found, ==, 0);
    g_assert_cmpint(result.line_worst_position, ==, -1);
    set_value(fixture, LASER_REFERENCE_KEY, "2.2;0.01;28;28;30");
    for (int i = 0; i < 2; i++) {
        result = process(fixture, 1, FALSE);
        g_assert_cmpint(result.lines_found, ==, N_VIEWS * N_LASERS);
        g_assert_cmpint(result.line_worst_position, ==, 0);
        g_assert_cmpfloat_with_epsilon(result.lines_worst_deg, 0.2, 0.002);
        g_assert_cmpfloat_with_epsilon(result.lines_rms_deg, 0.2 / sqrt(N_LASERS), 0.002);
    }
    g_assert_cmpint(result.lines_disagree, ==, 0); /* with a calibration that knows nothing */
    check_mdf(fixture);
    check_against_calibration(fixture);
    set_value(fixture, LASER_REFERENCE_KEY, "2.2;0.01;28;28");
    process_fails(fixture, PIPELINE_ERROR_DATA, "2.2;0.01;28;28");
}

/* No camera saw a line in the middle of its pictures, with the turntable as it was first. */
static void blind(struct exr_part *part, const struct session_shot *shot) {
    if (shot->kind != SHOT_SWEEP || shot->pose != 0)
        return;
    for (int i = 0; i < SIDE * SIDE; i++)
        if (abs(i % SIDE - SIDE / 2) < 12 && abs(i / SIDE - SIDE / 2) < 12)
            part->planes[1][i] = -1;
}

/* Others fill in what they see, it is said where, and it does not count as measured. */
static void test_predicted(struct fixture *fixture, gconstpointer unused) {
    capture(fixture, 0, fixture->n_shots, blind);
    const struct pipeline_result result = process(fixture, 1, FALSE),
                                 again = process(fixture, 1, FALSE);
    g_autofree char *path = product(fixture, "mdf.exr");
    g_autoptr(GError) error = NULL;
    struct exr_file *file = exr_read(path, &error);
    g_assert_no_error(error);
    int predicted = 0, measured = 0;
    for (guint v = 0; v < file->parts->len; v++) {
        const struct exr_part *part = file->parts->pdata[v];
        const float *d = exr_part_plane(part, "D"), *m = exr_part_plane(part, "M"),
                    *p = exr_part_plane(part, "P"), *n = exr_part_plane(part, "N");
        for (int i = 0; i < TEXELS * TEXELS; i++) {
            predicted += p[i] == 3;
            measured += p[i] == 1;
            g_assert_true(p[i] != 3 || (m[i] == -1 && n[i] == 0 && d[i] >= 0));
            g_assert_true(p[i] != 1 || d[i] == m[i]);
            g_assert_true(p[i] != 0 || d[i] == -1);
        }
    }
    exr_file_free(file);
    g_assert_cmpint(predicted, >=, 4);
    g_assert_cmpfloat(result.mdf_coverage, ==, measured / (double)(N_VIEWS * TEXELS * TEXELS));
    g_assert_cmpfloat(result.mdf_predicted, ==, predicted / (double)(N_VIEWS * TEXELS * TEXELS));
    g_assert_cmpfloat(again.mdf_predicted, ==, result.mdf_predicted);
    check_mdf_where_known(fixture, FALSE);
}

static void test_threads(struct fixture *fixture, gconstpointer unused) {
    capture(fixture, 0, fixture->n_shots, NULL);
    process(fixture, 1, FALSE);
    g_autofree char *one = hash_products(fixture), *products = product(fixture, NULL);
    remove_all(products);
    process(fixture, 4, FALSE);
    g_autofree char *four = hash_products(fixture);
    g_assert_cmpstr(one, ==, four);
}

static gint64 inode_of(const struct fixture *fixture, const char *name) {
    g_autofree char *path = product(fixture, name);
    GStatBuf status;
    g_assert_cmpint(g_stat(path, &status), ==, 0);
    return (gint64)status.st_ino;
}

/* What is up to date stays; what is not there, damaged, or of other frames is made again. */
static void test_again(struct fixture *fixture, gconstpointer unused) {
    static const char *const names[] = {"btf/view_0000.exr", "btf/view_0001.exr",
                                        "btf/view_0002.exr", "mdf.exr", "eigenmaps.exr"};
    gint64 before[G_N_ELEMENTS(names)];
    capture(fixture, 0, fixture->n_shots, NULL);
    struct pipeline_result first = process(fixture, 2, FALSE);
    for (guint i = 0; i < G_N_ELEMENTS(names); i++)
        before[i] = inode_of(fixture, names[i]);
    struct pipeline_result second = process(fixture, 2, FALSE);
    g_assert_cmpmem(&first, sizeof first, &second, sizeof second);
    for (guint i = 0; i < G_N_ELEMENTS(names); i++)
        g_assert_cmpint(inode_of(fixture, names[i]), ==, before[i]);

    g_autofree char *hash = hash_products(fixture), *gone = product(fixture, names[1]);
    g_autofree char *cut = product(fixture, names[0]), *mdf = product(fixture, names[3]);
    g_unlink(gone);
    g_assert_true(g_file_set_contents(cut, "v/1\1", 4, NULL));
    g_assert_true(g_file_set_contents(mdf, "", 0, NULL));
    process(fixture, 2, FALSE);
    g_autofree char *again = hash_products(fixture);
    g_assert_cmpstr(hash, ==, again);
    g_assert_cmpint(inode_of(fixture, names[2]), ==, before[2]);

    capture(fixture, 0, 1, NULL); /* the same picture once more */
    process(fixture, 2, FALSE);
    g_assert_cmpint(inode_of(fixture, names[2]), ==, before[2]);
}

static void brighter(struct exr_part *part, const struct session_shot *shot) {
    for (int i = 0; i < SIDE * SIDE; i++)
        part->planes[0][i] *= 1.1f;
}

static void test_retaken(struct fixture *fixture, gconstpointer unused) {
    capture(fixture, 0, fixture->n_shots, brighter);
    process(fixture, 2, FALSE);
    gint64 other = inode_of(fixture, "btf/view_0002.exr");
    capture(fixture, 0, N_LIGHTS, NULL); /* the lights of turn 0 */
    process(fixture, 2, FALSE);
    g_assert_cmpint(inode_of(fixture, "btf/view_0002.exr"), ==, other);
    capture(fixture, N_LIGHTS + N_LASERS, fixture->n_shots, NULL);
    process(fixture, 2, FALSE);
    check_btf(fixture);
}

static void test_missing(struct fixture *fixture, gconstpointer unused) {
    process_fails(fixture, PIPELINE_ERROR_INCOMPLETE, "4 of 4 views");
    capture(fixture, 0, N_LIGHTS + N_LASERS, NULL);
    process_fails(fixture, PIPELINE_ERROR_INCOMPLETE, "2 of 4 views");
    set_state(fixture, "aborted");
    struct pipeline_result result = process(fixture, 2, TRUE);
    g_assert_cmpint(result.n_views, ==, 2);
    g_assert_cmpint(result.n_mdf_views, ==, 2);
    /* The rest comes later; what there was stays. */
    gint64 before = inode_of(fixture, "btf/view_0001.exr");
    capture(fixture, N_LIGHTS + N_LASERS, fixture->n_shots, NULL);
    result = process(fixture, 2, TRUE);
    g_assert_cmpint(result.n_views, ==, 4);
    g_assert_cmpint(inode_of(fixture, "btf/view_0001.exr"), ==, before);
    check_btf(fixture);
    check_mdf(fixture);
}

static void test_skipped(struct fixture *fixture, gconstpointer unused) {
    capture(fixture, 1, fixture->n_shots - 1, NULL);
    g_autoptr(Session) session = session_open(fixture->path, SESSION_CAPTURE, NULL);
    for (int i = 0; i < 2; i++)
        g_assert_true(session_commit_shot(session, i ? fixture->n_shots : 1, SHOT_SKIPPED, NULL, 0,
                                          "the arc stands in the way", NULL));
    g_clear_pointer(&session, session_close);
    struct pipeline_result result = process(fixture, 2, FALSE);
    g_assert_cmpint(result.n_views, ==, 2); /* a light is missing in two */
    g_assert_cmpint(result.n_mdf_views, ==, 4);
    check_mdf(fixture);
}

struct follower {
    struct fixture *fixture;
    int reports;
};

static gpointer capture_slowly(gpointer data) {
    struct fixture *fixture = data;
    for (int i = 0; i < fixture->n_shots; i += 4) {
        g_usleep(100000);
        capture(fixture, i, MIN(i + 4, fixture->n_shots), NULL);
    }
    return NULL;
}

static void count_reports(const struct pipeline_progress *progress, gpointer data) {
    struct follower *follower = data;
    g_assert_cmpint(progress->done, <=, progress->total);
    g_assert_true(progress->left_s >= 0 || progress->left_s == -1);
    follower->reports++;
}

static void test_follow(struct fixture *fixture, gconstpointer unused) {
    g_autoptr(GError) error = NULL;
    struct follower follower = {fixture, 0};
    struct pipeline_options options = {
        .n_eigenmaps = 2, .follow = TRUE, .progress = count_reports, .data = &follower};
    struct pipeline_result result;
    set_state(fixture, "running");
    GThread *thread = g_thread_new("capture", capture_slowly, fixture);
    pipeline_run(fixture->path, &options, &result, &error);
    g_assert_no_error(error);
    g_thread_join(thread);
    g_assert_cmpint(result.n_views, ==, N_VIEWS);
    g_assert_cmpint(follower.reports, >=, 3 * N_VIEWS);
    check_btf(fixture);
    check_mdf(fixture);
}

static gpointer cancel_soon(gpointer data) {
    g_usleep(300000);
    g_cancellable_cancel(data);
    return NULL;
}

static void test_cancel(struct fixture *fixture, gconstpointer unused) {
    g_autoptr(GError) error = NULL;
    g_autoptr(GCancellable) cancellable = g_cancellable_new();
    struct pipeline_options options = {
        .n_eigenmaps = 2, .follow = TRUE, .cancellable = cancellable};
    struct pipeline_result result;
    GThread *thread = g_thread_new("cancel", cancel_soon, cancellable);
    g_assert_false(pipeline_run(fixture->path, &options, &result, &error));
    g_assert_error(error, G_IO_ERROR, G_IO_ERROR_CANCELLED);
    g_thread_join(thread);
    g_clear_error(&error);
    capture(fixture, 0, fixture->n_shots, NULL);
    g_assert_false(pipeline_run(fixture->path, &options, &result, &error));
    g_assert_error(error, G_IO_ERROR, G_IO_ERROR_CANCELLED);
}

static void one_nan(struct exr_part *part, const struct session_shot *shot) {
    if (shot->id == 2)
        part->planes[0][SIDE / 2 * SIDE + SIDE / 2] = NAN;
}

static void all_nan(struct exr_part *part, const struct session_shot *shot) {
    for (int i = 0; i < SIDE * SIDE && shot->id == 2; i++)
        part->planes[0][i] = NAN;
}

/* A pixel that is no number makes holes that are counted; a picture of them is refused. */
static void test_nan(struct fixture *fixture, gconstpointer unused) {
    capture(fixture, 0, fixture->n_shots, one_nan);
    process(fixture, 2, FALSE);
    g_autofree char *path = product(fixture, "btf/view_0000.exr");
    struct exr_part *part = exr_read_part(path, "light_0001", NULL);
    int holes, zeros = 0;
    g_assert_true(exr_get_int(part, "mesorig.holes", &holes, NULL));
    for (int i = 0; i < TEXELS * TEXELS; i++) {
        g_assert_true(isfinite(part->planes[0][i]));
        zeros += part->planes[0][i] == 0;
    }
    g_assert_cmpint(holes, >, 0);
    g_assert_cmpint(zeros, ==, holes);
    exr_part_free(part);
    capture(fixture, 1, 2, all_nan);
    process_fails(fixture, PIPELINE_ERROR_DATA, "000002");
}

static void add_channel(struct exr_part *part, const char *name) {
    part->channels = g_renew(char *, part->channels, part->n_channels + 2);
    part->planes = g_renew(float *, part->planes, part->n_channels + 1);
    part->channels[part->n_channels] = g_strdup(name);
    part->channels[part->n_channels + 1] = NULL;
    part->planes[part->n_channels++] = g_new0(float, SIDE *SIDE);
}

enum { SATURATED = 40 * SIDE + 40, BRIGHT = 55 * SIDE + 60 };

/* One pixel saturated, another too bright for the longest exposure, a third no number. */
static void all_sorts(struct exr_part *part, const struct session_shot *shot) {
    if (shot->id != 2)
        return;
    float most = 0;
    for (int i = 0; i < SIDE * SIDE; i++)
        most = MAX(most, part->planes[0][i]);
    add_channel(part, "saturated");
    part->planes[1][SATURATED] = 1;
    part->planes[0][SATURATED] = part->planes[0][BRIGHT] = 3 * most;
    part->planes[0][SIDE / 2 * SIDE + SIDE / 2] = NAN;
    exr_set_double(part, "mesorig.shorter_from", 2 * (double)most);
    exr_set_int(part, "mesorig.saturated", 1);
}

/* The texel that a pixel of the first camera shows the middle of, or is next to. */
static int texel_at(int pixel) {
    double p[3];
    hit(&pinholes[0], pixel, 5, p);
    turn3(p, -turn_deg(0) * DEGREE, p);
    return (int)floor((12 - p[1]) / 24 * TEXELS) * TEXELS + (int)floor((p[0] + 12) / 24 * TEXELS);
}

static void check_mark(const struct exr_part *part, int mark, const char *name, int pixel) {
    const float *marks = exr_part_plane(part, "mark");
    const int at = texel_at(pixel);
    int count = 0, said;
    g_assert_nonnull(marks);
    for (int i = 0; i < TEXELS * TEXELS; i++) {
        if (!((int)marks[i] & mark))
            continue;
        count++;
        g_assert_cmpint(abs(i % TEXELS - at % TEXELS), <=, 2);
        g_assert_cmpint(abs(i / TEXELS - at / TEXELS), <=, 2);
    }
    g_assert_true((int)marks[at] & mark);
    g_assert_true(exr_get_int(part, name, &said, NULL));
    g_assert_cmpint(said, ==, count);
}

/* What was wrong with a pixel is said of the texels that show it, and of no others. */
static void test_marks(struct fixture *fixture, gconstpointer unused) {
    g_autoptr(GError) error = NULL;
    capture(fixture, 0, fixture->n_shots, all_sorts);
    process(fixture, 2, FALSE);
    g_autofree char *path = product(fixture, "btf/view_0000.exr");
    struct exr_part *part = exr_read_part(path, "light_0001", &error);
    g_assert_no_error(error);
    check_mark(part, BTF_MARK_BOUND, "mesorig.bounds", SATURATED);
    check_mark(part, BTF_MARK_SHORTER, "mesorig.shorter", BRIGHT);
    check_mark(part, BTF_MARK_HOLE, "mesorig.holes", SIDE / 2 * SIDE + SIDE / 2);
    exr_part_free(part);
    part = exr_read_part(path, "light_0000", NULL);
    g_assert_null(exr_part_plane(part, "mark"));
    exr_part_free(part);
    struct btf_matrix *btf = btf_matrix_read(fixture->path, NULL, NULL, NULL, &error);
    g_assert_no_error(error);
    g_assert_cmpint(btf->holes, >, 0);
    g_assert_cmpint(btf->bounds, >, 0);
    g_assert_cmpint(btf->shorter, >, 0);
    for (int i = 0; i < TEXELS * TEXELS * btf->n_views * btf->n_lights * 3; i++)
        g_assert_cmpfloat(btf->values[i], !=, 0);
    btf_matrix_free(btf);
}

static void test_damaged(struct fixture *fixture, gconstpointer unused) {
    capture(fixture, 0, fixture->n_shots, NULL);
    for (int kind = 0; kind < 2; kind++) {
        const struct session_shot *shot = &fixture->shots[kind ? N_LIGHTS : 1];
        g_autofree char *relative = session_frame_path(shot, "cam50"), *bytes = NULL;
        g_autofree char *path = g_build_filename(fixture->path, relative, NULL);
        gsize length;
        g_assert_true(g_file_get_contents(path, &bytes, &length, NULL));
        g_assert_true(g_file_set_contents(path, bytes, (gssize)length / 2, NULL));
        process_fails(fixture, PIPELINE_ERROR_DATA, relative);
        bytes[length / 2] ^= 1;
        g_assert_true(g_file_set_contents(path, bytes, (gssize)length, NULL));
        process_fails(fixture, PIPELINE_ERROR_DATA, "SHA-256");
        g_unlink(path);
        process_fails(fixture, PIPELINE_ERROR_DATA, relative);
        bytes[length / 2] ^= 1;
        g_assert_true(g_file_set_contents(path, bytes, (gssize)length, NULL));
    }
    process(fixture, 2, FALSE);
    check_btf(fixture);
    check_mdf(fixture);
}

static void other_sweep(struct exr_part *part, const struct session_shot *shot) {
    if (shot->kind == SHOT_SWEEP && shot->id == N_LIGHTS + 1)
        exr_set_double(part, "sweep.from_deg", -5);
}

static void other_shot(struct exr_part *part, const struct session_shot *shot) {
    if (shot->kind == SHOT_LAMP)
        exr_set_int(part, "mesorig.shot", 77);
}

static void test_mixed_up(struct fixture *fixture, gconstpointer unused) {
    capture(fixture, 0, fixture->n_shots, other_shot);
    process_fails(fixture, PIPELINE_ERROR_DATA, "77");
    capture(fixture, 0, fixture->n_shots, other_sweep);
    process_fails(fixture, PIPELINE_ERROR_DATA, "000004");
    /* A picture of another camera. */
    capture(fixture, 0, fixture->n_shots, NULL);
    struct exr_part *part =
        exr_part_new("radiance", 8, 8, (const char *const[]){"Y", NULL}, EXR_HALF);
    struct session_frame frames[2] = {write_frame(fixture, part, &fixture->shots[0], 0)};
    g_autoptr(Session) session = session_open(fixture->path, SESSION_CAPTURE, NULL);
    part = lamp_frame(&fixture->shots[0], 1);
    frames[1] = write_frame(fixture, part, &fixture->shots[0], 1);
    session_commit_shot(session, 1, SHOT_DONE, frames, 2, NULL, NULL);
    g_clear_pointer(&session, session_close);
    process_fails(fixture, PIPELINE_ERROR_DATA, "8 × 8");
    for (int i = 0; i < 2; i++) {
        g_free(frames[i].path);
        g_free(frames[i].sha256);
    }
}

static void test_no_session(struct fixture *fixture, gconstpointer unused) {
    g_autoptr(GError) error = NULL;
    struct pipeline_options options = {.n_eigenmaps = 2};
    struct pipeline_result result;
    g_assert_false(pipeline_run(fixture->folder, &options, &result, &error));
    g_assert_nonnull(error);
}

int main(int argc, char **argv) {
    static const struct {
        const char *path;
        void (*func)(struct fixture *, gconstpointer);
    } tests[] = {
        {"/pipeline/whole", test_whole},
        {"/pipeline/threads", test_threads},
        {"/pipeline/again", test_again},
        {"/pipeline/retaken", test_retaken},
        {"/pipeline/missing", test_missing},
        {"/pipeline/skipped", test_skipped},
        {"/pipeline/follow", test_follow},
        {"/pipeline/cancel", test_cancel},
        {"/pipeline/nan", test_nan},
        {"/pipeline/marks", test_marks},
        {"/pipeline/damaged", test_damaged},
        {"/pipeline/mixed-up", test_mixed_up},
        {"/pipeline/no-session", test_no_session},
        {"/pipeline/slipped", test_slipped},
        {"/pipeline/predicted", test_predicted},
    };
    g_test_init(&argc, &argv, NULL);
    for (guint i = 0; i < G_N_ELEMENTS(tests); i++)
        g_test_add(tests[i].path, struct fixture, NULL, set_up, tests[i].func, tear_down);
    return g_test_run();
}
