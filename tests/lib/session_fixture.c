#include "session_fixture.h"
#include "lib/ok.h"

char *session_fixture_folder;

char *session_fixture_path(const char *name) {
    static int n;

    return g_strdup_printf("%s/%s%d.session", session_fixture_folder, name, n++);
}

char *session_fixture_new_folder(void) {
    char *path = g_build_filename(session_fixture_folder, "folder-XXXXXX", NULL);
    g_assert_nonnull(g_mkdtemp(path));
    return path;
}

/* Returns a random finite double other than −0. Three of four have random bits; the others are
 * whole numbers from −9 to 9. */
static double session_fixture_random_double(GRand *rand) {
    for (;;) {
        guint64 bits = (guint64)g_rand_int(rand) << 32 | g_rand_int(rand);
        double value;

        memcpy(&value, &bits, sizeof value);
        if (isfinite(value) && bits != 1ull << 63)
            return g_rand_int_range(rand, 0, 4) ? value
                                                : round(g_rand_double_range(rand, -9, 9)) + 0.0;
    }
}

static void random_directions(struct session_direction *directions, int n, GRand *rand) {
    for (int i = 0; i < n; i++)
        directions[i] = (struct session_direction){
            .index = i,
            .device = g_rand_int_range(rand, 0, 9),
            .theta_deg = session_fixture_random_double(rand),
            .phi_deg = session_fixture_random_double(rand),
            .turntable_deg = session_fixture_random_double(rand),
            .note = i % 3 ? NULL : (char *)"moved, it met the arc: 3° → 4°",
        };
}

/* Returns a set within the first 32 cameras, within those that fit into the column cameras, or
 * beyond them. */
static struct camera_set random_cameras(int i, GRand *rand) {
    const guint64 bits = g_rand_int(rand);
    switch (i % 3) {
    case 0:
        return (struct camera_set){{bits}};
    case 1:
        return (struct camera_set){{bits << 31}};
    default:
        return (struct camera_set){{bits << 32, i % 2 ? 1 : bits, 0, bits << 32}};
    }
}

static struct session_shot random_shot(int i, int n_lights, int n_lasers, GRand *rand) {
    enum session_shot_kind kind = (enum session_shot_kind)g_rand_int_range(rand, 0, 3);

    if (kind == SHOT_LAMP ? n_lights == 0 : n_lasers == 0)
        kind = SHOT_DARK;
    return (struct session_shot){
        .id = i + 1,
        .kind = kind,
        .pose = i / 3,
        .turntable_deg = session_fixture_random_double(rand),
        .arc_deg = session_fixture_random_double(rand),
        .source = kind == SHOT_DARK
                      ? -1
                      : g_rand_int_range(rand, 0, kind == SHOT_LAMP ? n_lights : n_lasers),
        .device = g_rand_int_range(rand, -1, 5),
        .cameras = random_cameras(i, rand),
        .sweep_from_deg = session_fixture_random_double(rand),
        .sweep_to_deg = session_fixture_random_double(rand),
        .sweep_steps = g_rand_int_range(rand, 0, 500),
        .state = i % 7 == 6 ? SHOT_SKIPPED : SHOT_PLANNED,
        .note = i % 7 == 6 ? (char *)"the arc would stand in the way" : NULL,
    };
}

struct random_plan *session_fixture_random_plan(guint32 seed, int n_shots) {
    struct random_plan *p = g_new0(struct random_plan, 1);
    GRand *rand = g_rand_new_with_seed(seed);

    p->plan = (struct session_plan){
        .grid = {g_rand_int_range(rand, 1, 2000), g_rand_int_range(rand, 1, 2000),
                 fabs(session_fixture_random_double(rand)) + 1e-3, 50,
                 session_fixture_random_double(rand), 5},
        .views = p->views,
        .lights = p->lights,
        .lasers = p->lasers,
        .n_views = g_rand_int_range(rand, 0, 40),
        .n_lights = g_rand_int_range(rand, 0, 40),
        .n_lasers = g_rand_int_range(rand, 0, 40),
        .shots = p->shots,
        .n_shots = n_shots,
    };
    random_directions(p->views, 40, rand);
    random_directions(p->lights, 40, rand);
    random_directions(p->lasers, 40, rand);
    for (int i = 0; i < n_shots; i++)
        p->shots[i] = random_shot(i, p->plan.n_lights, p->plan.n_lasers, rand);
    g_rand_free(rand);
    return p;
}

Session *session_fixture_create(const char *path, guint32 seed, int n_shots) {
    g_autofree struct random_plan *p = session_fixture_random_plan(seed, n_shots);
    Session *session = ok(session_create(path, "Loden, grün", &texts, &p->plan, ERR));
    g_assert_nonnull(session);
    return session;
}

static void assert_directions(GPtrArray *got, const struct session_direction *wanted, int n) {
    g_assert_nonnull(got);
    g_assert_cmpuint(got->len, ==, n);
    for (int i = 0; i < n; i++) {
        const struct session_direction *d = g_ptr_array_index(got, i);

        g_assert_cmpint(d->index, ==, i);
        g_assert_cmpint(d->device, ==, wanted[i].device);
        assert_bits(d->theta_deg, wanted[i].theta_deg);
        assert_bits(d->phi_deg, wanted[i].phi_deg);
        assert_bits(d->turntable_deg, wanted[i].turntable_deg);
        g_assert_cmpstr(d->note, ==, wanted[i].note);
    }
    g_ptr_array_unref(got);
}

static void assert_shots(GPtrArray *got, const struct session_shot *wanted, int n) {
    g_assert_nonnull(got);
    g_assert_cmpuint(got->len, ==, n);
    for (int i = 0; i < n; i++) {
        const struct session_shot *shot = g_ptr_array_index(got, i);

        g_assert_cmpint(shot->id, ==, i + 1);
        g_assert_cmpint(shot->kind, ==, wanted[i].kind);
        g_assert_cmpint(shot->pose, ==, wanted[i].pose);
        assert_bits(shot->turntable_deg, wanted[i].turntable_deg);
        assert_bits(shot->arc_deg, wanted[i].arc_deg);
        g_assert_cmpint(shot->source, ==, wanted[i].source);
        g_assert_cmpint(shot->device, ==, wanted[i].device);
        g_assert_true(camera_set_equal(shot->cameras, wanted[i].cameras));
        assert_bits(shot->sweep_from_deg, wanted[i].sweep_from_deg);
        assert_bits(shot->sweep_to_deg, wanted[i].sweep_to_deg);
        g_assert_cmpint(shot->sweep_steps, ==, wanted[i].sweep_steps);
        g_assert_cmpint(shot->state, ==, wanted[i].state);
        g_assert_cmpstr(shot->note, ==, wanted[i].note);
    }
    g_ptr_array_unref(got);
}

void session_fixture_assert_plan(Session *session, const struct random_plan *p) {
    struct session_grid grid;
    g_autoptr(GError) error = NULL;
    g_autofree char *rig = session_text(session, "rig.conf", &error);
    g_autofree char *calibration = session_text(session, "calibration.conf", &error);

    g_assert_cmpstr(session_name(session), ==, "Loden, grün");
    g_assert_cmpstr(rig, ==, texts.rig_conf);
    g_assert_cmpstr(calibration, ==, "");
    g_assert_true(session_grid(session, &grid, &error));
    g_assert_cmpmem(&grid, sizeof grid, &p->plan.grid, sizeof grid);
    assert_directions(session_views(session, &error), p->views, p->plan.n_views);
    assert_directions(session_lights(session, &error), p->lights, p->plan.n_lights);
    assert_directions(session_lasers(session, &error), p->lasers, p->plan.n_lasers);
    ok(assert_shots(session_shots(session, ERR), p->shots, p->plan.n_shots));
}

struct session_frame session_fixture_frame(Session *session, gint64 shot, int camera) {
    struct session_shot of = {.id = shot, .kind = SHOT_LAMP};
    g_autofree char *name = g_strdup_printf("cam/%d", camera);
    struct session_frame frame = {.shot = shot, .camera = camera, .retakes = camera};
    g_autofree char *file = NULL;
    g_autofree char *content = g_strdup_printf("pixels %ld %d", (long)shot, camera);

    frame.path = session_frame_path(&of, name);
    file = session_file(session, frame.path);
    g_assert_true(g_file_set_contents(file, content, -1, NULL));
    frame.sha256 = exr_sha256(file, &frame.bytes, NULL);
    frame.captured_s = (double)shot + camera / 3.0;
    return frame;
}

void session_fixture_clear_frame(struct session_frame *frame) {
    g_free(frame->path);
    g_free(frame->sha256);
}

gboolean session_fixture_commit(Session *session, gint64 shot, int n, GError **error) {
    struct session_frame frames[4] = {0};
    gboolean ok;

    for (int c = 0; c < n; c++)
        frames[c] = session_fixture_frame(session, shot, c);
    ok = session_commit_shot(session, shot, SHOT_DONE, frames, n, NULL, error);
    for (int c = 0; c < n; c++)
        session_fixture_clear_frame(&frames[c]);
    return ok;
}

enum session_shot_state session_fixture_state(Session *session, gint64 shot) {
    g_autoptr(GPtrArray) shots = session_shots(session, NULL);

    return ((struct session_shot *)g_ptr_array_index(shots, shot - 1))->state;
}

void session_fixture_wait(pid_t child, int signal) {
    int status;

    g_assert_cmpint(waitpid(child, &status, 0), ==, child);
    if (signal)
        g_assert_true(WIFSIGNALED(status) ? WTERMSIG(status) == signal : WEXITSTATUS(status) == 0);
    else
        g_assert_true(WIFEXITED(status) && WEXITSTATUS(status) == 0);
}

int session_fixture_run(void) {
    int status;

    session_fixture_folder = g_dir_make_tmp("mesorig-session-XXXXXX", NULL);
    status = g_test_run();
    remove_tree(session_fixture_folder);
    g_free(session_fixture_folder);
    return status;
}
