#include "pipeline_fixture.h"
#include "lib/ok.h"

struct rig fixture_make_rig(void) {
    struct rig rig = {.id = "test", .arc_radius_mm = 500, .arc_width_mm = 30};
    for (int i = 0; i < N_CAMERAS; i++)
        rig.cameras[rig.n_cameras++] = pinhole_to_rig(&pinholes[i], i ? "cam50" : "cam20");
    rig.lamps[rig.n_lamps++] = arc_lamp_to_rig(&lamp, "lamp35");
    rig.lasers[rig.n_lasers++] = line_laser_to_rig(&laser, "laser45");
    return rig;
}

double fixture_turn_deg(int turn) {
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
                                      .turntable_deg = fixture_turn_deg(turn),
                                      .arc_deg = fixture_turn_deg(turn) + 40 + 70 * source,
                                      .source = source,
                                      .device = 0,
                                      .cameras = {{(1 << N_CAMERAS) - 1}},
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
                                              .phi_deg = 360 - fixture_turn_deg(i / N_CAMERAS),
                                              .turntable_deg = fixture_turn_deg(i / N_CAMERAS)};
    for (int i = 0; i < N_LIGHTS; i++)
        lights[i] = (struct session_direction){.index = i, .theta_deg = 35, .phi_deg = 40 + 70 * i};
    for (int i = 0; i < N_LASERS; i++)
        lasers[i] = (struct session_direction){.index = i, .theta_deg = 45, .phi_deg = 40 + 70 * i};
    struct rig rig = fixture_make_rig();
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

static void tear_down(struct fixture *fixture, gconstpointer unused) {
    remove_tree(fixture->folder);
    g_free(fixture->folder);
    g_free(fixture->path);
}

void hit(const struct pinhole *pinhole, int pixel, double height, double *ret) {
    double eye[3], ray[3];
    pinhole_eye(pinhole, eye);
    pinhole_ray(pinhole, pixel % SIDE, (double)(pixel / SIDE), ray);
    double t = (height - eye[2]) / ray[2];
    for (int i = 0; i < 3; i++)
        ret[i] = eye[i] + t * ray[i];
}

struct exr_part *lamp_frame(const struct session_shot *shot, int camera) {
    static const char *const channels[] = {"Y", NULL};
    struct exr_part *part = exr_part_new("radiance", SIDE, SIDE, channels, EXR_HALF);
    exr_set_string(part, "mesorig.cfa", "grbg");
    exr_set_int(part, "mesorig.shot", (int)shot->id);
    for (int i = 0; i < SIDE * SIDE; i++) {
        double p[3], at[3], start[3] = {500 * sin(lamp.theta), 0, 500 * cos(lamp.theta)};
        int even_y = (i / SIDE) % 2 == 0, even_x = i % SIDE % 2 == 0;
        int colour = even_y ? (even_x ? 1 : 0) : (even_x ? 2 : 1);
        hit(&pinholes[camera], i, 5, p);
        analytic_turn(start, shot->arc_deg * DEGREE, at);
        double way[3] = {at[0] - p[0], at[1] - p[1], at[2] - p[2]}, r2 = analytic_dot(way, way);
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
        double sweep_deg = line_laser_sweep(&laser, shot->arc_deg * DEGREE, p) / DEGREE;
        part->planes[0][i] = 1000;
        part->planes[1][i] = (float)((sweep_deg - from_deg) / (to_deg - from_deg) * (N_STEPS - 1));
        part->planes[2][i] = 1.5f;
    }
    return part;
}

struct session_frame fixture_write_frame(const struct fixture *fixture, struct exr_part *part,
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

static void fixture_capture_shot(struct fixture *fixture, Session *session,
                                 struct session_shot *shot, Spoil spoil) {
    struct session_frame frames[N_CAMERAS];
    for (int camera = 0; camera < N_CAMERAS; camera++) {
        struct exr_part *part =
            shot->kind == SHOT_LAMP ? lamp_frame(shot, camera) : sweep_frame(shot, camera);
        if (spoil)
            spoil(part, shot);
        frames[camera] = fixture_write_frame(fixture, part, shot, camera);
    }
    ok(session_commit_shot(session, shot->id, SHOT_DONE, frames, N_CAMERAS, NULL, ERR));
    for (int camera = 0; camera < N_CAMERAS; camera++) {
        g_free(frames[camera].path);
        g_free(frames[camera].sha256);
    }
}

void fixture_capture(struct fixture *fixture, int first, int last, Spoil spoil) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Session) session = session_open(fixture->path, SESSION_CAPTURE, &error);
    g_assert_no_error(error);
    for (int i = first; i < last; i++)
        fixture_capture_shot(fixture, session, &fixture->shots[i], spoil);
}

void fixture_set_value(const struct fixture *fixture, const char *key, const char *value) {
    g_autoptr(Session) session = session_open(fixture->path, SESSION_CAPTURE, NULL);
    g_assert_true(session_set_value(session, key, value, NULL));
}

void fixture_set_state(const struct fixture *fixture, const char *state) {
    fixture_set_value(fixture, "state", state);
}

struct pipeline_result fixture_process(const struct fixture *fixture, int n_threads,
                                       gboolean follow) {
    struct pipeline_options options = {
        .n_eigenmaps = 2, .work.n_threads = n_threads, .follow = follow};
    struct pipeline_result result;
    ok(pipeline_run(fixture->path, &options, &result, ERR));
    return result;
}

void fixture_process_fails(const struct fixture *fixture, int code, const char *says) {
    g_autoptr(GError) error = NULL;
    struct pipeline_options options = {.n_eigenmaps = 2};
    struct pipeline_result result;
    g_assert_false(pipeline_run(fixture->path, &options, &result, &error));
    g_assert_error(error, DATA_ERROR, code);
    if (!strstr(error->message, says))
        g_error("\"%s\" does not say %s", error->message, says);
}

char *fixture_product(const struct fixture *fixture, const char *name) {
    return g_build_filename(fixture->path, "products", name, NULL);
}

void fixture_check_mdf_where_known(const struct fixture *fixture, gboolean everywhere) {
    g_autofree char *path = fixture_product(fixture, "mdf.exr");
    struct exr_file *file = exr_read(path, NULL);
    g_assert_cmpuint(file->parts->len, ==, N_VIEWS);
    for (int view = 0; view < N_VIEWS; view++) {
        g_autofree char *name = g_strdup_printf("view_%04d", view);
        const struct exr_part *part = exr_file_part(file, name);
        for (int i = 0; i < TEXELS * TEXELS; i++) {
            double side = 24.0 / TEXELS, eye[3];
            double p[3] = {-12 + (i % TEXELS + 0.5) * side,
                           12 - ((double)(i / TEXELS) + 0.5) * side, 5};
            analytic_turn(p, fixture_turn_deg(view / N_CAMERAS) * DEGREE, p);
            pinhole_eye(&pinholes[view % N_CAMERAS], eye);
            double way[3] = {p[0] - eye[0], p[1] - eye[1], p[2] - eye[2]};
            double expected = (5 - level_mm) * sqrt(analytic_dot(way, way)) / -way[2];
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

void fixture_check_mdf(const struct fixture *fixture) {
    fixture_check_mdf_where_known(fixture, TRUE);
}

int fixture_run_tests(int argc, char **argv, const struct pipeline_test *tests, guint n) {
    g_test_init(&argc, &argv, NULL);
    for (guint i = 0; i < n; i++)
        g_test_add(tests[i].path, struct fixture, NULL, set_up, tests[i].func, tear_down);
    return g_test_run();
}
