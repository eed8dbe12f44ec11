/* The same material by one, two and four processes. */
#include "base/file_lock.h"
#include "codecs/lpca/lpca.h"
#include "formats/import.h"

#include "lib/process.h"
#include "lib/session_fixture.h"
#include "lib/test.h"

#define SIDE   40 /* 1600 texels: seven blocks of TEAM_ROWS */
#define VIEWS  3
#define LIGHTS 4

static const struct work quietly = {0};

static float value(int view, int light, int texel, int colour) {
    const double x = texel % SIDE, y = texel / SIDE; /* NOLINT(bugprone-integer-division) */
    const double tilt = sin(0.4 * x + view) * cos(0.3 * y - light);
    return (float)(0.3 + 0.1 * sin(0.05 * x * y + colour) + 0.1 * tilt +
                   0.8 * exp(-9 * (tilt - 0.6) * (tilt - 0.6)));
}

static void write_picture(const char *dir, int view, int light) {
    static const char *const channels[] = {"B", "G", "R", NULL};
    g_autofree char *path =
        g_strdup_printf("%s/tv%03d_pv%03d_tl%03d_pl%03d.exr", dir, 20 * view, view ? 90 * view : 0,
                        15 * light, light ? 80 * light : 0);
    struct exr_file *file = exr_file_new();
    struct exr_part *part = exr_part_new("rgb", SIDE, SIDE, channels, EXR_HALF);
    for (int i = 0; i < SIDE * SIDE; i++)
        for (int c = 0; c < 3; c++)
            part->planes[2 - c][i] = value(view, light, i, c);
    exr_file_add(file, part);
    g_assert_true(exr_write(path, file, EXR_NONE, FALSE, NULL));
    exr_file_free(file);
}

static char *make_session(void) {
    g_autofree char *dir = g_build_filename(session_fixture_folder, "pictures", NULL);
    g_autoptr(GError) error = NULL;
    const struct import_wish wish = {0};
    struct import_result result;
    char *path = session_fixture_path("bumps");
    g_assert_cmpint(g_mkdir_with_parents(dir, 0700), ==, 0);
    for (int view = 0; view < VIEWS; view++)
        for (int light = 0; light < LIGHTS; light++)
            write_picture(dir, view, light);
    g_assert_true(import_pictures(path, dir, &wish, &quietly, &result, &error));
    g_assert_no_error(error);
    return path;
}

/* Returns the exit code. */
static int run(int ranks, const char *session, const char *output, char **ret_errors) {
    g_autofree char *n = g_strdup_printf("%d", ranks);
    const char *const argv[] = {
        MPIEXEC, "--oversubscribe", "-n", n,    COMPRESS_MPI, session, "-k",   "5", "--components",
        "4",     "--threads",       "1",  "-q", "float",      "-o",    output, NULL};
    return process_run(argv, NULL, ret_errors);
}

TEST(ranks) {
    g_autofree char *session = make_session();
    g_autofree char *output = g_build_filename(session_fixture_folder, "lpca.exr", NULL);
    g_autoptr(GError) error = NULL;
    struct btf_matrix *btf = btf_matrix_read(session, NULL, &error);
    g_assert_no_error(error);
    const struct lpca_options options = {5, 4};
    g_autoptr(Lpca) alone = lpca_compute(btf, &options, &error);
    g_assert_no_error(error);
    g_assert_cmpfloat(alone->error, >, 0.001);
    for (int ranks = 1; ranks <= 4; ranks *= 2) {
        g_autofree char *errors = NULL;
        g_assert_cmpint(run(ranks, session, output, &errors), ==, 0);
        g_autoptr(Lpca) lpca = lpca_read(output, &error);
        g_assert_no_error(error);
        g_assert_cmpint(lpca->n_clusters, ==, alone->n_clusters);
        for (int i = 0; i < SIDE * SIDE; i++)
            g_assert_cmpint(lpca->clusters[i], ==, alone->clusters[i]);
        g_assert_cmpfloat_with_epsilon(lpca->error, alone->error, 1e-6);
        g_assert_cmpfloat_with_epsilon(lpca_error(lpca, btf, 0), alone->error, 1e-6);
        g_unlink(output);
    }
    btf_matrix_free(btf);
}

/* What one process cannot read ends all of them. */
TEST(damaged) {
    g_autofree char *session = make_session();
    g_autofree char *output = g_build_filename(session_fixture_folder, "none.exr", NULL);
    g_autofree char *view = g_build_filename(session, "products", "btf", "view_0001.exr", NULL);
    g_autofree char *errors = NULL, *missing = NULL;
    g_assert_true(g_file_set_contents(view, "cut off", -1, NULL));
    g_assert_cmpint(run(2, session, output, &errors), !=, 0);
    g_assert_nonnull(strstr(errors, "view_0001.exr"));
    g_assert_false(g_file_test(output, G_FILE_TEST_EXISTS));
    g_assert_cmpint(run(2, "/no/such.session", output, &missing), !=, 0);
    g_assert_nonnull(strstr(missing, "/no/such.session"));
    g_clear_pointer(&missing, g_free);
    g_assert_cmpint(run(1, "/no/such.session", "/no/such/lpca.exr", &missing), !=, 0);
    g_assert_nonnull(strstr(missing, "there is no folder /no/such; make it first"));
}

/* While another process makes the file, this one does not begin; then the lock is gone. */
TEST(locked) {
    g_autofree char *session = make_session(), *errors = NULL, *lock_path = NULL;
    g_autofree char *output = g_build_filename(session_fixture_folder, "locked.exr", NULL);
    const int lock = file_lock_take_output(output, &lock_path, NULL);
    g_assert_cmpint(lock, >=, 0);
    g_assert_cmpint(run(2, session, output, &errors), !=, 0);
    assert_has(errors, "locked.exr.lock: process ");
    g_assert_false(g_file_test(output, G_FILE_TEST_EXISTS));
    file_lock_give(lock, lock_path);
    g_clear_pointer(&errors, g_free);
    g_assert_cmpint(run(2, session, output, &errors), ==, 0);
    g_assert_true(g_file_test(output, G_FILE_TEST_EXISTS));
    g_assert_false(g_file_test(lock_path, G_FILE_TEST_EXISTS));
}

/* Once, whatever the locale and the number of processes; without MPI's help as well. */
TEST(help) {
    static const char usage[] = "Compresses a BTF with several processes.";
    const char *const alone[] = {"env", "-i", "LC_ALL=C", COMPRESS_MPI, "--help", NULL};
    const char *const three[] = {MPIEXEC,      "--oversubscribe", "-n", "3",
                                 COMPRESS_MPI, "--help",          NULL};
    const char *const version[] = {"env", "-i", COMPRESS_MPI, "--version", NULL};
    g_autofree char *one = process_text(0, alone), *some = process_text(0, three);
    g_autofree char *number = process_text(0, version);
    assert_has(one, usage);
    assert_has(some, usage);
    g_assert_null(strstr(strstr(some, usage) + 1, usage));
    g_assert_cmpstr(number, ==, "mesorig-compress-mpi " MESORIG_VERSION "\n");
}

BEFORE_TESTS {
    g_setenv("OMPI_ALLOW_RUN_AS_ROOT", "1", TRUE);
    g_setenv("OMPI_ALLOW_RUN_AS_ROOT_CONFIRM", "1", TRUE);
    /* Ranks that wait on a machine with fewer processors should let the others work. */
    g_setenv("OMPI_MCA_mpi_yield_when_idle", "1", TRUE);
    g_setenv("OMP_NUM_THREADS", "1", TRUE);
    /* Open MPI frees little when it ends. */
    g_setenv("ASAN_OPTIONS", "detect_leaks=0", TRUE);
}

TESTS_RUN_BY(session_fixture_run);
